"""Workers: stopped at the deadline whatever they compute, started again at once, gone with their owner."""

import os
import signal
import subprocess
import sys
import time

import pytest

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.nodes.workers import Worker, WorkerTemplate

SOON = 60.0
MEMORY = 500_000_000


def made(greeting):
    """What a worker of these tests answers."""

    def answer(header, messages):
        if "sleep" in header:
            time.sleep(header["sleep"])
        if "die" in header:
            os.kill(os.getpid(), signal.SIGKILL)
        if "bytes" in header:
            try:
                return {"size": len(bytearray(header["bytes"]))}, []
            except MemoryError:
                return {"size": -1}, []
        return {"greeting": greeting, "pid": os.getpid()}, [message[::-1] for message in messages]

    return answer


@pytest.fixture(scope="module")
def template():
    return WorkerTemplate(made)


@pytest.fixture
def worker(template):
    worker = Worker(template, ["hello"], MEMORY)
    yield worker
    worker.stop()


def ask(worker, messages=(), seconds=SOON, **header):
    return worker.ask(header, messages, time.monotonic() + seconds)


def test_exchanges_of_any_size_go_to_one_process_that_stays(worker):
    first, _ = ask(worker)
    answer, messages = ask(worker, [b"abc", b"", b"x" * 3_000_000])
    assert (answer["greeting"], answer["pid"]) == ("hello", first["pid"])
    assert [messages[0], messages[1], len(messages[2])] == [b"cba", b"", 3_000_000]


def test_what_is_late_is_stopped_and_the_next_exchange_finds_a_new_process(worker):
    before = ask(worker)[0]["pid"]
    worker.state["version"] = 7
    with pytest.raises(NoAnswerError) as raised:
        ask(worker, seconds=0.1, sleep=100)
    assert raised.value.code == ErrorCode.DEADLINE
    assert worker.state == {}
    assert ask(worker)[0]["pid"] != before
    with pytest.raises(ProcessLookupError):
        os.kill(before, 0)


def test_a_process_that_ends_is_an_error_of_its_call_alone(worker):
    with pytest.raises(PoiseError) as raised:
        ask(worker, die=True)
    assert raised.value.code == ErrorCode.INTERNAL
    os.kill(ask(worker)[0]["pid"], signal.SIGKILL)  # between two calls
    time.sleep(0.2)
    worker.start()
    assert ask(worker)[0]["greeting"] == "hello"
    assert worker.starts == 3


def test_memory_is_bounded(worker):
    assert ask(worker, bytes=MEMORY // 4)[0]["size"] == MEMORY // 4
    assert ask(worker, bytes=2 * MEMORY)[0]["size"] == -1


OWNER = """
import os, signal, sys, time
sys.path.insert(0, {folder!r})
from test_workers import Worker, WorkerTemplate, made
worker = Worker(WorkerTemplate(made), [""], 500_000_000)
print(worker.ask({{}}, [], time.monotonic() + 60)[0]["pid"], flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_owner_leaves_no_process(request):
    script = OWNER.format(folder=str(request.path.parent))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    process = int(done.stdout)
    until = time.monotonic() + SOON
    while time.monotonic() < until and _runs(process):
        time.sleep(0.05)
    assert not _runs(process)


def _runs(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
