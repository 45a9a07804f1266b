"""Sends responses again that DDS could not send because it had not matched their client yet.

rmw_fastrtps waits 100 ms for the reader of a client that calls; then rclpy warns, and the client waits forever.
On a busy machine readers are matched later than that.
"""

import functools
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy import _rclpy_pybind11

_WARNING = "failed to send response"
_ATTEMPTS, _SPACING = 20, 0.05
"""Further attempts, each of which waits up to 100 ms in the middleware; s between them."""
_SENDERS = (
    (_rclpy_pybind11.Service, ("service_send_response",)),
    (_rclpy_pybind11.ActionServer, ("send_goal_response", "send_cancel_response", "send_result_response")),
)

_thread = threading.local()


def send_responses_again() -> None:
    """Do so for all services and actions of this process from now on; rclpy has no option for it."""
    if not hasattr(warnings.showwarning, "notes_responses"):
        warnings.filterwarnings("always", message=_WARNING, category=RuntimeWarning)
        warnings.showwarning = _noting(warnings.showwarning)
    for owner, names in _SENDERS:
        for name in names:
            if not hasattr(getattr(owner, name), "sends_again"):
                setattr(owner, name, until_matched(getattr(owner, name)))


def until_matched(send: Callable[..., None]) -> Callable[..., None]:
    """A function that sends a response, and goes on trying in another thread where the client is not matched yet.

    Its first attempt raises what `send` raises. Needs `send_responses_again`, which hears the warnings.
    """

    @functools.wraps(send)
    def call(*arguments: Any) -> None:
        if not _is_sent(send, arguments):
            threading.Thread(target=_try_again, args=(send, arguments), name="response", daemon=True).start()

    call.sends_again = True  # type: ignore[attr-defined]
    return call


def _try_again(send: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    for _ in range(_ATTEMPTS):
        time.sleep(_SPACING)
        try:
            if not rclpy.ok() or _is_sent(send, arguments):
                return
        except Exception:  # the client has gone, or the service
            return
    rclpy.logging.get_logger("poise").error("a response was not sent: its client was not found")


def _is_sent(send: Callable[..., None], arguments: tuple[Any, ...]) -> bool:
    _thread.unsent = False
    send(*arguments)
    return not _thread.unsent


def _noting(show: Callable[..., None]) -> Callable[..., None]:
    """Keep the warning that a response was not sent, in the thread that sends; others are shown as before."""

    def note(message: Any, *more: Any, **where: Any) -> None:
        if str(message).startswith(_WARNING):
            _thread.unsent = True
        else:
            show(message, *more, **where)

    note.notes_responses = True  # type: ignore[attr-defined]
    return note
