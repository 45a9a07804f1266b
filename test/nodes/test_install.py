"""Both installs, pip's and colcon's, put things where `ros2 run`, `ros2 launch` and rosidl look for them."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ament_index_python import get_package_share_directory, get_packages_with_prefixes, get_resource

from poise.errors import ErrorCode
from poise_msgs.msg import ErrorCode as ErrorCodeMessage

ROOT = Path(__file__).resolve().parents[2]
NODES = ("fake_robot", "ft_driver", "inertial_estimator")


@pytest.fixture(autouse=True)
def _index_of_this_environment(monkeypatch: pytest.MonkeyPatch, node_environment: dict[str, str]) -> None:
    """As after `export AMENT_PREFIX_PATH=$VIRTUAL_ENV`, also where the shell has not said so."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", node_environment["AMENT_PREFIX_PATH"])


def executables_of(prefix: Path) -> list[str]:
    """What `ros2 run poise` would offer: files one may execute in <prefix>/lib/poise."""
    return sorted(file.name for file in (prefix / "lib" / "poise").iterdir() if os.access(file, os.X_OK))


def starts_and_stops(command: list[str], environment: dict[str, str], graph: Any, log: Path) -> None:
    """Start a node, wait until the graph shows it, Ctrl-C it, and see it leave cleanly."""
    with log.open("w") as sink:
        node = subprocess.Popen(command, env=environment, stdout=sink, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        graph.wait_for(
            lambda: node.poll() is not None or "inertial_estimator" in graph.node.get_node_names(), what=log.read_text()
        )
        os.killpg(node.pid, signal.SIGINT)
        assert node.wait(20) == 0, log.read_text()
    finally:
        if node.poll() is None:
            os.killpg(node.pid, signal.SIGKILL)


def test_error_codes_are_the_same_numbers_in_python_and_in_the_interface() -> None:
    constants = {name: getattr(ErrorCodeMessage, name) for name in dir(ErrorCodeMessage) if name.isupper()}
    numbers = {name: value for name, value in constants.items() if isinstance(value, int)}
    assert numbers == {code.name: code.value for code in ErrorCode}


def test_the_index_knows_both_packages() -> None:
    packages = get_packages_with_prefixes()
    assert {"poise", "poise_msgs", "tf2_msgs", "control_msgs"} <= set(packages)
    assert get_resource("packages", "poise")[1] == packages["poise"]


def test_every_node_is_where_ros2_run_looks() -> None:
    assert set(NODES) <= set(executables_of(Path(get_packages_with_prefixes()["poise"])))


def test_launch_files_parameters_and_bags_are_shared() -> None:
    share = Path(get_package_share_directory("poise"))
    for node in NODES:
        assert (share / "launch" / f"{node}.launch.py").is_file()
        assert list((share / "config").glob(f"{node}*.yaml"))
    assert (share / "package.xml").is_file()
    assert (share / "bags" / "manifest.yaml").is_file()
    assert (share / "scenes" / "tray.yaml").is_file()
    assert (share / "scenes" / "placement" / "cube.yaml").is_file()


def test_a_pip_installed_node_runs_as_ros2_run_would_start_it(
    node_environment: dict[str, str], graph: Any, tmp_path: Path
) -> None:
    shim = Path(get_packages_with_prefixes()["poise"]) / "lib" / "poise" / "inertial_estimator"
    starts_and_stops([str(shim)], node_environment, graph, tmp_path / "node.log")


def test_poise_run_starts_a_node_without_ros2cli(node_environment: dict[str, str], graph: Any, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "poise.cli", "run", "inertial_estimator", "--ros-args", "-p", "gravity:=9.81"]
    starts_and_stops(command, node_environment, graph, tmp_path / "node.log")


@pytest.mark.slow
@pytest.mark.timeout(900)  # two builds, on machines that do other things
def test_colcon_builds_it_and_ros2_run_would_find_it(
    tmp_path: Path, node_environment: dict[str, str], graph: Any
) -> None:
    bin_folder = Path(sys.prefix) / "bin"
    environment = node_environment | {
        "PATH": f"{bin_folder}:{os.environ['PATH']}",
        "CMAKE_PREFIX_PATH": sys.prefix,
        "COLCON_DEFAULTS_FILE": str(ROOT / "colcon_defaults.yaml"),
        "MAKEFLAGS": "-j2",  # colcon would also wait for a load below the number of cores, which the other tests make
    }
    environment.pop("PYTHONPATH", None)
    # Most of the time would go into optimising the kernels, whose speed nothing here depends on.
    compiler = tmp_path / "cc"
    compiler.write_text('#!/bin/sh\nexec cc "$@" -O0\n')
    compiler.chmod(0o755)
    environment["CC"] = str(compiler)
    # Both installs have the same build folder: the type support is compiled once.
    for kind, options in (("copied", []), ("symlinked", ["--symlink-install", "--cmake-force-configure"])):
        install = tmp_path / kind
        for python in ("poise", "poise_msgs/ament_cmake_python"):  # neither goes from copies to links
            shutil.rmtree(tmp_path / "build" / python, ignore_errors=True)
        colcon_build(tmp_path, install, options, environment)
        assert set(NODES) <= set(executables_of(install / "poise"))
        assert (install / "poise/share/poise/launch/ft_driver.launch.py").is_symlink() == (kind == "symlinked")
        shell = f". {install}/setup.bash && exec "
        command = ["bash", "-c", f"{shell} {install}/poise/lib/poise/inertial_estimator"]
        starts_and_stops(command, environment, graph, tmp_path / f"{kind}.log")
        # And it was this install that ran, not the one in the virtual environment.
        print_files = "import poise.nodes.runtime as m, poise_msgs as n; print(m.__file__, n.__file__)"
        where = ["bash", "-c", f"{shell} {sys.executable} -c '{print_files}'"]
        runs = subprocess.run(where, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path)
        nodes, messages = (Path(file).resolve() for file in runs.stdout.split())
        assert nodes.is_relative_to(install if kind == "copied" else ROOT)
        assert messages.is_relative_to(install if kind == "copied" else tmp_path / "build")


def colcon_build(folder: Path, install: Path, options: list[str], environment: dict[str, str]) -> None:
    """Build both packages into an install folder."""
    build = [
        *(Path(sys.prefix) / "bin" / "colcon", "--log-base", folder / "log", "build", "--build-base", folder / "build"),
        *("--install-base", install, *options),
        # What a system with /opt/ros/jazzy does not need: see the file.
        *("--cmake-args", f"-DCMAKE_PROJECT_poise_msgs_INCLUDE={ROOT / 'msg_defs/cmake/pypi_wheels.cmake'}"),
        f"-DPython3_EXECUTABLE={sys.executable}",
    ]
    built = subprocess.run(build, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
