"""docs/reports.md: its example runs, its pictures exist."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reports.md").read_text(encoding="utf-8")


def test_the_example_of_the_page_writes_both_files(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is an extra")
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    example = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
    done = subprocess.run([sys.executable, "-c", example], cwd=tmp_path, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["identification.html", "identification.rrd"]


def test_every_picture_of_the_page_exists_and_has_a_description() -> None:
    pictures = re.findall(r"!\[(.*?)\]\((.*?)\)", PAGE)
    assert len(pictures) >= 5
    for description, target in pictures:
        assert len(description) > 20
        assert (ROOT / "docs" / target).is_file()
