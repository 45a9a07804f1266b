"""Draws the rooms of the code and their imports into docs/architecture.md, as a mermaid graph; run it after a change.

python tools/draw_architecture.py [--check]
"""

import ast
import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.source_rules import LINKS, imported_names, product_files, tree

PAGE = Path(__file__).resolve().parents[1] / "docs" / "architecture.md"
BEGIN, END = "<!-- rooms: begin -->", "<!-- rooms: end -->"
EVERYWHERE = {"types", "errors", "files", "geometry"}
"""Used by nearly every room: shown as the ground floor, without arrows."""
SHELL = {"__main__", "api", "cli", "commands"}
"""Shown as one box on top."""


def room(module: str) -> str:
    """The room of a dotted name as the picture shows it."""
    name = ([*module.split("."), ""])[1]
    return "commands" if name in SHELL else name


def uses() -> dict[str, set[str]]:
    """The rooms that each room imports, without the ground floor."""
    found: dict[str, set[str]] = defaultdict(set)
    for module in product_files():
        if room(module) in {"", *EVERYWHERE}:
            continue
        found[room(module)] |= set()
        for _, source, name in imported_names(module):
            for target in (source, f"{source}.{name}"):
                if target in product_files() and room(target) not in {"", room(module), *EVERYWHERE}:
                    found[room(module)].add(room(target))
    return dict(found)


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The graph without the edges that follow from others (transitive reduction)."""

    def reach(start: str) -> set[str]:
        return set().union(*({each} | reach(each) for each in graph.get(start, ())))

    return {
        node: {end for end in ends if not any(end in reach(other) for other in ends - {end})}
        for node, ends in graph.items()
    }


def purpose(name: str) -> str:
    """The first sentence of a room's docstring."""
    path = {"commands": "poise.commands"}.get(name, f"poise.{name}")
    text = ast.get_docstring(tree(product_files()[path])) or ""
    return (
        text.split("\n\n")[0]
        .split(". ")[0]
        .split(":")[0]
        .rstrip(".")
        .replace("\n", " ")
        .replace('"', "'")
        .replace("`", "")
    )


def drawing() -> str:
    """The mermaid graph: an arrow points to what a room imports."""
    graph = reduced(uses())
    lines = ["```mermaid", "flowchart TD"]
    for name in sorted(graph):
        label = f"{name}/" if name in LINKS else "cli, commands, api" if name == "commands" else name
        lines.append(f'  {name}["<b>{label}</b><br/>{purpose(name)}"]')
    lines.append(f'  ground["<b>{", ".join(sorted(EVERYWHERE))}</b><br/>ground floor, used by every room"]')
    for name in sorted(graph):
        lines += [f"  {name} --> {target}" for target in sorted(graph[name]) or ["ground"]]
    return "\n".join([*lines, "```"])


def page() -> str:
    """The page with the graph of today."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return f"{before}{BEGIN}\n{drawing()}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    current = page()
    if "--check" in sys.argv:
        sys.exit(current != PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(current, encoding="utf-8")
