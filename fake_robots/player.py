"""Plays a stream of messages in real time: an absolute schedule on a monotonic clock, in a separate thread."""

import threading
import time
import traceback
from collections.abc import Callable, Iterator

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.fake_robots.stream import Message

_LONGEST_WAIT = 0.5  # s
_HELD_STEP = 0.002  # s between two looks at whether a message may go
_MADE_UP = 0.2  # s of lateness that simulated time makes up for
_LEAST_PASS = 0.01  # s, so that a loop over one message does not take a whole core


class Player:
    """Hands each message to `publish` when it is due; knows nothing of ROS.

    Args:
        messages: gives the stream from its beginning, every time it is called.
        publish: called in the player's thread.
        rate: how many times faster than the stream's own clock.
        loop: begin again at the end.
        playing: whether to start at once, or when `play` is called.
        ready: the first message waits until this is true.
        ready_timeout: s after which that counts as a failure; 0: never.
        finished: called in the player's thread each time the stream has ended.
        stay: wait for another `play` after the end.
        held: whether a message of a time, ns, has to wait although it is due; the schedule then moves, as it does
            when messages are late by more than 0.2 s. None: what is late is made up for.
    """

    def __init__(
        self,
        messages: Callable[[], Iterator[Message]],
        publish: Callable[[Message], None],
        *,
        rate: float = 1.0,
        loop: bool = False,
        playing: bool = True,
        stay: bool = False,
        held: Callable[[int], bool] | None = None,
        ready: Callable[[], bool] = lambda: True,
        ready_timeout: float = 0.0,
        finished: Callable[[], None] = lambda: None,
    ) -> None:
        self._messages, self._publish = messages, publish
        self._rate, self._loop, self._stay, self._held = rate, loop, stay, held
        self._ready, self._ready_timeout, self._finished = ready, ready_timeout, finished
        self._condition = threading.Condition()
        self._playing, self._stopped = playing, False
        self._shift = 0.0  # s that pauses have moved the schedule
        self.failure: PoiseError | None = None
        self.done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End for good, and wait until the last message is out."""
        with self._condition:
            self._stopped = True
            self._condition.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def play(self, on: bool) -> str:
        """Start, resume, or (False) pause; says in a sentence what was done."""
        with self._condition:
            before, self._playing = self._playing, on
            self._condition.notify_all()
        if self.done.is_set():
            return "it is over"
        return ("playing" if on else "paused") + (" already" if before == on else "")

    def _run(self) -> None:
        try:
            self._await_ready()
            while self._await_play():
                whole = self._play_once()
                if self._stopped:
                    break
                if self._loop and whole:
                    continue
                with self._condition:
                    self._playing = False  # until the next `play`
                self._finished()
                if not self._stay:
                    break
        except PoiseError as failure:
            self.failure = failure
        except OSError as failure:  # the bag's disk went away
            self.failure = SensorError(ErrorCode.FILE_UNREADABLE, f"reading failed while replaying: {failure}")
        except Exception as failure:  # of ours: the node must end, and say so
            traceback.print_exc()
            self.failure = PoiseError(ErrorCode.INTERNAL, f"replaying failed: {failure!r}")
        finally:
            self.done.set()

    def _await_ready(self) -> None:
        begun = time.monotonic()
        while not self._ready():
            with self._condition:
                if self._stopped:
                    return
                self._condition.wait(0.02)
            if 0 < self._ready_timeout < time.monotonic() - begun:
                raise SensorError(
                    ErrorCode.DEADLINE,
                    f"not every topic of wait_for_subscribers has a subscriber after {self._ready_timeout} s; "
                    "start the subscriber, or raise wait_timeout",
                )

    def _await_play(self) -> bool:
        with self._condition:
            while not (self._playing or self._stopped):
                self._condition.wait(_LONGEST_WAIT)
            return not self._stopped

    def _play_once(self) -> bool:
        """False when stopped before the end, or when there was nothing to play."""
        self._shift = 0.0
        begun: float | None = None
        first = 0
        for message in self._messages():
            if begun is None:
                begun, first = time.monotonic(), message.time
            if not self._wait_until(begun + (message.time - first) * 1e-9 / self._rate, message.time):
                return False
            self._publish(message)
        return begun is not None and self._wait_until(begun + _LEAST_PASS, first)

    def _wait_until(self, due: float, stamp: int) -> bool:
        with self._condition:
            while not self._stopped:
                now = time.monotonic()
                if not self._playing:
                    self._condition.wait(_LONGEST_WAIT)
                    self._shift += time.monotonic() - now
                    continue
                left = due + self._shift - now
                if left > 0:
                    self._condition.wait(min(left, _LONGEST_WAIT))
                elif self._held is not None and self._held(stamp):
                    self._condition.wait(_HELD_STEP)
                else:
                    if self._held is not None:
                        self._shift += max(-left - _MADE_UP, 0.0)
                    return True
        return False
