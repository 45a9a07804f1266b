"""The player keeps the schedule, pauses without losing anything, and ends when stopped."""

import threading
import time

import pytest

from poise.errors import ErrorCode, SensorError
from poise.fake_robots.player import Player
from poise.fake_robots.stream import Message

DEADLINE = 20.0  # s, far above what is expected
STEP = 5 * 10**6  # ns


class Heard:
    """What a player published and when."""

    def __init__(self):
        self.messages, self.times = [], []
        self._changed = threading.Condition()

    def __call__(self, message):
        with self._changed:
            self.messages.append(message)
            self.times.append(time.monotonic())
            self._changed.notify_all()

    def wait_for(self, count):
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.messages) >= count, DEADLINE)


def stream(count):
    return [Message(10**12 + i * STEP, "a", bytes([i % 256])) for i in range(count)]


@pytest.fixture
def play():
    players = []

    def make(messages, heard, **options):
        players.append(Player(lambda: iter(messages), heard, **options))
        players[-1].start()
        return players[-1]

    yield make
    for player in players:
        player.stop()


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_every_message_comes_in_order_and_none_before_its_time(play, rate):
    heard, messages = Heard(), stream(60)
    player = play(messages, heard, rate=rate)
    assert player.done.wait(DEADLINE)
    assert heard.messages == messages
    for i, at in enumerate(heard.times):
        assert at - heard.times[0] > i * STEP * 1e-9 / rate - 0.004  # the first may itself have been late


def test_a_pause_loses_nothing_and_moves_the_schedule(play):
    heard, messages = Heard(), stream(60)
    player = play(messages, heard)
    heard.wait_for(10)
    assert player.play(False) == "paused"
    count = len(heard.messages)
    assert not player.done.wait(0.4)  # by now all would have been said
    assert len(heard.messages) <= count + 1
    assert player.play(True) == "playing"
    assert player.done.wait(DEADLINE)
    assert heard.messages == messages
    assert heard.times[-1] - heard.times[0] > 59 * STEP * 1e-9 + 0.3


def test_nothing_is_said_before_play_and_again_after_the_end(play):
    heard, messages = Heard(), stream(5)
    ended = threading.Event()
    player = play(messages, heard, playing=False, stay=True, finished=ended.set)
    assert player.play(False) == "paused already"
    player.play(True)
    assert ended.wait(DEADLINE)
    assert heard.messages == messages
    player.play(True)
    heard.wait_for(10)
    assert heard.messages == messages * 2


def test_a_loop_begins_again_until_stopped(play):
    heard = Heard()
    player = play(stream(3), heard, loop=True)
    heard.wait_for(10)
    player.stop()
    assert player.done.is_set()
    assert heard.messages[:9] == stream(3) * 3


def test_a_loop_over_nothing_ends(play):
    assert play([], Heard(), loop=True).done.wait(DEADLINE)


def test_the_first_message_waits_until_someone_listens(play):
    heard, listening = Heard(), threading.Event()
    player = play(stream(3), heard, ready=listening.is_set)
    assert not player.done.wait(0.1)
    assert heard.messages == []
    listening.set()
    assert player.done.wait(DEADLINE)
    assert len(heard.messages) == 3


def test_nobody_listening_is_a_failure_with_a_name(play):
    player = play(stream(3), Heard(), ready=lambda: False, ready_timeout=0.05)
    assert player.done.wait(DEADLINE)
    assert isinstance(player.failure, SensorError)
    assert player.failure.code is ErrorCode.DEADLINE


def test_stop_ends_a_wait_at_once(play):
    player = play([Message(0, "a", b""), Message(10**15, "a", b"")], heard := Heard())
    heard.wait_for(1)
    player.stop()  # joins; would take eleven days
    assert player.done.is_set()


def test_a_fault_of_ours_ends_the_player_and_is_told(play, capfd):
    def broken(message):
        raise ZeroDivisionError

    player = play(stream(1), broken)
    assert player.done.wait(DEADLINE)
    assert player.failure.code is ErrorCode.INTERNAL
    assert "ZeroDivisionError" in capfd.readouterr().err
