"""The documentation site: it builds without a warning, shows every page, and documents every public name."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import PAGES, ROOT, WRITTEN_BY_TOOLS

from poise.cli import COMMANDS
from poise.errors import ErrorCode
from tools.site_reference import faces, has_example, public_names, python_pages

DOCS = ROOT / "docs"
SITE_PAGES = [page for page in PAGES if DOCS in page.parents]
TWO_SCREENS = 80
"""Lines of a page."""


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    quick = ["-b", "dummy", "-D", "autodoc_typehints=none"]  # links of types in signatures take 16 of 44 s of CPU
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", *quick, str(DOCS), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=550, check=False)
    assert done.returncode == 0, done.stderr


def test_every_page_is_in_the_navigation_once() -> None:
    listed = re.findall(r"^(?!:)([\w/]+)$", (DOCS / "index.md").read_text(), re.M)
    assert len(listed) == len(set(listed))
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in [*SITE_PAGES, *DOCS.glob("notebooks/*.ipynb")]}
    assert pages - {"index"} == {name for name in listed if not name.startswith("reference/generated/")}


def test_every_public_name_has_a_reference_page_and_an_example() -> None:
    documented = {
        (room, each.name) for names in public_names().values() for each in names for room in (each.face, *each.also)
    }
    assert documented == {(room, name) for room, names in faces().items() for name in names}
    assert {f"python/{room}.rst" for room in faces()} <= set(python_pages())
    lacking = [
        f"{each.face}.{each.name}" for names in public_names().values() for each in names if not has_example(each)
    ]
    assert not lacking, f"use them in a test, or give their docstrings an example: {lacking}"


def test_every_error_code_has_a_line_that_says_what_it_means_and_how_to_fix_it() -> None:
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (.*?) \| (.*?) \|$", (DOCS / "troubleshooting.md").read_text(), re.M)
    assert {name: int(number) for number, name, *_ in rows} == {code.name: int(code) for code in ErrorCode}
    assert all(meaning and fix for _, _, meaning, fix in rows)


def test_every_command_answers_a_question() -> None:
    text = (DOCS / "questions.md").read_text()
    assert not [name for name in COMMANDS if f"`poise {name}" not in text]


@pytest.mark.parametrize("page", [pytest.param(page, id=str(page.relative_to(DOCS))) for page in SITE_PAGES])
def test_a_long_page_has_headings_for_its_table_of_contents_or_a_picture(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    headings = len(re.findall(r"^##+ ", text, re.M))
    assert text.count("\n") <= TWO_SCREENS or headings >= 3 or "](pictures/" in text


def test_the_pages_of_the_reference_are_made_and_not_committed() -> None:
    assert str(WRITTEN_BY_TOOLS.relative_to(ROOT)) in (ROOT / ".gitignore").read_text()
