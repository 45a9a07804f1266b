"""How a node is tested: started as `ros2 run` would start it, watched from a node of the test, alone in its domain."""

import fcntl
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import pytest
import yaml
from ament_index_python import get_package_prefix
from ros_graph import Graph, NodeProcess

DOMAINS = 102
"""Domain ids 0..101 keep clear of the ephemeral ports."""
TRANSPORT = {
    # By UDP, and found at once: see the file.
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).resolve().parents[2] / "config" / "localhost_udp.xml"),
}


def lock_domain(start: int) -> tuple[int, TextIO]:
    """Take the first ROS domain, from `start` on, that no other test on this machine holds."""
    for offset in range(DOMAINS):
        domain = (start + offset) % DOMAINS
        lock = Path(f"/tmp/poise-test-domain-{os.getuid()}-{domain}").open("w")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        return domain, lock
    raise RuntimeError("every ROS domain is taken by another test run")


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain of this test's own, also among parallel test runs."""
    number, lock = free_domain()
    yield number
    lock.close()


def free_domain() -> tuple[int, TextIO]:
    """A domain that no other test holds, and its lock."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    return lock_domain(int(os.environ.get("ROS_DOMAIN_ID", "0")) + worker)


@pytest.fixture
def graph(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A node in the test's domain, with waits that have deadlines."""
    for name, value in TRANSPORT.items():
        monkeypatch.setenv(name, value)
    graph = Graph(domain)
    yield graph
    graph.close()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Graph, Callable[..., NodeProcess]]]:
    """A graph, and what starts nodes in it, for all tests of a file that leave the nodes as they were."""
    number, lock = free_domain()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in TRANSPORT.items():
            patch.setenv(name, value)
        graph, folder = Graph(number), tmp_path_factory.mktemp("shared")
        with started(environment_of(number, folder), folder, patch) as start:
            yield graph, start
        graph.close()
    lock.close()


@pytest.fixture
def node_environment(domain: int, tmp_path: Path) -> dict[str, str]:
    """What a fresh shell would give the node, in this test's domain."""
    return environment_of(domain, tmp_path)


def environment_of(domain: int, folder: Path) -> dict[str, str]:
    """Variables of a node in a domain, with its logs in a folder."""
    environment = dict(os.environ)
    if environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None):  # the wheels' re-execution of this very process
        environment.pop("LD_LIBRARY_PATH", None)
    environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    environment |= TRANSPORT | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(folder / "log"),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }
    return environment


@pytest.fixture
def start_node(
    node_environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., NodeProcess]]:
    """Start lib/poise/NAME of the ament index: `start_node(name, params={}, remaps={}, arguments=[])`.

    Every node started is stopped after the test (Ctrl-C, then by force), and one that ignored Ctrl-C fails the test.
    """
    with started(node_environment, tmp_path, monkeypatch) as start:
        yield start


@contextmanager
def started(
    environment: dict[str, str], folder: Path, patch: pytest.MonkeyPatch
) -> Iterator[Callable[..., NodeProcess]]:
    """What starts nodes; at the end they are stopped."""
    patch.setenv("AMENT_PREFIX_PATH", environment["AMENT_PREFIX_PATH"])
    nodes: list[NodeProcess] = []

    def start(
        name: str,
        params: Mapping[str, Any] | None = None,
        remaps: Mapping[str, str] | None = None,
        arguments: list[str] | None = None,
    ) -> NodeProcess:
        command = [str(Path(get_package_prefix("poise")) / "lib" / "poise" / name), *(arguments or []), "--ros-args"]
        if params:
            file = folder / f"{name}-{len(nodes)}.yaml"
            file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(params)}}))
            command += ["--params-file", str(file)]
        for old, new in (remaps or {}).items():
            command += ["-r", f"{old}:={new}"]
        node = NodeProcess(command, environment, folder / f"{name}-{len(nodes)}.log")
        nodes.append(node)
        return node

    yield start
    for node in nodes:
        if node.process.poll() is None:
            node.send(signal.SIGINT)
    for node in nodes:
        try:
            node.stop()
        finally:
            print(f"--- {' '.join(node.process.args)}\n{node.output}")
