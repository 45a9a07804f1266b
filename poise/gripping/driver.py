"""One thread that commands a gripper, reports what its fingers do, and connects again when the line was gone."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from poise.errors import ErrorCode, InputError, PoiseError, SensorError
from poise.gripping import robotiq
from poise.gripping.robotiq import Activation, Contact, GripperModel, GripperStatus
from poise.serial_bus import Backoff, ModbusLine

_PATIENCE = 0.2
"""s without an answer after which the device counts as silent."""
_STARTING = 0.3
"""s in which the device has to echo a request."""


@dataclass(frozen=True)
class DriverOptions:
    """How to drive.

    Args:
        model: of the gripper.
        slave: Modbus address.
        rate: Hz of status reads.
        speed: m/s of a motion without a speed of its own.
        force: N of a grasp without a force of its own.
        activate: activate a gripper that is not active when the driver starts. That moves the fingers over the whole
            stroke, so it is not done again by itself: a gripper that was reset later may hold something.
    """

    model: GripperModel
    slave: int = robotiq.GRIPPER_SLAVE
    rate: float = 50.0
    speed: float = 0.05
    force: float = 40.0
    activate: bool = True


@dataclass(frozen=True)
class Fingers:
    """What the fingers do.

    Attributes:
        opening: m between them.
        moves: they are on their way.
        at_request: they are where they were asked to be: nothing is between them.
        holds: they were stopped by something, closing or opening.
        stamp: ns of the wall clock when it was read.
    """

    opening: float
    moves: bool
    at_request: bool
    holds: bool
    stamp: int


@dataclass(frozen=True)
class GripperReport:
    """The condition, one of the table in docs/gripper.md.

    Attributes:
        kind: connecting, unreachable, silent, failed, inactive, activating, fault, lost, moving, holding, ready.
        code: OK, or what is wrong.
        text: one sentence.
        connects: how often the line was opened.
        current: A, of the motor.
    """

    kind: str
    code: ErrorCode
    text: str
    connects: int = 0
    current: float = 0.0

    @property
    def works(self) -> bool:
        """Motions are accepted."""
        return self.kind in ("moving", "holding", "ready", "lost")


@dataclass(frozen=True)
class _Motion:
    counts: int
    speed: int
    force: int
    asked: float


class GripperDriver:
    """Drives one gripper from start() to stop().

    Args:
        port: path of the serial device.
        options: model, rate, speed, force.
        heard: called from the driver's thread with every status that was read.
        rng: for the jitter of the back-off.
    """

    def __init__(
        self, port: str, options: DriverOptions, heard: Callable[[Fingers], None], rng: np.random.Generator
    ) -> None:
        self._line = ModbusLine(port, robotiq.GRIPPER_BAUD_RATE, options.slave)
        self._options, self._heard, self._backoff = options, heard, Backoff(rng)
        self._lock = threading.Lock()
        self._stopping, self._due = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._report = GripperReport("connecting", ErrorCode.OK, "waiting for the first answer")
        self._may_activate = options.activate
        self._motion: _Motion | None = None
        self._command: list[int] | None = None
        self._fingers: Fingers | None = None
        self._held = self._resumes = False
        self._answered: float | None = None
        self._next_open = 0.0
        self._connects = 0

    def start(self) -> None:
        """Start the thread; returns at once, with or without a device."""
        self._thread.start()

    def stop(self, timeout: float = 3.0) -> bool:
        """End the thread, after a command that waits, such as `halt`.

        False when a system call still blocks it after `timeout` s.
        """
        self._stopping.set()
        self._due.set()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def report(self) -> GripperReport:
        """The present condition."""
        with self._lock:
            return self._report

    @property
    def fingers(self) -> Fingers | None:
        """What they did when the device last answered; None before that."""
        with self._lock:
            return self._fingers

    def go(self, opening: float, force: float = 0.0, speed: float = 0.0) -> None:
        """Move the fingers; a motion before it is replaced.

        Args:
            opening: m.
            force: N at which they stop; 0: the option's.
            speed: m/s; 0: the option's.

        Raises:
            InputError: BAD_INPUT for what the model cannot do.
            SensorError: the gripper does not work now.
        """
        model = self._options.model
        if not 0.0 <= opening <= model.stroke * (1 + 1e-6):
            raise InputError(ErrorCode.BAD_INPUT, f"opening {opening:.4f} m: {model.name} opens 0 to {model.stroke} m")
        force, speed = force or self._options.force, speed or self._options.speed
        for what, value, (least, greatest), unit in (
            ("force", force, model.forces, "N"),
            ("speed", speed, model.speeds, "m/s"),
        ):
            if not least <= value <= greatest:
                raise InputError(
                    ErrorCode.BAD_INPUT, f"{what} {value:g} {unit}: {model.name} does {least:g} to {greatest:g} {unit}"
                )
        counts = model.counts(opening)
        with self._lock:
            self._require_working()
            self._motion = _Motion(
                counts, robotiq.share_of(speed, model.speeds), robotiq.share_of(force, model.forces), time.monotonic()
            )
            self._held = False
            self._command = self._moving(True)
            if self._fingers is not None:  # until the device has echoed the request
                self._fingers = replace(self._fingers, moves=True, at_request=False, holds=False)
        self._due.set()

    def halt(self) -> None:
        """Stop the fingers where they are; fingers that rest already keep their grip."""
        with self._lock:
            now = self._fingers
            rests = now is not None and self._command is None and (now.holds or now.at_request)
            if self._motion is not None and not rests:
                self._command = self._moving(False)
        self._due.set()

    def activate(self) -> None:
        """Activate the gripper (again), which ends a fault and moves the fingers over the whole stroke.

        Raises:
            SensorError: SENSOR_UNREACHABLE, without a device.
        """
        with self._lock:
            if self._report.kind in ("connecting", "unreachable", "silent"):
                raise SensorError(ErrorCode.SENSOR_UNREACHABLE, f"gripper: {self._report.text}")
            self._motion, self._held = None, False
            self._command, self._may_activate = robotiq.command(active=False), True
        self._due.set()

    def _require_working(self) -> None:
        if not self._report.works:
            raise SensorError(self._report.code or ErrorCode.BUSY, f"gripper: {self._report.text}")

    def _moving(self, going: bool) -> list[int]:
        motion = self._motion
        if motion is None:
            return robotiq.command(active=True)
        return robotiq.command(True, going, motion.counts, motion.speed, motion.force)

    # Everything below runs in the driver's thread.

    def _run(self) -> None:
        period = 1.0 / self._options.rate
        while not self._stopping.is_set():
            begun = time.monotonic()
            try:
                self._step(begun)
            except Exception as error:  # of this code, or of the receiver: say so, and go on
                self._set("failed", ErrorCode.INTERNAL, f"please report this: {error!r}")
            self._due.wait(max(0.0, period - (time.monotonic() - begun)))
            self._due.clear()
        with contextlib.suppress(OSError, PoiseError):  # without a gripper there is nothing to stop
            if self._command is not None:
                self._exchange()
        self._line.close()

    def _step(self, now: float) -> None:
        if not self._line.is_open and now < self._next_open:
            return
        try:
            if self._line.open():
                self._connects += 1
            status = self._exchange()
        except OSError as error:
            self._line.close()
            self._lose(SensorError(ErrorCode.SENSOR_UNREACHABLE, f"{self._line.path}: {error}"), now)
            return
        except PoiseError as error:
            self._lose(error, now)
            return
        self._answered = time.monotonic()
        self._backoff.reset()
        self._take(status, self._answered)

    def _exchange(self) -> GripperStatus:
        """Send the command that waits, then read the status; a command that failed is sent again.

        After a silence the status comes first: every command would activate a gripper that was reset meanwhile.
        """
        with self._lock:
            command = None if self._resumes else self._command
        if command is not None:
            self._line.write(robotiq.COMMAND_REGISTER, command)
            with self._lock:
                if self._command is command:
                    self._command = None
        return GripperStatus.from_registers(self._line.read_input(robotiq.STATUS_REGISTER, robotiq.REGISTERS))

    def _lose(self, error: PoiseError, now: float) -> None:
        if not self._line.is_open:
            self._next_open = now + self._backoff.next()
        if self._answered is None:
            self._set("unreachable", error.code, error.message)
        elif time.monotonic() - self._answered > _PATIENCE:
            code = error.code if error.code is ErrorCode.SENSOR_PROTOCOL else ErrorCode.SENSOR_STALE
            self._give_up()
            self._set("silent", code, f"no answer for {time.monotonic() - self._answered:.1f} s ({error.message})")

    def _give_up(self) -> None:
        """A motion is not carried out after a silence: the fingers get a stop. An activation is forgotten."""
        self._resumes = True
        with self._lock:
            if self._motion is None:
                self._command = None
            elif self._command is not None or (self._fingers is not None and self._fingers.moves):
                self._command = self._moving(False)

    def _take(self, status: GripperStatus, now: float) -> None:
        """One status: the fingers, the condition, and an activation where it is due."""
        with self._lock:
            if self._resumes and status.activation != Activation.DONE:
                self._command = None
            self._resumes = False
            motion, model = self._motion, self._options.model
            pending = self._command is not None
            echoed = motion is None or (status.going and status.requested == motion.counts) or not status.going
            starting = motion is not None and (pending or not echoed) and now - motion.asked < _STARTING
            stopped = Contact(status.contact) in (Contact.STOPPED_OPENING, Contact.STOPPED_CLOSING)
            done = status.activation == Activation.DONE and status.going and echoed and not pending
            fingers = Fingers(
                opening=model.opening(status.counts),
                moves=starting or (done and status.contact is Contact.MOVING),
                at_request=done and status.contact is Contact.AT_REQUEST,
                holds=done and stopped,
                stamp=time.time_ns(),
            )
            lost = self._held and fingers.at_request
            self._held = self._held or (fingers.holds and status.contact is Contact.STOPPED_CLOSING)
            self._fingers = fingers
            if status.activation == Activation.DONE and not pending:  # else the status is older than the command
                self._may_activate = False
            elif status.activation == Activation.RESET and self._may_activate and not pending:
                self._command = robotiq.command(active=True)
                self._due.set()
        self._set(*_condition(status, fingers, lost), current=status.current)
        self._heard(fingers)

    def _set(self, kind: str, code: ErrorCode, text: str, current: float = 0.0) -> None:
        with self._lock:
            self._report = GripperReport(kind, code, text, self._connects, current)


def _condition(status: GripperStatus, fingers: Fingers, lost: bool) -> tuple[str, ErrorCode, str]:
    """The worst that holds."""
    if status.fault >= robotiq.MAJOR_FAULT:
        why = robotiq.FAULTS.get(status.fault, "unknown")
        return "fault", ErrorCode.SENSOR_FAULT, f"fault {status.fault:#04x}: {why}; then activate the gripper"
    if status.activation == Activation.RUNNING:
        return "activating", ErrorCode.BUSY, "the gripper is being activated"
    if status.activation != Activation.DONE:
        return "inactive", ErrorCode.SENSOR_FAULT, "the gripper is not active: activate it; that opens the fingers"
    if lost:
        return "lost", ErrorCode.OK, "the fingers held something, and hold nothing now"
    if fingers.moves:
        return "moving", ErrorCode.OK, "the fingers move"
    if fingers.holds:
        return "holding", ErrorCode.OK, f"the fingers hold something {fingers.opening * 1e3:.0f} mm wide"
    return "ready", ErrorCode.OK, "ready"
