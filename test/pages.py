"""Reads pages: their fenced blocks with what has to be true of them, the commands in these, and the files they name."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WRITTEN_BY_TOOLS = ROOT / "docs" / "reference" / "generated"
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(page for page in ROOT.glob("docs/**/*.md") if WRITTEN_BY_TOOLS not in page.parents),
        *(ROOT / room / "README.md" for room in ("bags", "examples")),
    ]
)

FENCE = re.compile(r"(?:^<!-- test: (?P<mark>[\w ]+) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
PATHS = re.compile(
    r"`((?:poise|nodes|fake_robots|config|launch|tools|msg_defs|bags|docs|examples|benchmarks|test|third_party)/[\w./-]*)`"
)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its text, its first line in the page, and how it is tested."""

    page: Path
    line: int
    language: str
    text: str
    mark: str

    @property
    def commands(self) -> list[str]:
        """The commands of a shell block, continued lines joined, without comments."""
        joined = self.text.replace("\\\n", " ")
        quoted = re.sub(r"'[^']*'", lambda match: match[0].replace("\n", " "), joined)
        return [line for line in quoted.splitlines() if shlex.split(line, comments=True)]

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, match.start("text")), match["language"], match["text"], match["mark"] or "")
        for match in FENCE.finditer(text)
    ]


def inline_commands(page: Path) -> Iterator[list[str]]:
    """`poise ...`, `poise run ...` and `ros2 run poise ...` in running text and tables, as words."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for span in re.findall(r"`([^`\n]+)`", text):
        if re.match(r"(poise [a-z]+|ros2 run poise \w+)\b", span):
            yield shlex.split(span)


def named_files(page: Path) -> set[str]:
    """Paths of the repository in code spans, and the targets of links."""
    text = page.read_text(encoding="utf-8")
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if not link.startswith("http")]
    inside = {str((page.parent / link).resolve().relative_to(ROOT)) for link in filter(None, links)}
    return inside | set(PATHS.findall(text))
