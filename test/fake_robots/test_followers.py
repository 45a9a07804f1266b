"""Simulated time waits for the nodes that follow it, and for none of them for ever."""

import itertools
from collections.abc import Iterator

import pytest

from poise.fake_robots import followers, player
from poise.fake_robots.followers import Followers
from poise.fake_robots.player import Player
from poise.fake_robots.stream import Message

SECOND = 10**9


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(followers.time, "monotonic", lambda: now[0])
    return now


def test_the_clock_waits_for_the_slowest_and_leaves_out_who_is_silent(clock: list[float]) -> None:
    said: list[str] = []
    known = Followers(0.2, said.append)
    assert not known.are_behind(7 * SECOND)  # no node follows
    known.heard("/fast", 7 * SECOND)
    known.heard("/slow", 6 * SECOND)
    assert known.are_behind(7 * SECOND)
    known.heard("/slow", 7 * SECOND - SECOND // 5)
    assert not known.are_behind(7 * SECOND)
    clock[0] += 60.0  # the clock was paused: no node has anything to say
    assert known.are_behind(8 * SECOND)
    known.heard("/fast", 8 * SECOND)
    clock[0] += 6.0
    assert not known.are_behind(8 * SECOND)
    assert len(said) == 1
    assert "/slow" in said[0]
    known.heard("/slow", 7 * SECOND)  # it is back
    assert known.are_behind(8 * SECOND)


def test_the_clock_never_waits_for_a_message_that_is_not_due(clock: list[float]) -> None:
    said: list[str] = []
    known = Followers(0.01, said.append, between=0.1)
    known.heard("/node", 7 * SECOND)
    assert not known.are_behind(7 * SECOND + SECOND // 5)
    assert known.are_behind(7 * SECOND + SECOND // 5 + 1)
    assert not said


def test_what_is_held_moves_the_schedule() -> None:
    holds, heard = itertools.count(), []

    def messages() -> Iterator[Message]:
        yield from (Message(number * SECOND // 100, "a", b"") for number in range(3))

    def held(stamp: int) -> bool:
        return stamp > 0 and next(holds) < 5

    made = Player(messages, heard.append, held=held)
    made.start()
    assert made.done.wait(30)
    assert [message.time for message in heard] == [0, SECOND // 100, SECOND // 50]
    assert next(holds) > 5


def test_only_simulated_time_does_not_make_up_for_what_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    for held, shift in ((None, 0.0), (lambda stamp: False, 0.8)):
        made = Player(lambda: iter(()), lambda message: None, held=held)
        monkeypatch.setattr(player.time, "monotonic", lambda: 11.0)
        assert made._wait_until(10.0, 0)  # a second late
        assert made._shift == pytest.approx(shift)
