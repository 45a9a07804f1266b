"""Carries out a pick: to the object, up with it, weighs what was lifted, and brings it back or puts it down again.

Knows nothing of ROS; nothing in it waits: `tick` returns at once.
"""

from collections.abc import Callable, Sequence

import numpy as np

from poise.assembly import RigidObject
from poise.errors import ErrorCode, NoAnswerError, PoiseError, SensorError
from poise.manipulation.execution import RobotPort, Tolerances, TransferExecution, TransferStep
from poise.manipulation.gripper import Grip
from poise.manipulation.lifting import LiftedMass, lifted_mass
from poise.manipulation.picking import Pick, PickSteps
from poise.types import Array

_SETTLE, _LISTEN, _PATIENCE = 0.4, 0.6, 3.0
"""s after a motion before wrenches count, during which they are averaged, and in which they have to come."""
_FEWEST = 5
"""Wrenches that make an average."""
_SIGMAS = 3.0
_MASS_TOLERANCE = 0.05
"""Share by which what is lifted may be off a weight that is known, besides three standard deviations."""
_LEAST_HOLD = 1.0
"""m/s2 that the grip has to bear besides gravity, also with the mass that was lifted."""


class ForceWatch:
    """Averages the forces while the arm rests."""

    def __init__(self) -> None:
        self._rows: list[Array] = []
        self._since = self._begun = np.inf
        self.heard = -np.inf
        """s, time of the last wrench."""

    def add(self, force: Sequence[float], now: float) -> None:
        """Take a force (3,), N, in the sensor frame."""
        row = np.asarray(force, dtype=np.float64)
        if not np.isfinite(row).all():
            return
        self.heard = now
        if self._since <= now <= self._begun + _PATIENCE:
            self._rows.append(row)

    def begin(self, now: float) -> None:
        """Average what comes from shortly after now on."""
        self._rows, self._since, self._begun = [], now + _SETTLE, now

    def average(self, now: float) -> tuple[Array, Array] | None:
        """(3,) mean and (3,) standard deviation of one sample, N; None before they are known.

        Raises:
            SensorError: SENSOR_STALE when too few have come.
        """
        if now >= self._since + _LISTEN and len(self._rows) >= _FEWEST:
            rows = np.array(self._rows)
            return rows.mean(axis=0), rows.std(axis=0, ddof=1)
        if now > self._begun + _PATIENCE:
            raise SensorError(
                ErrorCode.SENSOR_STALE,
                f"{len(self._rows)} wrenches came in {_PATIENCE:g} s: what is held cannot be verified; start the"
                " sensor, or set verify to false",
            )
        return None


class PickExecution:
    """One attempt. Call `tick` some fifty times a second until `done`.

    Then the object is held and verified when `holding` and there is no `error`; `retry` says that it was put down
    again, and another grasp may serve.

    Args:
        item: as it is believed to be.
        weight_known: its mass was given or weighed.
        pick: the plan, and its steps.
        robot: takes the commands and the joint states.
        tolerances: how well it has to follow.
        forces: of the sensor; None: nothing is verified.
        down: (3,) m/s2 gravity in the sensor frame at the grasp; None: not known, its length counts alone.
        gravity: m/s2.
        grasped, released: called when the fingers have closed on the object, and when they have opened.
        now: s of a clock that never goes back, the one of all calls.
    """

    def __init__(
        self,
        item: RigidObject,
        weight_known: bool,
        pick: Pick,
        steps: PickSteps,
        robot: RobotPort,
        tolerances: Tolerances,
        forces: ForceWatch | None,
        down: Array | None,
        gravity: float,
        grasped: Callable[[], None],
        released: Callable[[], None],
        now: float,
    ) -> None:
        self._item, self._known, self._pick, self._steps = item, weight_known, pick, steps
        self._robot, self._tolerances, self._forces = robot, tolerances, forces
        self._down, self._gravity = down, gravity
        self._grasped, self._released = grasped, released
        self._before: tuple[Array, Array] | None = None
        self._doing = "reach"
        self._playing: TransferExecution | None = None
        self._fault: PoiseError | None = None
        self.mass: LiftedMass | None = None
        self.grip: Grip | None = None
        self.holding = self.done = self.retry = False
        self.error: PoiseError | None = None
        self._begin("reach", steps.reach, now)

    @property
    def stage(self) -> str:
        """As feedback names it."""
        if self._playing is None:
            return "verifying"
        return "returning" if self._doing in ("back", "undo") else "picking"

    def cancel(self, now: float) -> None:
        """Command the arm to stop, and end."""
        if self._playing is not None:
            self._playing.cancel(now)
        elif not self.done:
            hand = "it still holds it" if self.holding else "its hand is empty"
            self._end(PoiseError(ErrorCode.CANCELLED, f"picking {self._item.id} was cancelled at rest; {hand}"))

    def tick(self, now: float) -> None:
        """Go on; never blocks, never raises."""
        if self.done:
            return
        try:
            if self._playing is None:
                self._measure(now)
            else:
                self._play(self._playing, now)
        except PoiseError as error:
            self._failed(error, now)
        except Exception as failure:  # of ours; the arm has to stop all the same
            self._failed(PoiseError(ErrorCode.INTERNAL, f"internal error: {failure!r}; please report it"), now)

    # -- step by step -----------------------------------------------------------------------------------------------

    def _begin(self, doing: str, steps: tuple[TransferStep, ...], now: float) -> None:
        self._doing = doing
        if any(step.motion is not None for step in steps):
            self._playing = TransferExecution(self._item.id, steps, self._robot, self._tolerances, now, self.grip)
        else:
            self._arrived(now)

    def _play(self, playing: TransferExecution, now: float) -> None:
        playing.tick(now)
        if playing.grip and not self.holding:
            self.holding, self.grip = True, playing.held
            self._grasped()
        if self.holding and playing.grip is False:
            self.holding, self.grip = False, None
            self._released()
        if not playing.done:
            return
        self.holding = self.holding and not playing.dropped
        if playing.error is not None:
            self._end(playing.error)
        else:
            self._arrived(now)

    def _arrived(self, now: float) -> None:
        self._playing = None
        if self._doing in ("reach", "lift") and self._forces is not None:
            self._forces.begin(now)
        else:
            self._next(now)

    def _measure(self, now: float) -> None:
        if self._forces is None:
            raise PoiseError(ErrorCode.INTERNAL, "there is nothing to measure with")
        found = self._forces.average(now)
        if found is None:
            return
        if self._doing == "reach":
            self._before = found
        elif self._before is not None:
            self.mass = lifted_mass(self._before, found, self._down, self._gravity)
            self._fault = self._judge(self.mass)
            if self._fault is not None:
                self._begin("undo", self._steps.undo, now)
                return
        self._next(now)

    def _next(self, now: float) -> None:
        if self._doing == "reach":
            self._begin("lift", self._steps.lift, now)
        elif self._doing == "lift":
            self._begin("back", self._steps.back, now)
        else:
            self.retry = self._fault is not None and self._fault.code is ErrorCode.NOT_HELD
            self._end(self._fault)

    def _judge(self, lifted: LiftedMass) -> PoiseError | None:
        """What speaks against holding the object with what was lifted."""
        name, mass, std = self._item.id, lifted.mass, lifted.std
        if mass < _SIGMAS * std:
            return NoAnswerError(
                ErrorCode.NOT_HELD, f"nothing was lifted with {name}: {1e3 * mass:.0f} g, +- {1e3 * std:.0f} g"
            )
        if lifted.aside > _SIGMAS * lifted.aside_std + _MASS_TOLERANCE * mass * self._gravity:
            return NoAnswerError(
                ErrorCode.NOT_HELD,
                f"the lift of {name} changed the force by {lifted.aside:.2g} N across gravity: it touches something, or"
                " the sensor frame is wrong",
            )
        believed = self._item.mass
        own = 0.0 if self._item.covariance is None else float(np.sqrt(max(self._item.covariance[0, 0], 0.0)))
        if self._known and abs(mass - believed) > _SIGMAS * float(np.hypot(std, own)) + _MASS_TOLERANCE * believed:
            return NoAnswerError(
                ErrorCode.NOT_HELD,
                f"{mass:.3g} kg were lifted with {name}, and it was believed to weigh {believed:.3g} kg",
            )
        bears = (self._pick.hold + self._gravity) * self._pick.mass / mass - self._gravity
        if bears < _LEAST_HOLD:
            return NoAnswerError(
                ErrorCode.TOO_HEAVY,
                f"{name} weighs {mass:.3g} kg, more than the grip holds there: it was put down again",
            )
        return None

    # -- what can go wrong ------------------------------------------------------------------------------------------

    def _failed(self, error: PoiseError, now: float) -> None:
        """At rest after the lift, an object that cannot be verified is put down again; otherwise the pick ends here."""
        if self._playing is None and self._doing == "lift" and self._fault is None:
            self._fault = error
            self._begin("undo", self._steps.undo, now)
        elif self._playing is not None and not self._playing.done:
            self._fault = error
            self._playing.cancel(now)
        else:
            self._end(error)

    def _end(self, error: PoiseError | None) -> None:
        self.error, self.done = error, True
