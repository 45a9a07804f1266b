"""Messages between a node and its watchdog process: a line of JSON, then bytes, over a pair of sockets."""

import contextlib
import json
import socket
import threading
from multiprocessing.connection import Connection
from typing import Any, NamedTuple


class Word(NamedTuple):
    """One message.

    Args:
        what: its kind.
        values: numbers and text.
        body: bytes, such as messages that are serialized already.
    """

    what: str
    values: dict[str, Any]
    body: bytes = b""


class WatchdogLink:
    """One end; any thread may send, one thread receives.

    Args:
        descriptor: of the socket, which the link owns from here on.
    """

    def __init__(self, descriptor: int) -> None:
        self._connection, self._lock = Connection(descriptor), threading.Lock()

    def send(self, what: str, body: bytes = b"", **values: Any) -> None:
        """Send a message.

        Raises:
            OSError: the other end is gone.
        """
        data = json.dumps([what, values]).encode() + b"\n" + body
        with self._lock:
            self._connection.send_bytes(data)

    def receive(self) -> Word | None:
        """Wait for the next message; None: the other end is gone."""
        try:
            data = self._connection.recv_bytes()
        except (EOFError, OSError):
            return None
        head, _, body = data.partition(b"\n")
        what, values = json.loads(head)
        return Word(what, values, body)

    def close(self) -> None:
        """Let go of the socket; a thread that waits in `receive` gets None."""
        with self._lock:
            if not self._connection.closed:
                with socket.socket(fileno=self._connection.fileno()) as both:
                    with contextlib.suppress(OSError):
                        both.shutdown(socket.SHUT_RDWR)
                    both.detach()
