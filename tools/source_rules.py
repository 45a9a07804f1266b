"""Rules for names, imports and wording that test_architecture.py enforces; run this file to list what breaks them.

python tools/source_rules.py [faces] [names] [wording]
"""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LINKS = ("nodes", "fake_robots")
"""Folders beside poise/ that are linked into it: the ROS side and the hardware in software."""

WORDING = {
    r"m[e]nd(s|ed|ing)?": "fix, repair",
    r"a[n]ew": "again",
    r"t[e]ll(s|ing)?": "distinguish, say, report",
    r"t[o]ld": "distinguished, reported",
    r"in e[a]rnest": "full",
    r"one and the s[a]me": "shared",
    r"beside the n[o]ise": "relative to the noise",
    r"at the d[o]or": "on input",
    r"some[b]ody|no[b]ody": "name who",
    r"any[h]ow": "leave it out, or name the case",
    r"what[e]ver (it|its|the)": "any",
    r"as [o]ften as": "with equal probability",
    r"as if from an en[e]my": "as untrusted input",
    r"slip of the f[i]nger": "typo",
    r"go(es)? a[s]tray": "fails",
    r"how s[u]re": "confidence",
    r"house r[u]les": "rules",
    r"where they p[a]rt|s[i]mulation part": "where they differ",
    r"what there is to s[a]y": "summary",
    r"dress(es|ed)? a s[o]lution": "convert",
    r"fault of o[u]rs": "internal error",
}
"""Private idiom -> the plain term; letters in brackets keep this table from matching itself."""
WORDS = re.compile(rf"\b(?:{'|'.join(WORDING)})\b", re.IGNORECASE)
REGISTERED = {"ENTRY", "CONTEXT_SETTINGS"}
"""Names that a registry, or the command line, looks for in each of its files."""
NOT_PROSE = re.compile(r"^(third_party/|LICENSE)|\.(png|svg|obj|stl|ply)$")


@cache
def tree(path: Path) -> ast.Module:
    """The parsed file."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@cache
def product_files() -> dict[str, Path]:
    """Dotted name -> file of everything in poise/, nodes/ and fake_robots/."""
    files = {}
    for folder in ("poise", *LINKS):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = list(path.relative_to(ROOT).with_suffix("").parts)
            if parts[0] == "poise" and parts[1] in LINKS:
                continue
            if parts[0] in LINKS:
                parts.insert(0, "poise")
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


def room_of(module: str) -> str:
    """The package that a module lies in: `poise.mismatch.effects` of poise.mismatch.effects.slip and of itself."""
    return module if product_files()[module].name == "__init__.py" else module.rpartition(".")[0]


@cache
def face(room: str) -> frozenset[str]:
    """The names in `__all__` of a room."""
    for node in tree(product_files()[room]).body:
        targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
        if any(isinstance(target, ast.Name) and target.id == "__all__" for target in targets):
            return frozenset(ast.literal_eval(node.value))  # type: ignore[attr-defined]
    return frozenset()


def imported_names(module: str) -> Iterator[tuple[int, str, str]]:
    """Every (line, module, name) of a `from ... import` in a file, and (line, module, "") of a plain import."""
    path = product_files()[module]
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *filter(None, [node.module])])
            yield from ((node.lineno, source, alias.name) for alias in node.names)


def imports_past_a_face() -> list[str]:
    """Imports of another room's names that its face does not list; top-level files such as poise.errors have none."""
    files = product_files()
    found = []
    for module, path in files.items():
        for line, source, name in imported_names(module):
            if source not in files or room_of(source) in ("poise", room_of(module)):
                continue
            if room_of(source).split(".")[1] in LINKS:
                continue
            is_face = files[source].name == "__init__.py"
            if not is_face or (name and name not in face(source)):
                found.append(f"{path.relative_to(ROOT)}:{line}: {name or source} past the face of {room_of(source)}")
    return found


def names_used_twice() -> list[str]:
    """Public classes, constants and aliases of one name that are defined in more than one file of poise/ and nodes/."""
    places = defaultdict(list)
    for path in product_files().values():
        if path.relative_to(ROOT).parts[0] == "fake_robots":
            continue
        for node in tree(path).body:
            targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
            names = [target.id for target in targets if isinstance(target, ast.Name)]
            if isinstance(node, ast.ClassDef):
                names = [node.name]
            for name in names:
                if name[0].isupper() and name not in REGISTERED:
                    places[name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    return [f"{name}: {', '.join(where)}" for name, where in sorted(places.items()) if len(where) > 1]


def private_wording() -> list[str]:
    """Words of the table above in the tracked files: code, help, errors, messages, tests and pages."""
    command = ["git", "ls-files", "-co", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    found = []
    for name in listed:
        if NOT_PROSE.search(name) or not (ROOT / name).is_file():
            continue
        content = (ROOT / name).read_bytes()
        lines = [] if b"\0" in content else content.decode("utf-8").splitlines()
        for number, line in enumerate(lines, start=1):
            found += [f"{name}:{number}: {hit[0]!r} in {line.strip()[:100]!r}" for hit in WORDS.finditer(line)]
    return found


CHECKS = {"faces": imports_past_a_face, "names": names_used_twice, "wording": private_wording}


def main(arguments: list[str]) -> int:
    """List the offenders of the named checks, or of all."""
    total = 0
    for name in arguments or CHECKS:
        offenders = CHECKS[name]()
        print(*offenders, f"{name}: {len(offenders)}", sep="\n")
        total += len(offenders)
    return min(total, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
