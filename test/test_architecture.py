"""Rules that the source keeps: who may import whom, what no file may do, how each file begins, names and wording."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tools.draw_architecture import PAGE, page
from tools.source_rules import imports_past_a_face, names_used_twice, private_wording

ROOT = Path(__file__).resolve().parents[1]
# Rooms with Python in them; poise/nodes and poise/fake_robots are links to the rooms of these names.
FOLDERS = ("poise", "nodes", "fake_robots", "launch", "msg_defs", "tools", "benchmarks", "docs", "test")
LINKS = ("nodes", "fake_robots")

# From the top to the bottom; an arrow may only point to its own level or below, and rooms never form a circle.
LEVELS = (
    {"cli", "commands", "api", "__init__", "__main__"},
    {"viewing"},
    {"manipulation", "baselines"},
    {"placement", "weighing", "mismatch", "excitation", "exporting", "world", "worlds", "calibration", "evaluation"},
    {"simulation"},
    {"assembly", "inertia", "scanning"},
    {"robot"},
    {"shape", "recording", "force_torque", "gripping"},
    {"geometry", "kernels", "keystore", "serial_bus"},
    {"types", "errors", "files", "ranges", "registry", "notebooks", "threads", "memory"},
)
SEPARATE = LEVELS[-3]  # these do not import one another

ROS = re.compile(
    r"rclpy|rpyutils|launch(_ros|_testing)?|ament_.*|rosidl_.*|rosbag2_.*|tf2_.*|.*_(msgs|interfaces|srvs)"
)
UNSAFE_MODULES = {"pickle", "cPickle", "dill", "shelve", "marshal", "joblib"}
UNSAFE_NAMES = {"eval", "exec"}
UNSAFE_YAML = {"load", "load_all", "unsafe_load", "unsafe_load_all", "full_load", "full_load_all"}
MAKES_NAMES = re.compile(
    r"create_(publisher|subscription|service|client)|Action(Server|Client)|create_lifecycle_publisher"
)

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 50

BLOCK_ROS = """
import importlib, re, sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if re.fullmatch(sys.argv[1], name.split(".")[0]):
            raise ModuleNotFoundError(f"blocked by the test: {name}", name=name)
sys.meta_path.insert(0, Blocked())
failed = []
for name in sys.argv[2:]:
    try:
        importlib.import_module(name)
    except Exception as error:
        failed.append(f"{name}: {type(error).__name__}: {error}")
print("\\n".join(failed + [f"loaded: {name}" for name in ("rerun", "rclpy") if name in sys.modules]))
"""


@cache
def source_files() -> tuple[Path, ...]:
    """Every Python file of the project, each once."""
    found = {ROOT / "setup.py"}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT).parts
            if "build" not in parts and not (parts[0] == "poise" and parts[1] in LINKS):
                found.add(path)
    return tuple(sorted(found))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def in_room(*folders: str) -> list[Path]:
    return [path for path in source_files() if path.relative_to(ROOT).parts[0] in folders]


def not_tests() -> list[Path]:
    return [path for path in source_files() if path.relative_to(ROOT).parts[0] != "test"]


def place(path: Path, node: ast.AST | None = None) -> str:
    line = f":{node.lineno}" if isinstance(node, ast.stmt | ast.expr) else ""
    return f"{path.relative_to(ROOT)}{line}"


def module_name(path: Path) -> str:
    """The dotted name that a file is imported by."""
    parts = list(path.relative_to(ROOT).with_suffix("").parts)
    if parts[0] in LINKS:
        parts.insert(0, "poise")
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def core_modules() -> dict[str, Path]:
    return {module_name(path): path for path in in_room("poise")}


def imports(path: Path, only_when_loaded: bool = False) -> Iterator[tuple[ast.stmt, str]]:
    """Every (statement, dotted name) that a file imports; optionally only what runs when the file is loaded."""
    package = module_name(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    statements = loaded_statements(tree(path).body) if only_when_loaded else ast.walk(tree(path))
    for node in statements:
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            yield from ((node, f"{module}.{alias.name}") for alias in node.names)


def loaded_statements(body: list[ast.stmt]) -> Iterator[ast.AST]:
    """Statements that run when a file is loaded: neither inside functions nor for type checkers only."""
    for node in body:
        yield node
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            yield from loaded_statements(node.orelse)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for inner in ("body", "orelse", "finalbody"):
                yield from loaded_statements(getattr(node, inner, []))
            for handler in getattr(node, "handlers", []):
                yield from loaded_statements(handler.body)


def core_target(name: str) -> str | None:
    """The core module that an imported dotted name is or lies in."""
    while name:
        if name in core_modules():
            return name
        name = name.rpartition(".")[0]
    return None


def room_of(module: str) -> str:
    """First part after poise: `inertia` of poise.inertia.regressor, `__init__` of poise itself."""
    return ([*module.split("."), "__init__"])[1]


def level_of(room: str) -> int:
    return next((index for index, rooms in enumerate(LEVELS) if room in rooms), -1)


def calls(path: Path) -> Iterator[tuple[ast.Call, str]]:
    """Every call with the last name of what is called."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Call):
            called = node.func
            yield node, called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")


def circle(graph: dict[str, set[str]]) -> list[str]:
    """A circle in a graph as the nodes along it; empty when there is none."""
    finished: set[str] = set()
    trail: list[str] = []

    def visit(node: str) -> list[str]:
        if node in trail:
            return [*trail[trail.index(node) :], node]
        if node in finished:
            return []
        trail.append(node)
        for neighbour in sorted(graph.get(node, ())):
            if found := visit(neighbour):
                return found
        finished.add(trail.pop())
        return []

    for start in sorted(graph):
        if found := visit(start):
            return found
    return []


def test_the_source_is_found() -> None:
    rooms = {path.relative_to(ROOT).parts[0] for path in source_files()}
    assert {"poise", "nodes", "test", "setup.py"} <= rooms
    assert "poise.errors" in core_modules()
    assert not any(part in LINKS for name in core_modules() for part in name.split("."))


def test_no_core_file_imports_ros_or_a_message_package() -> None:
    offenders = [
        f"{place(path, node)} imports {name}"
        for path in in_room("poise")
        for node, name in imports(path)
        if ROS.fullmatch(name.split(".")[0])
    ]
    assert not offenders, "\n".join(offenders)


def test_no_core_file_imports_nodes_or_fake_robots() -> None:
    offenders = [
        f"{place(path, node)} imports {name}"
        for path in in_room("poise")
        for node, name in imports(path)
        if name.split(".")[0] == "poise" and ([*name.split("."), ""])[1] in LINKS
    ]
    assert not offenders, "\n".join(offenders)


def test_every_core_room_has_a_level() -> None:
    unplaced = {room_of(name) for name in core_modules() if level_of(room_of(name)) < 0}
    assert not unplaced, f"add {sorted(unplaced)} to LEVELS, after agreeing where the arrows to them run"


def test_arrows_between_rooms_run_one_way() -> None:
    offenders = []
    for name, path in core_modules().items():
        for node, imported in imports(path):
            target = core_target(imported)
            if target is None or room_of(target) in (room_of(name), "__init__"):  # poise itself is lazy
                continue
            here, there = room_of(name), room_of(target)
            upwards = level_of(there) < level_of(here)
            sideways = here in SEPARATE and there in SEPARATE
            if upwards or sideways:
                offenders.append(f"{place(path, node)}: {here} imports {there}")
    assert not offenders, "\n".join(offenders)


def test_rooms_form_no_circle() -> None:
    graph: dict[str, set[str]] = {}
    for name, path in core_modules().items():
        targets = {room_of(target) for _, imported in imports(path) if (target := core_target(imported))}
        graph.setdefault(room_of(name), set()).update(targets - {room_of(name), "__init__"})
    assert not (found := circle(graph)), " -> ".join(found)


def test_files_form_no_import_circle() -> None:
    graph = {}
    for path in in_room("poise"):
        name = module_name(path)
        targets = {core_target(imported) for _, imported in imports(path, only_when_loaded=True)}
        graph[name] = {target for target in targets if target and target != name}
    assert not (found := circle(graph)), " -> ".join(found)


def test_a_circle_would_be_found() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_no_node_depends_on_the_viewer() -> None:
    offenders = [
        f"{place(path, node)} imports {name}"
        for path in in_room(*LINKS)
        for node, name in imports(path)
        if name.startswith("poise.viewing") or name.split(".")[0] in ("rerun", "matplotlib")
    ]
    assert not offenders, "\n".join(offenders)


def test_nothing_loads_rerun_before_it_is_needed() -> None:
    offenders = [
        f"{place(path, node)} imports {name}"
        for path in in_room("poise", *LINKS, "tools", "launch")
        for node, name in imports(path, only_when_loaded=True)
        if name.split(".")[0] == "rerun"
    ]
    assert not offenders, "\n".join(offenders)


def test_every_file_begins_with_a_line_that_says_what_lives_in_it() -> None:
    offenders = []
    for path in source_files():
        lines = path.read_text(encoding="utf-8").splitlines() or [""]
        first = lines[1] if lines[0].startswith("#!") and len(lines) > 1 else lines[0]
        if not re.match(r'(r?"""|# ?)[\w`].{15,}', first):
            offenders.append(f"{place(path)}: {first!r}")
    assert not offenders, "\n".join(offenders)


def test_no_topic_or_service_name_is_absolute() -> None:
    offenders = [
        f"{place(path, node)}: {argument.value}"
        for path in in_room(*LINKS)
        for node, name in calls(path)
        if MAKES_NAMES.fullmatch(name)
        for argument in [*node.args, *(keyword.value for keyword in node.keywords)]
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str) and argument.value.startswith("/")
    ]
    assert not offenders, "\n".join(offenders)


def test_nothing_can_turn_data_into_code() -> None:
    offenders = []
    for path in not_tests():
        for node, name in imports(path):
            if name.split(".")[0] in UNSAFE_MODULES:
                offenders.append(f"{place(path, node)} imports {name}")
        for node, name in calls(path):
            owner = node.func.value if isinstance(node.func, ast.Attribute) else None
            of_yaml = isinstance(owner, ast.Name) and owner.id == "yaml"
            bare = owner is None
            keywords = {keyword.arg for keyword in node.keywords if ast.dump(keyword.value) == "Constant(value=True)"}
            if (bare and name in UNSAFE_NAMES) or (of_yaml and name in UNSAFE_YAML):
                offenders.append(f"{place(path, node)} calls {name}")
            if keywords & {"allow_pickle", "shell"}:
                offenders.append(f"{place(path, node)} calls {name} with {', '.join(map(str, keywords))}")
    assert not offenders, "\n".join(offenders)


def test_assert_is_for_tests() -> None:
    offenders = [
        place(path, node) for path in not_tests() for node in ast.walk(tree(path)) if isinstance(node, ast.Assert)
    ]
    assert not offenders, "raise an InputError instead:\n" + "\n".join(offenders)


def test_a_file_holds_one_thing() -> None:
    lengths = {place(path): len(path.read_text(encoding="utf-8").splitlines()) for path in source_files()}
    offenders = [f"{name}: {length} lines" for name, length in lengths.items() if length > MAX_FILE_LINES]
    assert not offenders, f"longer than {MAX_FILE_LINES} lines:\n" + "\n".join(offenders)


def test_a_function_does_one_thing() -> None:
    offenders = [
        f"{place(path, node)} {node.name}: {length} lines"
        for path in not_tests()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (length := (node.end_lineno or node.lineno) - node.lineno + 1) > MAX_FUNCTION_LINES
    ]
    assert not offenders, f"longer than {MAX_FUNCTION_LINES} lines:\n" + "\n".join(offenders)


def test_rooms_import_from_faces_alone() -> None:
    assert not (offenders := imports_past_a_face()), "\n".join(offenders)


def test_no_two_public_classes_or_constants_share_a_name() -> None:
    assert not (offenders := names_used_twice()), "\n".join(offenders)


def test_the_wording_is_plain_engineering_english() -> None:
    assert not (offenders := private_wording()), "\n".join(offenders)


def test_the_picture_of_the_rooms_is_that_of_the_imports() -> None:
    assert page() == PAGE.read_text(encoding="utf-8"), "run python tools/draw_architecture.py"


def test_three_walks_through_the_rooms_have_at_most_eight_steps_and_name_files() -> None:
    walks = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.M)[1:]
    assert len(walks) == 3
    for walk in walks:
        steps = re.findall(r"^\d\. .*", walk, re.M)
        assert 4 <= len(steps) <= 8
        for step in steps:
            files = re.findall(r"`((?:poise|nodes)/[\w./]+)`", step)
            assert files, step
            assert all((ROOT / file).exists() for file in files), step


def test_the_core_loads_on_a_machine_without_ros() -> None:
    names = ["poise", *sorted(core_modules())]
    command = [sys.executable, "-c", BLOCK_ROS, ROS.pattern, *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stdout.strip(), done.stdout


@pytest.mark.parametrize(
    ("module", "not_loaded"),
    [("poise.cli", ("matplotlib", "jinja2", "rerun")), ("poise.commands.mismatch", ("scipy.stats", "poise.assembly"))],
)
def test_a_command_starts_without_libraries_that_it_rarely_uses(module: str, not_loaded: tuple[str, ...]) -> None:
    script = f"import sys, {module}; print(*(n for n in {not_loaded} if n in sys.modules))"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stdout.strip(), f"import these where they are used: {done.stdout}"
