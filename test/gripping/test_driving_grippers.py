"""The driver of a gripper against the device in software: motions, and the fault contract of docs/gripper.md."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from pymodbus.client import ModbusSerialClient

from poise.errors import ErrorCode, InputError, SensorError
from poise.gripping import GRIPPERS, DriverOptions, FakeGripper, Fingers, GripperDriver

MODEL = GRIPPERS["2f85"]
FAST = DriverOptions(MODEL, speed=0.15)


@pytest.fixture(autouse=True)
def patient(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine answers late, and a silence ends a motion: only those that a test makes are silences."""
    if not any(word in request.node.name for word in ("silence", "cable")):
        monkeypatch.setattr("poise.gripping.driver._PATIENCE", 10.0)


@contextmanager
def driving(gripper: FakeGripper, options: DriverOptions = FAST) -> Iterator[tuple[GripperDriver, list[Fingers]]]:
    heard: list[Fingers] = []
    driver = GripperDriver(gripper.port, options, heard.append, np.random.default_rng(1))
    driver.start()
    try:
        yield driver, heard
    finally:
        assert driver.stop()


def until(condition: Callable[[], Any], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, condition
        time.sleep(0.005)


def state(driver: GripperDriver, kind: str) -> Callable[[], bool]:
    return lambda: driver.report.kind == kind


def test_a_gripper_is_activated_once_moves_and_reports_its_opening() -> None:
    with FakeGripper() as gripper, driving(gripper) as (driver, heard):
        until(state(driver, "ready"))
        assert gripper.activations == 1
        driver.go(0.040)
        until(lambda: driver.fingers.at_request)  # type: ignore[union-attr]
        assert driver.fingers.opening == pytest.approx(0.040, abs=0.0005)  # type: ignore[union-attr]
    openings = [fingers.opening for fingers in heard if fingers.moves]
    assert np.all(np.diff(openings) <= 1e-9)  # it closes all the time


def test_an_object_stops_the_fingers_and_its_loss_is_reported() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper.object_width = 0.030
        driver.go(0.0, force=100.0)
        until(state(driver, "holding"))
        assert driver.fingers.opening == pytest.approx(0.030, abs=0.0005)  # type: ignore[union-attr]
        assert not driver.fingers.at_request  # type: ignore[union-attr]
        assert gripper.command[2] & 0xFF == round(255 * (100 - 20) / (235 - 20))
        gripper.object_width = None  # it slips out
        until(state(driver, "lost"))
        driver.go(MODEL.stroke)
        until(state(driver, "ready"))


def test_nothing_between_the_fingers_is_not_held() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, heard):
        until(state(driver, "ready"))
        driver.go(0.0)
        until(lambda: driver.fingers.at_request)  # type: ignore[union-attr]
        assert driver.report.kind == "ready"
    assert not any(fingers.holds for fingers in heard)


def test_a_request_is_never_reported_as_reached_before_it_was_carried_out() -> None:
    """The device still shows the state of the motion before."""
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        driver.go(0.060)
        until(lambda: driver.fingers.at_request)  # type: ignore[union-attr]
        driver.go(0.020)
        until(lambda: driver.fingers.at_request)  # type: ignore[union-attr]
        assert driver.fingers.opening == pytest.approx(0.020, abs=0.0005)  # type: ignore[union-attr]


def test_halt_stops_the_fingers_on_their_way() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper, DriverOptions(MODEL, speed=0.02)) as (driver, _):
        until(state(driver, "ready"))
        driver.go(0.0)
        until(lambda: gripper.position > 20)
        driver.halt()
        until(lambda: not gripper.command[0] & 0x800)
        rested = gripper.position
        time.sleep(0.05)
        assert gripper.position == rested < 200


def test_a_halt_reaches_the_fingers_when_the_driver_ends_at_once() -> None:
    with FakeGripper(active=True) as gripper:
        with driving(gripper, DriverOptions(MODEL, speed=0.02)) as (driver, _):
            until(state(driver, "ready"))
            driver.go(0.0)
            until(lambda: gripper.position > 20)
            driver.halt()
        assert not gripper.command[0] & 0x800


def test_a_halt_leaves_what_is_held_to_the_motor() -> None:
    with FakeGripper(active=True) as gripper:
        gripper.object_width = 0.030
        with driving(gripper) as (driver, _):
            until(lambda: driver.report.kind == "holding" or (driver.report.kind == "ready" and driver.go(0.0)))
            driver.halt()
        assert gripper.command[0] & 0x800


@pytest.mark.parametrize("was_reset", [False, True])
def test_a_motion_that_a_silence_has_ended_is_not_carried_out_later(was_reset: bool) -> None:
    """A gripper that was reset is not activated by the stop either."""
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper.silent = True
        driver.go(0.0)
        until(state(driver, "silent"))
        if was_reset:
            gripper._was_active = False
            gripper.power_up()
        gripper.silent = False
        until(state(driver, "inactive" if was_reset else "ready"))
        time.sleep(0.1)  # several exchanges
        assert gripper.activations == 0
        assert gripper.position == 3.0
        assert not gripper.command[0] & 0x800


def test_a_request_that_the_device_ignores_is_never_reached() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, heard):
        until(state(driver, "ready"))
        driver.go(0.080)
        until(lambda: driver.fingers.at_request)  # type: ignore[union-attr]
        gripper._written = lambda address, values: None  # type: ignore[method-assign]
        gripper._modbus._written = gripper._written
        driver.go(0.020)
        begun = len(heard)
        until(lambda: len(heard) > begun + 25)  # longer than the echo may take
        assert not any(fingers.at_request for fingers in heard[begun + 1 :])


@pytest.mark.parametrize(
    ("request_", "match"),
    [
        ((0.1,), "opens 0 to 0.085"),
        ((0.05, 5.0), "20 to 235 N"),
        ((float("nan"),), "opening"),
        ((0.05, 40.0, 9.0), "m/s"),
    ],
)
def test_what_the_model_cannot_do_is_refused(request_: tuple[float, ...], match: str) -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        before = list(gripper.command)
        with pytest.raises(InputError, match=match):
            driver.go(*request_)
        assert gripper.command == before


def test_a_gripper_that_was_reset_while_it_may_hold_something_is_not_activated_by_itself() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper._was_active = False
        gripper.power_up()  # its supply was interrupted
        until(state(driver, "inactive"))
        with pytest.raises(SensorError, match="activate it"):
            driver.go(0.05)
        assert gripper.activations == 0
        driver.activate()
        until(state(driver, "ready"))
        assert gripper.activations == 1


def test_a_fault_refuses_motions_until_it_is_activated_again() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper.gripper_fault = 0x0E
        until(state(driver, "fault"))
        assert driver.report.code is ErrorCode.SENSOR_FAULT
        assert "overcurrent" in driver.report.text
        with pytest.raises(SensorError, match="overcurrent"):
            driver.go(0.05)
        driver.activate()
        until(state(driver, "ready"))


def test_a_cable_that_is_pulled_and_put_back_ends_nothing() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper.unplug()
        until(lambda: driver.report.kind in ("silent", "unreachable"))
        with pytest.raises(SensorError):
            driver.go(0.05)
        gripper.plug_in()
        until(state(driver, "ready"))
        assert gripper.activations == 0
        assert driver.report.connects >= 2


def test_silence_and_garbage_are_reported_and_survived() -> None:
    with FakeGripper(active=True) as gripper, driving(gripper) as (driver, _):
        until(state(driver, "ready"))
        gripper.fault = lambda message: message[:-1] + bytes([message[-1] ^ 0xFF])
        until(state(driver, "silent"))
        gripper.fault = None
        until(state(driver, "ready"))


def test_without_a_device_it_is_unreachable() -> None:
    with FakeGripper() as gripper, driving(gripper, DriverOptions(MODEL, slave=3)) as (driver, _):
        until(state(driver, "unreachable"))
        assert "slave 3 does not answer" in driver.report.text
        with pytest.raises(SensorError):
            driver.activate()


def test_the_fake_gripper_answers_pymodbus_own_client() -> None:
    with FakeGripper(active=True) as gripper:
        client = ModbusSerialClient(gripper.port, baudrate=115200, timeout=1.0)
        assert client.connect()
        assert not client.write_registers(1000, [0x0900, 0x00FF, 0xFFFF], device_id=9).isError()
        until(lambda: client.read_input_registers(2000, count=3, device_id=9).registers[0] == 0xF900)
        client.close()
