"""Workers: stopped at the deadline whatever they compute, started again at once, gone with their owner."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.memory import release_memory
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
    before = ask(worker)[0]["pid"]
    os.kill(before, signal.SIGKILL)  # between two calls
    due = time.monotonic() + SOON
    with contextlib.suppress(ProcessLookupError):  # until it has ended
        while time.monotonic() < due:
            os.kill(before, 0)
            time.sleep(0.01)
    assert ask(worker)[0]["greeting"] == "hello"
    assert worker.starts == 3


def test_memory_is_bounded(worker):
    assert ask(worker, bytes=MEMORY // 4)[0]["size"] == MEMORY // 4
    assert ask(worker, bytes=2 * MEMORY)[0]["size"] == -1


def test_what_the_owner_has_freed_is_no_room_beyond_the_bound() -> None:
    """In a process of its own: it keeps freed memory until it ends."""
    code = (
        "import numpy as np, test_workers as tests; from poise.memory import keep_freed_memory\n"
        "keep_freed_memory()\n"
        "freed = np.empty(tests.MEMORY // 2); del freed\n"
        "worker = tests.Worker(tests.WorkerTemplate(tests.made), ['hello'], tests.MEMORY)\n"
        "print(tests.ask(worker, bytes=2 * tests.MEMORY)[0]['size'])\n"
        "worker.stop()\n"
    )
    here = Path(__file__).parent
    said = subprocess.check_output([sys.executable, "-c", code], cwd=here, text=True, timeout=SOON)
    assert said.split() == ["-1"]


def in_time(work):
    """What `work` raises; a failure when it never returns."""
    raised = []

    def run():
        try:
            work()
        except PoiseError as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(SOON)
    assert not thread.is_alive()
    return raised[0]


def test_a_process_that_reads_nothing_does_not_hold_its_owner(worker):
    before = ask(worker)[0]["pid"]
    os.kill(before, signal.SIGSTOP)
    error = in_time(lambda: ask(worker, [b"x" * 30_000_000], seconds=0.2))
    assert (error.code, error.data["stopped"]) == (ErrorCode.DEADLINE, True)
    assert ask(worker)[0]["pid"] != before


def test_a_start_ends_with_the_deadline_of_its_call_and_goes_on_for_the_next(tmp_path):
    worker = Worker(WorkerTemplate(made_slowly), [str(tmp_path / "go")], MEMORY)
    for _ in range(2):
        error = in_time(lambda: ask(worker, seconds=0.1))
        assert (error.code, error.data["stopped"]) == (ErrorCode.DEADLINE, False)
    (tmp_path / "go").touch()
    assert ask(worker)[0]["pid"]
    assert worker.starts == 1
    worker.stop()


def made_slowly(path):
    """A worker that starts when a file is there."""
    while not Path(path).exists():
        time.sleep(0.01)
    return made("slow")


def test_a_template_that_hangs_does_not_hold_its_owner(monkeypatch):
    forked, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    worker = Worker(WorkerTemplate(made), ["hello"], MEMORY)
    os.kill(forked[0], signal.SIGSTOP)
    for _ in range(2):
        assert in_time(lambda: ask(worker, seconds=0.1)).code == ErrorCode.DEADLINE
    os.kill(forked[0], signal.SIGCONT)
    process = ask(worker)[0]["pid"]  # of the third request, not of those that were given up
    worker.stop()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_a_call_that_is_late_already_leaves_the_process(worker):
    before = ask(worker)[0]["pid"]
    with pytest.raises(NoAnswerError):
        ask(worker, seconds=-1.0)
    assert ask(worker)[0]["pid"] == before


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


def test_freed_memory_between_kept_pieces_is_returned_to_the_system() -> None:
    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    pieces = [np.ones(8192) for _ in range(1500)]  # 64 KB each: smaller than what glibc maps by itself
    kept = pieces[::100]
    del pieces
    before = resident()
    release_memory()
    assert before - resident() > 50.0
    assert all(piece.sum() == 8192 for piece in kept)
