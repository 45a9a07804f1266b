"""Pages of the documentation that follow from the code: Python reference, commands, interfaces, parameters of nodes.

docs/conf.py calls `connect`; `python tools/site_reference.py DIR` writes the pages into a folder.
"""

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
NOT_PUBLIC = ("poise.nodes", "poise.fake_robots", "poise.commands")
"""Rooms whose interface is that of ROS and of the shell."""
CODE = ("test", "benchmarks", "examples", "nodes", "fake_robots", "tools", "poise")
"""Where an example of a name is looked for, in this order."""
LONGEST_EXAMPLE = 60


@dataclass(frozen=True)
class PublicName:
    """A name in the `__all__` of a room.

    Args:
        face: dotted name of the room that documents it: of several that export the same object, the innermost.
        name: in that room.
        value: the object.
        also: other rooms that export it.
    """

    face: str
    name: str
    value: Any
    also: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Directive of autodoc."""
        if inspect.isclass(self.value):
            return "autoclass"
        return "autofunction" if callable(self.value) and hasattr(self.value, "__code__") else "data"


@dataclass(frozen=True)
class Example:
    """A function of the code that uses a public name: file below the root, first and last line."""

    path: Path
    first: int
    last: int

    @property
    def length(self) -> int:
        """Lines."""
        return self.last - self.first + 1


# -- public names and their examples ------------------------------------------------------------------------------


@cache
def faces() -> dict[str, tuple[str, ...]]:
    """The rooms with public names, and these."""
    found = {}
    for path in sorted((ROOT / "poise").rglob("__init__.py")):
        module = ".".join(path.parent.relative_to(ROOT).parts)
        if not module.startswith(NOT_PUBLIC):
            names = tuple(getattr(importlib.import_module(module), "__all__", ()))
            if names:
                found[module] = names
    return found


@cache
def public_names() -> dict[str, tuple[PublicName, ...]]:
    """The public names that each room documents; each object is documented once."""
    exported: dict[tuple[str, int], list[str]] = {}
    for face, names in faces().items():
        for name in names:
            exported.setdefault((name, id(getattr(importlib.import_module(face), name))), []).append(face)
    pages: dict[str, list[PublicName]] = {face: [] for face in faces()}
    for (name, _), rooms in exported.items():
        home = max(rooms, key=lambda room: room.count("."))
        value = getattr(importlib.import_module(home), name)
        pages[home].append(PublicName(home, name, value, tuple(room for room in rooms if room != home)))
    return {face: tuple(sorted(names, key=lambda each: each.name.lower())) for face, names in pages.items() if names}


@cache
def examples() -> dict[str, Example]:
    """For each public name, as `room.name`, the shortest function that uses it: of a test, else of other code."""
    found: dict[str, Example] = {}
    for folder in CODE:
        here: dict[str, Example] = {}
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.relative_to(ROOT).parts[:2] in (("poise", "nodes"), ("poise", "fake_robots")):
                continue
            for name, example in _uses(path, folder):
                if name not in here or example.length < here[name].length:
                    here[name] = example
        found = here | found
    return found


def _uses(path: Path, folder: str) -> Iterator[tuple[str, Example]]:
    """What the functions and statements of a file use, found by words: parsing all files would take seconds."""
    text = path.read_text(encoding="utf-8")
    if "poise" not in text:
        return
    lines = text.splitlines()
    imported = _imported(path, text, folder == "poise")
    for first, last, name in (*_blocks(lines, ""), *_blocks(lines, "    ")):
        example = Example(path.relative_to(ROOT), first, last)
        if example.length > LONGEST_EXAMPLE or (folder == "test" and name and not name.startswith("test")):
            continue
        words = set(re.findall(r"[\w.]+", "\n".join(lines[first - 1 : last])))
        words |= {part for word in words for part in word.split(".")}
        yield from ((imported[word], example) for word in words & imported.keys() if word != name)


def _blocks(lines: list[str], indent: str) -> Iterator[tuple[int, int, str]]:
    """First and last line, and the name, of the functions, classes and assignments at an indentation."""
    statements = "" if indent else r"|\w+(?:: [^=]+)? = |\w[\w.]*\("
    start = re.compile(rf"{indent}(?:@|(?:def|class) (\w+){statements})")
    ends = re.compile(rf"{indent}\S|\S" if indent else r"[\w@\"'#]")
    at = 0
    while at < len(lines):
        if not start.match(lines[at]):
            at += 1
            continue
        first = at
        while lines[at].startswith(f"{indent}@") and at + 1 < len(lines):
            at += 1
        name = start.match(lines[at])
        last = at + 1
        while last < len(lines) and not ends.match(lines[last]):
            last += 1
        if last < len(lines) and re.match(rf"{indent}[\)\]\}}]", lines[last]):  # the end of a call over several lines
            last += 1
        while not lines[last - 1].strip():
            last -= 1
        yield first + 1, last, (name[1] or "") if name else ""
        at = last


def _imported(path: Path, text: str, own: bool) -> dict[str, str]:
    """The public names that a file imports or, in the package, defines: `room.name` by the word that it uses."""
    imported = {f"poise.{name}": f"poise.{name}" for name in faces()["poise"]}
    for module, names in re.findall(r"^\s*from (poise[\w.]*) import (\([^)]*\)|[^\n(]+)$", text, re.M):
        for name, _, other in re.findall(r"(\w+)( as (\w+))?", names):
            if home := _exported(module, name):
                imported[other or name] = home
    if own:
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        names = re.findall(r"^(?:def |class |)(\w+)(?=\(|:| = )", text, re.M)
        imported |= {name: home for name in names if (home := _exported(module, name))}
    return imported


def _defined_by(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return [target.id for target in targets if isinstance(target, ast.Name)]


@cache
def _exported(module: str, name: str) -> str:
    """`room.name` of a name of a module: of the room itself, or of the room around the file that defines it."""
    while module:
        if name in faces().get(module, ()):
            return f"{module}.{name}"
        module = module.rpartition(".")[0]
    return ""


def has_example(each: PublicName) -> bool:
    """Whether its docstring or the code shows how a name is used."""
    return ">>>" in (inspect.getdoc(each.value) or "") or example_of(each) is not None


def example_of(each: PublicName) -> Example | None:
    """The example of a name under any of the rooms that export it."""
    found = [examples().get(f"{room}.{each.name}") for room in (each.face, *each.also)]
    known = [example for example in found if example is not None]
    return min(known, key=lambda example: (CODE.index(example.path.parts[0]), example.length), default=None)


# -- pages --------------------------------------------------------------------------------------------------------


def python_pages() -> dict[str, str]:
    """A page in reStructuredText for each room: what it documents, and links to what its inner rooms do."""
    pages, inner = {}, _documented_inside()
    for face in faces():
        parts = [f"{face}\n{'=' * len(face)}\n", plain(inspect.getdoc(importlib.import_module(face)) or ""), ""]
        if inner[face]:
            parts += ["Documented with the room that each name comes from:", ""]
            parts += [f"- :py:obj:`{each.name} <{each.face}.{each.name}>` ({each.face})" for each in inner[face]]
            parts.append("")
        parts += [_entry(each) for each in public_names().get(face, ())]
        pages[f"python/{face}.rst"] = "\n".join(parts)
    rows = "\n".join(f"   {face}" for face in faces())
    title = "Python\n======\n"
    text = "Each room of the package is a page; `import poise` has one function for each job."
    pages["python/index.rst"] = f"{title}\n{text}\n\n.. toctree::\n   :maxdepth: 1\n\n{rows}\n"
    return pages


def _documented_inside() -> dict[str, list[PublicName]]:
    """The names of each room that another one documents."""
    found: dict[str, list[PublicName]] = {face: [] for face in faces()}
    for names in public_names().values():
        for each in names:
            for room in each.also:
                found[room].append(each)
    return {face: sorted(names, key=lambda each: each.name.lower()) for face, names in found.items()}


def _entry(each: PublicName) -> str:
    path = f"{each.face}.{each.name}"
    if each.kind == "data":
        text = " ".join(_comment_of(each).split()) or repr(each.value)[:120]
        lines = [f".. py:data:: {path}", "", f"   {plain(text)}", ""]
    else:
        lines = [f".. {each.kind}:: {path}", *(["   :members:", ""] if each.kind == "autoclass" else [""])]
    if each.also:
        lines += ["   Also in " + ", ".join(f"``{room}``" for room in each.also) + ".", ""]
    if example := example_of(each):
        lines += [
            f"   .. dropdown:: Example: {example.path}",
            "",
            f"      .. literalinclude:: /../{example.path}",
            "         :language: python",
            f"         :lines: {example.first}-{example.last}",
            "",
        ]
    return "\n".join(lines)


def _comment_of(each: PublicName) -> str:
    """The text below the assignment of a constant, in the files of its room."""
    folder = ROOT.joinpath(*each.face.split("."))
    for path in sorted(folder.rglob("*.py")):
        if not re.search(rf"^{each.name}\b", path.read_text(encoding="utf-8"), re.M):
            continue
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for node, after in pairwise(body):
            if each.name in _defined_by(node) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                return str(after.value.value)
    return ""


def command_pages() -> dict[str, str]:
    """The help of every subcommand, as a page in Markdown."""
    from poise.cli import COMMANDS, load_command

    pages, names = {}, []
    for name in COMMANDS:
        command = load_command(name)
        text = inspect.cleandoc(command.help or "")
        arguments = " ".join(
            getattr(option, "metavar", None) or option.name.upper()
            for option in command.params
            if option.param_type_name == "argument"
        )
        rows = [
            f"| {_cell(', '.join((*option.opts, *option.secondary_opts)))} | {_cell(option.metavar or '')} |"
            f" {option.help or ''} |".replace("\n", " ")
            for option in command.params
            if option.param_type_name == "option" and option.name != "help"
        ]
        usage = f"```sh\npoise {name} [OPTIONS] {arguments}\n```"
        text = re.sub(r"^Example:  (.*)$", r"Example:\n```sh\n\1\n```", text, flags=re.M)
        table = "\n".join(["| option | value | |", "| --- | --- | --- |", *rows])
        pages[f"commands/{name}.md"] = f"# poise {name}\n{usage}\n\n{text}\n\n{table}\n"
        names.append(name)
    listed = "\n".join(names)
    intro = (
        "Every subcommand takes `--json FILE` where it has an answer. Exit status: 0 done, 2 bad input, 3 no answer,"
    )
    pages["commands/index.md"] = (
        f"# Command line\n{intro} 1 an internal error.\n\n:::{{toctree}}\n:maxdepth: 1\n\n{listed}\n:::\n"
    )
    return pages


def _cell(text: str) -> str:
    return f"`{text.replace('|', '/')}`" if text else ""


def included_pages() -> dict[str, str]:
    """The interfaces and the parameters of nodes, as they are in their files."""
    interfaces = ["# Messages, services and actions", "The package poise_msgs."]
    for folder in ("msg", "srv", "action"):
        for path in sorted((ROOT / "msg_defs" / folder).glob(f"*.{folder}")):
            interfaces += [f"## {path.stem} ({folder})", f"```text\n{path.read_text()}```"]
    parameters = [
        "# Parameters of the nodes",
        "The files of config/, with the meaning and the default of each parameter.",
    ]
    for path in sorted((ROOT / "config").glob("*.yaml")):
        parameters += [f"## {path.name}", f"```yaml\n{path.read_text()}```"]
    return {"interfaces.md": "\n\n".join(interfaces) + "\n", "parameters.md": "\n\n".join(parameters) + "\n"}


def write_pages(folder: Path) -> None:
    """Write all pages; files that stay the same are left alone, so that Sphinx does not read them again."""
    pages = python_pages() | command_pages() | included_pages()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in folder.rglob("*.*"):
        if str(path.relative_to(folder)) not in pages:
            path.unlink()


# -- docstrings ---------------------------------------------------------------------------------------------------


def plain(text: str) -> str:
    """A docstring in the Markdown of this project as reStructuredText: code spans, and no accidental markup."""
    pieces = re.split(r"(``.*?``|`[^`\n]+`)", text)
    for at, piece in enumerate(pieces):
        if piece.startswith("``"):
            continue
        if piece.startswith("`"):
            pieces[at] = f"``{piece.strip('`')}``"
        else:
            pieces[at] = re.sub(r"([*|])|(?<=\w)_(?=\W|$)", lambda match: "\\" + match[0], piece)
    return "".join(pieces)


def _convert(app: object, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """For autodoc: make the lines of a docstring reStructuredText, except those of doctests."""
    lines[:] = [line if line.lstrip().startswith((">>>", "...")) else plain(line) for line in lines]


def connect(app: Any, folder: Path, elsewhere: dict[str, str]) -> None:
    """Write the pages; while Sphinx builds, convert docstrings and lead links to files outside of docs/ to their pages.

    Args:
        app: of Sphinx.
        folder: for the pages.
        elsewhere: page of the site by file below the root.
    """

    def lead(app: object, name: str, source: list[str]) -> None:
        for path, page in elsewhere.items():
            source[0] = re.sub(rf"\]\((?:\.\./)+{re.escape(path)}", f"](/{page}", source[0])

    write_pages(folder)
    app.connect("source-read", lead)
    app.connect("autodoc-process-docstring", _convert, priority=400)  # before napoleon


if __name__ == "__main__":
    sys.exit(write_pages(Path(sys.argv[1])))
