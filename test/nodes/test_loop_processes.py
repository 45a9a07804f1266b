"""Processes of a loop: what ends is started again, but for what must not be, and all end with it."""

import signal
from pathlib import Path

import pytest

from poise.errors import ErrorCode
from poise.nodes import loop_processes
from poise.nodes.loop_processes import NodeProcesses
from poise.nodes.loop_sequence import LoopOverError


@pytest.fixture
def processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two programs that wait for a signal; `robot` must not be started again."""
    program = tmp_path / "program"
    program.write_text('#!/bin/sh\necho "$@"\nexec sleep 1000\n')
    program.chmod(0o755)
    monkeypatch.setattr(loop_processes, "_executable", lambda name: program)
    files = [Path("common.yaml")]
    started = NodeProcesses(["robot", "node"], files, tmp_path, keep=["robot"], extra={"node": {"rate": 2}})
    started.start()
    yield started
    started.stop()


def ended(processes: NodeProcesses, name: str) -> None:
    process = processes.process_of(name)
    assert process is not None
    process.send_signal(signal.SIGKILL)
    process.wait(30)


def test_a_node_that_ends_is_started_again_and_named_once(processes: NodeProcesses) -> None:
    assert processes.check() == []
    ended(processes, "node")
    assert processes.check() == ["node"]
    assert processes.check() == []
    assert processes.starts == {"robot": 1, "node": 2}
    again = processes.process_of("node")
    assert again is not None
    assert list(again.args)[-5:] == ["--ros-args", "--params-file", "common.yaml", "-p", "rate:=2"]


def test_what_must_not_be_started_again_and_what_ends_too_often_is_an_error(processes: NodeProcesses) -> None:
    for _ in range(4):
        ended(processes, "node")
        assert processes.check() == ["node"]
    ended(processes, "node")
    ended(processes, "robot")
    for name in ("robot", "node"):
        with pytest.raises(LoopOverError, match=f"{name} has ended") as error:
            processes.check()
        assert error.value.code is ErrorCode.TOPIC_MISSING


def test_all_end_with_the_loop(processes: NodeProcesses) -> None:
    running = [processes.process_of(name) for name in ("robot", "node")]
    processes.stop()
    assert all(process is not None and process.poll() is not None for process in running)
