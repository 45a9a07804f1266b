"""Jobs: calls that wait are bounded, and what was answered does not wait."""

import threading
import time

import pytest

from poise.nodes.jobs import Jobs, Task
from poise_msgs.srv import AssessRobustness


class StubNode:
    """Takes services and timers; a call is made by `receive`."""

    def create_timer(self, *_, **__):
        return None

    def create_guard_condition(self, *_):
        return threading.Event()

    def create_service(self, kind, name, receive, **_):
        self.receive = receive
        return type("Service", (), {"send_response": None})()


@pytest.mark.parametrize(("most_heavy", "most_bytes"), [(3, 1e9), (1000, 300)])
def test_calls_that_were_answered_keep_no_place_and_no_bytes(most_heavy, most_bytes):
    node, release, running = StubNode(), threading.Event(), threading.Event()
    jobs = Jobs(node, 1000, most_heavy, 2, most_bytes)

    def work(*_):
        running.set()
        release.wait()

    jobs.serve(AssessRobustness, "assess", lambda _: Task(work, heavy=True, size=100), lambda seconds: seconds)
    assert not node.receive(1000.0, None).done()  # the long one
    assert running.wait()
    waiting = [node.receive(-1.0, None) for _ in range(3)]
    assert node.receive(1000.0, None).result().error.code == 3  # BUSY
    assert not any(answer.done() for answer in waiting)
    jobs._answer_overdue()
    assert [answer.result().error.code for answer in waiting] == [4, 4, 4]  # DEADLINE
    assert jobs.state["waiting_heavy"] == 0
    after = [node.receive(1000.0, None) for _ in range(3)]
    assert not any(answer.done() for answer in after)
    release.set()
    until = time.monotonic() + 60.0
    while not all(answer.done() for answer in after) and time.monotonic() < until:
        time.sleep(0.01)
    assert all(answer.done() for answer in after)
    jobs.close()


def test_a_call_wakes_the_one_thread_that_takes_it():
    node, woken, took = StubNode(), [], []
    jobs = Jobs(node, 10, threads=3)
    until = time.monotonic() + 60.0
    while not all(awake._waiters for awake in jobs._awake) and time.monotonic() < until:
        time.sleep(0.01)  # a thread that has not begun to wait needs no waking
    for number, awake in enumerate(jobs._awake):
        awake.notify = lambda number=number, notify=awake.notify: (woken.append(number), notify())
    jobs.serve(AssessRobustness, "assess", lambda heavy: Task(lambda _, thread: thread, heavy), lambda _: 1000.0)
    for heavy in (False, True):
        took.append(node.receive(heavy, None).result(60.0))
        until = time.monotonic() + 60.0
        while jobs.state["running"] and time.monotonic() < until:
            time.sleep(0.01)
    jobs.close()
    assert took == [0, 1]
    assert woken[:2] == [0, 1]
    assert woken.count(2) == 1  # only by close
