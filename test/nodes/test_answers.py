"""Answers of services: each is sent, also after one that could not be."""

import threading

import pytest

pytest.importorskip("rclpy")

from poise.nodes.answers import Answers

pytestmark = pytest.mark.ros


class LoggingNode:
    """Stands for a node: keeps what is logged."""

    def __init__(self) -> None:
        self.logged: list[str] = []

    def get_logger(self) -> "LoggingNode":
        return self

    def error(self, text: str, throttle_duration_sec: float = 0.0) -> None:
        self.logged.append(text)


def test_an_answer_that_cannot_be_sent_does_not_keep_back_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poise.nodes.answers.rclpy.ok", lambda: True)
    node = LoggingNode()
    answers = Answers(node, "answers under test")
    sent: list[int] = []
    done = threading.Event()

    def send(response: int, header: None) -> None:
        if response == 0:
            raise TypeError("no message")
        sent.append(response)
        done.set()

    for response in (0, 1):
        answers.put(send, response, None, crowded=False)
    assert done.wait(10.0)
    answers.close()
    assert sent == [1]
    assert len(node.logged) == 1
    assert "no message" in node.logged[0]


def test_a_thread_of_jobs_sends_its_answer_itself_and_an_executor_does_not() -> None:
    answers = Answers(LoggingNode(), "answers under test")
    senders: list[str] = []

    def put(crowded: bool) -> None:
        answers.put(lambda *_: senders.append(threading.current_thread().name), None, None, crowded)

    for crowded in (False, True):
        worker = threading.Thread(target=put, args=(crowded,), name="a job")
        worker.start()
        worker.join()
    put(False)
    answers.close()
    assert senders == ["a job", "answers under test", "answers under test"]
