"""The registers of a Robotiq gripper against the frames printed in its manual."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poise.gripping import GRIPPERS, robotiq
from poise.gripping.robotiq import Activation, Contact, GripperStatus

MODEL = GRIPPERS["2f85"]


@pytest.mark.parametrize(
    ("data", "activation", "contact", "requested", "counts", "current"),
    [
        ("1100 0000 0000", Activation.RUNNING, Contact.MOVING, 0, 0, 0.0),
        ("3100 0000 0000", Activation.DONE, Contact.MOVING, 0, 0, 0.0),
        ("3900 0000 BB10", Activation.DONE, Contact.MOVING, 0, 187, 0.16),
        ("B900 00FF BD00", Activation.DONE, Contact.STOPPED_CLOSING, 255, 189, 0.0),
        ("F900 0000 0D00", Activation.DONE, Contact.AT_REQUEST, 0, 13, 0.0),
    ],
)
def test_status_registers_of_the_manual_mean_what_it_says(
    data: str, activation: Activation, contact: Contact, requested: int, counts: int, current: float
) -> None:
    status = GripperStatus.from_registers([int(word, 16) for word in data.split()])
    assert status.active
    assert (status.activation, status.contact) == (activation, contact)
    assert (status.requested, status.counts) == (requested, counts)
    assert status.current == pytest.approx(current)


def test_commands_are_those_of_the_manual() -> None:
    assert robotiq.command(False) == [0x0000, 0x0000, 0x0000]
    assert robotiq.command(True) == [0x0100, 0x0000, 0x0000]
    assert robotiq.command(True, True, 255, 255, 255) == [0x0900, 0x00FF, 0xFFFF]
    assert robotiq.command(True, True, 0, 255, 255) == [0x0900, 0x0000, 0xFFFF]


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
def test_any_registers_have_a_meaning(first: int, second: int, third: int) -> None:
    status = GripperStatus.from_registers([first, second, third])
    assert 0.0 <= MODEL.opening(status.counts) <= MODEL.stroke
    assert 0 <= status.fault < 16


@given(st.floats(0.0, 0.085))
def test_an_opening_comes_back_within_a_count(opening: float) -> None:
    assert MODEL.opening(MODEL.counts(opening)) == pytest.approx(opening, abs=0.6 * MODEL.stroke / 227)


def test_the_ends_are_asked_for_beyond_the_fingers_limits() -> None:
    assert (MODEL.counts(0.0), MODEL.counts(MODEL.stroke)) == (255, 0)
