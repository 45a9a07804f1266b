"""README and docs hold: every command and example runs or is checked, every file, node and option they name exists."""

import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from pages import PAGES, ROOT, Block, blocks, inline_commands, named_files

from poise.cli import COMMANDS, load_command, run

NODES = set(re.findall(r'^    "(\w+)": "poise\.', (ROOT / "setup.py").read_text(), re.M))
NODE_SOURCES = "".join(
    path.read_text()
    for room in ("nodes", "fake_robots", "poise/force_torque", "poise/gripping")
    for path in (ROOT / room).rglob("*.py")
)
MAKE_TARGETS = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M))
SHARED = ("bags", "examples", "docs", "config", "benchmarks")
MARKS = {
    "": "the block runs",
    "status 2": "the block runs and ends with this exit status",
    "status 3": "the block runs and ends with this exit status",
    "parsed": "the block names files that the reader has: its options are parsed",
    "needs ROS": "the block needs nodes on a graph: options, parameters, types and files are checked",
    "excerpt": "the block is an excerpt of an output",
}
"""What `<!-- test: ... -->` above a block says."""
FREE = {".", "cd", "export", "colcon", "python3", "rosdep", "source"}
"""Programs of the shell and of ROS whose arguments are not checked."""
ELSEWHERE = {ROOT / "docs" / "simulator.md"}
"""Pages that a test of their own runs, with what the files that they write have to hold."""


def by_page(pages: list[Path]) -> list[object]:
    """Pages as parameters, named by their path."""
    return [pytest.param(page, id=str(page.relative_to(ROOT))) for page in pages]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with what a reader of a page has; its answers stay here."""
    for name in SHARED:
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def outside_docs(arguments: list[str]) -> list[str]:
    """The arguments, with pictures that a page writes into docs/ beside it instead."""
    return [argument.replace("docs/pictures/", "") for argument in arguments]


@pytest.mark.parametrize(
    "page",
    by_page(
        [
            page
            for page in PAGES
            if page not in ELSEWHERE and any(block.language in ("sh", "python", "text") for block in blocks(page))
        ]
    ),
)
def test_the_blocks_of_a_page(page: Path, reader: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_page(page, reader, capsys)


def run_page(page: Path, reader: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its commands run one after the other, then its Python as one script; what the page shows of output is printed."""
    shown: list[tuple[Block, Block]] = []
    printed: dict[Block, str] = {}
    above = None
    for block in blocks(page):
        assert block.mark in MARKS, f"{block}: unknown mark {block.mark!r}"
        if block.language == "sh":
            for line in block.commands:
                check_command(block, shlex.split(line, comments=True), capsys)
            output = capsys.readouterr()
            printed[block] = output.out + output.err
        elif block.language == "text" and block.mark != "excerpt" and above is not None:
            shown.append((block, above))
        above = above if block.language == "text" else block
    printed |= run_python([block for block in blocks(page) if block.language == "python"], reader)
    for block, source in shown:
        check_printed(block, printed[source])


def run_python(examples: list[Block], reader: Path) -> dict[Block, str]:
    """Run the Python blocks of a page as one script; what each printed."""
    for block in examples:
        compile(block.text, str(block), "exec")
    chosen = [block for block in examples if block.mark == ""]
    if not chosen:
        return {}
    (reader / "out").mkdir(exist_ok=True)
    script = "\n".join(f"{block.text}\nprint('\\x1e', end='')" for block in chosen)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=reader, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, f"{chosen[0]}\n{done.stderr}"
    return dict(zip(chosen, done.stdout.split("\x1e"), strict=False))


def check_command(block: Block, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run `poise ...`; check the programs, files and options of every other command."""
    where = f"{block}: {' '.join(words)}"
    while "=" in words[0] and words[0].partition("=")[0].isupper():
        words = words[1:]
    program, rest = words[0].removeprefix(".venv/bin/"), words[1:]
    if program == "poise" and rest[0] == "run":
        check_node(where, rest[1], rest[2:])
    elif program == "poise":
        parse(where, rest)
        if block.mark in ("", "status 2", "status 3"):
            status = run(outside_docs(rest))
            assert status == int(block.mark.removeprefix("status ") or 0), f"{where}\n{capsys.readouterr().err}"
    elif program == "ros2":
        check_ros2(where, rest)
    elif program == "make":
        assert set(rest) <= MAKE_TARGETS, where
    elif program in ("python", "pytest"):
        check_python(where, program, rest)
    else:
        assert program in FREE or program in ("pip", "pre-commit"), f"{where}: the test does not know {program}"


def parse(where: str, words: list[str]) -> None:
    """Hold the options of a poise command against its parser, without running it."""
    assert words[0] in COMMANDS, where
    command = load_command(words[0])
    try:
        command.make_context(words[0], list(words[1:]))
    except Exception as error:
        pytest.fail(f"{where}: {getattr(error, 'message', error)}")


def check_node(where: str, node: str, rest: list[str]) -> None:
    """A node that exists, with parameter files and parameters that exist."""
    assert node in NODES, where
    for option, value in pairwise(rest):
        if option == "--params-file":
            names = [ROOT / value, ROOT / "config" / value]
            assert value.startswith("my_") or any(path.is_file() for path in names), f"{where}: no file {value}"
        elif option == "-p":
            name, given, _ = value.partition(":=")
            assert given, where
            assert f'"{name.rpartition(".")[2]}"' in NODE_SOURCES, f"{where}: no parameter {name}"


def check_ros2(where: str, words: list[str]) -> None:
    """`ros2 run`, `launch`, `action`, `service` and `topic`: what they name of Poise exists."""
    if words[0] == "run":
        assert words[1] == "poise", where
        check_node(where, words[2], words[3:])
    elif words[0] == "launch":
        assert words[1] == "poise", where
        source = (ROOT / "launch" / words[2]).read_text() + (ROOT / "nodes" / "launching.py").read_text()
        for argument in words[3:]:
            assert f'"{argument.partition(":=")[0]}"' in source, f"{where}: {argument}"
    else:
        assert words[0] in ("action", "bag", "service", "topic"), where
        if words[0] == "bag":
            return
        (kind,) = [word for word in words if re.fullmatch(r"\w+/(msg|srv|action)/\w+", word)]
        package, folder, name = kind.split("/")
        definition = ROOT / "msg_defs" / folder / f"{name}.{folder}"
        assert package != "poise_msgs" or definition.is_file(), where
        values = yaml.safe_load(words[-1]) if words[-1].startswith("{") else {}
        for field in values:
            assert re.search(rf"^\S+ {field}\b", definition.read_text(), re.M), f"{where}: no field {field}"


def check_python(where: str, program: str, words: list[str]) -> None:
    """A script or module that exists, with options that it has."""
    if program == "pytest":
        assert all((ROOT / word).exists() for word in words if not word.startswith("-")), where
        return
    target = words[words.index("-m") + 1] if "-m" in words else words[0]
    path = ROOT / (f"{target.replace('.', '/').removeprefix('poise/')}.py" if "-m" in words else target)
    path = path if path.is_file() else ROOT / f"{target.replace('.', '/')}.py"
    assert path.is_file(), where
    for option in (word.partition("=")[0] for word in words if word.startswith("--") and word != "--ros-args"):
        assert f'"{option}"' in path.read_text(), f"{where}: {path.name} has no {option}"


def check_printed(block: Block, printed: str) -> None:
    """The words of a text block follow one another in what the block before it printed."""
    found, position = printed.replace("│", " ").split(), 0
    for word in block.text.replace("│", " ").split():
        assert word in found[position:], f"{block}: {word!r} is not printed"
        position = found.index(word, position) + 1


@pytest.mark.parametrize("page", by_page(PAGES))
def test_files_and_commands_that_a_page_names_exist(page: Path) -> None:
    missing = [name for name in sorted(named_files(page)) if not (ROOT / name).exists()]
    assert not missing
    for words in inline_commands(page):
        where = f"{page.name}: {' '.join(words)}"
        node = words[3:] if words[:3] == ["ros2", "run", "poise"] else words[2:] if words[1] == "run" else None
        if node is None:
            assert words[1] in COMMANDS, where
        elif node and node[0] != "NODE":
            assert node[0] in NODES, where


@pytest.mark.parametrize("page", by_page(PAGES))
def test_ros2_run_is_shown_beside_poise_run(page: Path) -> None:
    for block in blocks(page):
        assert block.language, f"{block}: name the language of the block"
        assert "ros2 run poise" not in block.text or "poise run" in block.text.replace("ros2 run poise", ""), block
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("|") and "`ros2 run poise" in line:
            assert "`poise run" in line, line


@pytest.mark.parametrize("page", by_page(PAGES))
def test_every_picture_has_a_description(page: Path) -> None:
    for description, target in re.findall(r"!\[(.*?)\]\((.*?)\)", page.read_text(encoding="utf-8")):
        assert len(description) > 20, target
