"""The launch files: each starts its node with a parameter file that exists. `launch` is replaced by recorders."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted(set((ROOT / "launch").glob("*.launch.py")) - {ROOT / "launch" / "loop.launch.py"})
NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "OpaqueFunction", "Shutdown"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["LifecycleNode", "Node"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


class Recorder:
    """Keeps the arguments of its making."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments, self.named = arguments, named


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, kinds in NAMES.items():
        module = ModuleType(name)
        for kind in kinds:
            setattr(module, kind, type(kind, (Recorder,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "poise.nodes.launching", raising=False)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
@pytest.mark.usefixtures("launch")
def test_a_launch_file_starts_its_node_with_a_parameter_file_that_exists(path: Path) -> None:
    name = path.name.partition(".")[0]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (*arguments, node) = module.generate_launch_description().arguments[0]
    sys.modules.pop("poise.nodes.launching")
    declared = {argument.arguments[0]: argument.named["default_value"] for argument in arguments}
    assert type(node).__name__ == ("LifecycleNode" if name in ("ft_driver", "gripper_driver") else "Node")
    assert node.named["executable"] == node.named["name"] == name
    package, folder, file = declared["params_file"].arguments[0]
    assert (package.arguments, folder) == (("poise",), "config")
    assert (ROOT / folder / file).is_file()
    remapped = {argument.arguments[0] for _, argument in node.named["remappings"]}
    given = {key for values in node.named["parameters"] if isinstance(values, dict) for key in values}
    assert set(declared) == {"namespace", "params_file"} | remapped | given


@pytest.mark.usefixtures("launch")
def test_the_loop_starts_all_its_nodes_which_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("loop", ROOT / "launch" / "loop.launch.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (*arguments, nodes) = module.generate_launch_description().arguments[0]
    given = {argument.arguments[0]: argument.named["default_value"] for argument in arguments} | {"objects": "1"}

    class Given(Recorder):
        def perform(self, context: dict[str, str]) -> str:
            return context[self.arguments[0]]

    monkeypatch.setattr(module, "LaunchConfiguration", Given)
    started = {node.named["executable"]: node.named for node in nodes.named["function"](given)}
    assert started.keys() == {*module.NODES, "loop"}
    assert {name for name, named in started.items() if not named.get("respawn")} == {"fake_robot", "loop"}
    assert (ROOT / "config" / Path(started["loop"]["parameters"][0]).name).is_file()
    for name, parameter in (("fake_robot", "world"), ("world_model", "scene")):
        assert Path(started[name]["parameters"][1][parameter]).is_file()
    ended = started["world_model"]["on_exit"]
    monkeypatch.setattr(module.time, "monotonic", iter([0.0, 30.0, 40.0, 50.0, 61.0, 62.0]).__next__)
    assert [ended(None, None) is None for _ in range(6)] == [True] * 5 + [False]
