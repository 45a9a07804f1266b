"""Responses whose client DDS has not matched yet are sent again; a warning of rclpy is all that says so."""

import threading
import warnings

import pytest

pytest.importorskip("rclpy")

from rclpy._rclpy_pybind11 import ActionServer, Service

from poise.nodes import responses
from poise.nodes.responses import send_responses_again, until_matched

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def _listening(monkeypatch: pytest.MonkeyPatch):
    with warnings.catch_warnings():
        monkeypatch.setattr(responses, "_SPACING", 0.0)
        monkeypatch.setattr(responses.rclpy, "ok", lambda: True)
        send_responses_again()
        yield


class Middleware:
    """Does not know the client for some attempts."""

    def __init__(self, unmatched: int) -> None:
        self.unmatched, self.sent, self.attempts = unmatched, threading.Event(), 0

    def send(self, response: str, header: int) -> None:
        self.attempts += 1
        if self.attempts <= self.unmatched:
            warnings.warn("failed to send response (timeout): client will not receive response", RuntimeWarning, 1)
        else:
            self.response = response, header
            self.sent.set()


@pytest.mark.parametrize("unmatched", [0, 1, 5])
def test_a_response_is_sent_once_its_client_is_matched(unmatched: int) -> None:
    middleware = Middleware(unmatched)
    until_matched(middleware.send)("yes", 7)
    assert middleware.sent.wait(10.0)
    assert middleware.response == ("yes", 7)
    assert middleware.attempts == unmatched + 1


def test_attempts_end_and_the_log_says_so(capfd: pytest.CaptureFixture[str]) -> None:
    middleware = Middleware(10**9)
    until_matched(middleware.send)("yes", 7)
    for thread in threading.enumerate():
        if thread.name == "response":
            thread.join(10.0)
    assert middleware.attempts == 1 + responses._ATTEMPTS
    assert "its client was not found" in capfd.readouterr().err


def test_a_send_that_fails_raises_at_once() -> None:
    def send() -> None:
        raise TypeError("no message")

    with pytest.raises(TypeError):
        until_matched(send)()


def test_other_warnings_are_shown_and_all_responses_of_rclpy_are_covered() -> None:
    with pytest.warns(UserWarning, match="something else"):
        warnings.warn("something else", UserWarning, 1)
    senders = {name for name in dir(ActionServer) if name.startswith("send_")}
    assert senders == {"send_goal_response", "send_cancel_response", "send_result_response"}
    assert all(hasattr(getattr(ActionServer, name), "sends_again") for name in senders)
    assert hasattr(Service.service_send_response, "sends_again")
