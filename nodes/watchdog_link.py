"""What a node and its watchdog process share: messages (a line of JSON, then bytes) over sockets, and a number."""

import contextlib
import json
import mmap
import os
import queue
import socket
import struct
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


class QueuedLink(WatchdogLink):
    """An end whose `send` never waits for the other end to read: a thread sends, in order.

    Args:
        descriptor: of the socket, which the link owns from here on.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self._words: queue.SimpleQueue[Word] = queue.SimpleQueue()
        threading.Thread(target=self._send_words, name="link", daemon=True).start()

    @property
    def idle(self) -> bool:
        """No message waits to be sent."""
        return self._words.empty()

    def send(self, what: str, body: bytes = b"", **values: Any) -> None:
        """Send a message as soon as the other end reads; one that is gone gets none."""
        self._words.put(Word(what, values, body))

    def _send_words(self) -> None:
        with contextlib.suppress(OSError):  # the other end is gone, which `receive` sees
            while True:
                word = self._words.get()
                super().send(word.what, word.body, **word.values)


class SharedNumber:
    """A number in memory of two processes: it changes for both at once, also for one that is held up.

    Args:
        descriptor: of the memory; None: of new memory, with the number 0.
    """

    _FORMAT = struct.Struct("q")

    def __init__(self, descriptor: int | None = None) -> None:
        self.descriptor = os.memfd_create("poise") if descriptor is None else descriptor
        os.ftruncate(self.descriptor, self._FORMAT.size)
        self._memory = mmap.mmap(self.descriptor, self._FORMAT.size)

    @property
    def value(self) -> int:
        """The number now."""
        return int(self._FORMAT.unpack_from(self._memory)[0])

    @value.setter
    def value(self, number: int) -> None:
        self._FORMAT.pack_into(self._memory, 0, number)
