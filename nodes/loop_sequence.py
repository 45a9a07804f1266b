"""The order of the loop: scan, pick, weigh, place, until the table is empty; then carry. The robot is a port."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.nodes.clock import node_seconds
from poise.types import Array

_TRIES = 3
"""How often a step is begun whose node ended, or that may succeed the next time."""
_ENDING = (ErrorCode.CANCELLED, ErrorCode.INTERNAL)
"""Codes after which nothing is tried again."""
_PASSING = (ErrorCode.TOPIC_MISSING, ErrorCode.NOT_FOLLOWING, ErrorCode.SENSOR_STALE, ErrorCode.DEADLINE)
"""Codes of what may be gone the next time: a node that ended, a message that came late."""


class NodeEndedError(NoAnswerError):
    """The node that works at a step has ended; the step may be begun again once the node is back."""

    def __init__(self, node: str) -> None:
        super().__init__(ErrorCode.TOPIC_MISSING, f"{node} ended during its step; it is started again")


class LoopOverError(NoAnswerError):
    """The loop cannot go on: the robot is gone, or it does not come to rest; nothing is tried again."""


class WeighedObject(NamedTuple):
    """What weighing gave.

    Args:
        mass, com: kg; (3,) m in the sensor frame.
        covariance: (4, 4) of (m, m c), kg and kg m.
        true_mass, true_com: of a simulated world, the same; None: not known.
    """

    mass: float
    com: Array
    covariance: Array
    true_mass: float | None = None
    true_com: Array | None = None


class Carried(NamedTuple):
    """What carrying gave.

    Args:
        distance, seconds: m and s of the way.
        used, limit: largest share of the limits that was commanded, and the least limit on the way, m/s2.
        moved: m, the farthest that an object of a simulated world moved on the tray; None: not known.
    """

    distance: float
    seconds: float
    used: float
    limit: float
    moved: float | None = None


class LoopRobot(Protocol):
    """What the loop asks of the nodes. Each call returns when it is done, or raises a PoiseError."""

    def scan(self, count: int) -> list[str]:
        """Look at the table; the names of the objects in the world, at most so many, in the order to take them."""

    def pick(self, name: str, seed: int) -> None:
        """Take it into the hand."""

    def weigh(self, attempt: int) -> WeighedObject:
        """Weigh what the hand holds."""

    def place(self, seed: int) -> float:
        """Place what the hand holds; the least robustness of the stack then, N."""

    def held(self) -> str:
        """The id of what the hand holds, as the world says; empty: nothing."""

    def standing(self, name: str) -> bool:
        """The world has it where it was placed or scanned."""

    def carry(self, distance: float, left_behind: list[str]) -> Carried:
        """Drive forwards by m with what stands on the tray."""

    def recover(self) -> None:
        """Wait until the robot rests and all nodes are there."""


@dataclass(frozen=True)
class StepRecord:
    """One step.

    Args:
        step: scan, pick, weigh, place or carry.
        name: of the object; empty: of none.
        seconds: it took.
        code, message: why it failed; OK and empty: it did not.
    """

    step: str
    name: str
    seconds: float
    code: ErrorCode = ErrorCode.OK
    message: str = ""


@dataclass
class ObjectRecord:
    """What became of one object.

    Args:
        name: its id in the world.
        outcome: placed, skipped (it stands where it stood), held, or lost from the hand.
        weight: None: it was not weighed.
        robustness: N of the stack after it was placed; None: it was not.
        why: of what was not done.
    """

    name: str
    outcome: str = "skipped"
    weight: WeighedObject | None = None
    robustness: float | None = None
    why: str = ""


@dataclass
class LoopRecord:
    """A whole loop; `error` is why it ended early, None: it did not."""

    wanted: int
    carries: bool = True
    objects: list[ObjectRecord] = field(default_factory=list)
    steps: list[StepRecord] = field(default_factory=list)
    carried: Carried | None = None
    error: PoiseError | None = None

    @property
    def placed(self) -> list[ObjectRecord]:
        """The objects on the tray."""
        return [each for each in self.objects if each.outcome == "placed"]

    @property
    def whole(self) -> bool:
        """All objects that were asked for are weighed, placed and, if that was asked for, carried."""
        complete = [each for each in self.placed if each.weight is not None]
        carried = self.carried is not None or not self.carries
        return self.error is None and len(complete) == self.wanted and carried


class LoopSequence:
    """Runs the steps of one loop.

    Args:
        robot: does them.
        count: of the objects that are wanted.
        distance: m to carry; 0: not.
        seed: of the plans.
        report: called after every step; before it with None and what begins.
    """

    def __init__(
        self,
        robot: LoopRobot,
        count: int,
        distance: float,
        seed: int = 0,
        report: Callable[[StepRecord | None, str], None] = lambda record, words: None,
    ) -> None:
        self._robot, self._distance, self._seed, self._report = robot, distance, seed, report
        self.record = LoopRecord(count, distance > 0)

    def run(self) -> LoopRecord:
        """All steps. Never raises a PoiseError: `error` of the record says why the loop ended early."""
        record = self.record
        try:
            for name in self._step(
                "scan", "", lambda attempt: self._robot.scan(record.wanted), lambda: None, again=True
            ):
                self._one(name)
            self._look_again()
            if self._distance and record.placed:
                left = [each.name for each in record.objects if each.outcome != "placed"]
                record.carried = self._step(
                    "carry", "", lambda _: self._robot.carry(self._distance, left), lambda: None, again=True
                )
            elif self._distance:
                raise NoAnswerError(ErrorCode.EMPTY, "nothing stands on the tray, so nothing is carried")
        except PoiseError as error:
            record.error = error
        return record

    def _look_again(self) -> None:
        """Look once more for what fell from the hand, and for what the first scan did not show; take what is found.

        Raises:
            PoiseError: NOT_HELD when what fell is not found: it may lie on the tray; as `_one`.
        """
        record = self.record
        left = [each for each in record.objects if each.outcome in ("lost", "skipped")]
        fell = {each.name for each in left if each.outcome == "lost"}
        missing = max(record.wanted - len(record.objects), 0)  # objects that stood in front of it are gone now
        if not fell and not missing:
            return
        try:
            found = self._step("scan", "", lambda attempt: self._robot.scan(len(left) + missing), lambda: None)
        except PoiseError as error:
            if _ends(error):
                raise
            found = []  # nothing lies on the table
        seen = {each.name for each in record.objects} - fell
        for name in (each for each in found if each not in seen):
            record.objects = [each for each in record.objects if each.name != name]
            self._one(name)
        for each in record.objects:
            if each.outcome == "lost":
                raise NoAnswerError(ErrorCode.NOT_HELD, f"{each.name} fell, and is not on the table: {each.why}")

    def _one(self, name: str) -> None:
        """One object, from the table to its place.

        Raises:
            PoiseError: after which the loop cannot go on; the robot rests.
        """
        known = ObjectRecord(name)
        self.record.objects.append(known)
        if self._picked(known):
            # The arm may be anywhere near the table, where weighing is not safe: put it down, and begin again.
            self._place(known)
            if self._picked(known):
                raise NoAnswerError(ErrorCode.NOT_HELD, f"picking {name} was interrupted twice; the hand holds it")
        if known.outcome != "held":
            return
        try:
            known.weight = self._step("weigh", name, self._robot.weigh, lambda: None, again=True)
        except PoiseError as error:
            if _ends(error):
                raise
            known.why = error.message
            if not self._robot.held():
                known.outcome = "lost"
                return
        self._place(known)

    def _picked(self, known: ObjectRecord) -> bool:
        """Pick an object, or say why not in its record; True: it is in the hand, but picking was interrupted.

        Raises:
            PoiseError: as `_one`.
        """
        name, robot, seed = known.name, self._robot, self._seed + len(self.record.objects)
        interrupted = False
        try:
            interrupted = bool(
                self._step("pick", name, lambda attempt: robot.pick(name, seed + attempt), lambda: self._holds(name))
            )
        except PoiseError as error:
            if _ends(error):
                raise
            known.why = error.message
            if robot.held() != name:
                return False  # the loop goes on with the others
            interrupted = True
        known.outcome = "held"
        return interrupted

    def _place(self, known: ObjectRecord) -> None:
        """Place what the hand holds.

        Raises:
            PoiseError: as `_one`.
        """
        seed = self._seed + len(self.record.objects)
        try:
            known.robustness = self._step(
                "place",
                known.name,
                lambda attempt: self._robot.place(seed + attempt),
                lambda: self._placed(known.name),
                again=True,
            )
        except PoiseError as error:
            if error.code is not ErrorCode.NOT_HELD:
                raise
            known.outcome, known.why = "lost", error.message
            self._recover()
            return
        known.outcome = "placed"

    def _holds(self, name: str) -> bool | None:
        return True if self._robot.held() == name else None

    def _placed(self, name: str) -> float | None:
        """NaN when it was put down, although the answer was lost."""
        return float("nan") if not self._robot.held() and self._robot.standing(name) else None

    def _step(
        self, step: str, name: str, act: Callable[[int], Any], done: Callable[[], Any], again: bool = False
    ) -> Any:
        """Do a step; one whose node ended is begun again, unless it was done before.

        Args:
            step, name: as in `StepRecord`.
            act: does it, given the number of the attempt.
            done: after an error, its answer if it was done all the same, or None.
            again: a failure is tried again, too.

        Raises:
            PoiseError: of the last attempt.
        """
        attempt = 0
        while True:
            begun = node_seconds()
            self._report(None, f"{step} {name}".strip())
            try:
                answer = act(attempt)
            except PoiseError as error:
                self._keep(StepRecord(step, name, node_seconds() - begun, error.code, error.message))
                attempt += 1
                if _ends(error) or not (again or error.code in _PASSING):
                    raise
                if error.code is ErrorCode.NOT_HELD and step != "pick":  # there is nothing to do it with
                    raise
                self._recover()
                if (found := done()) is not None:
                    return found
                if attempt == _TRIES:
                    raise
                continue
            self._keep(StepRecord(step, name, node_seconds() - begun))
            return answer

    def _recover(self) -> None:
        """Raises LoopOverError where the robot does not rest, or a node does not come back."""
        try:
            self._robot.recover()
        except PoiseError as error:
            raise LoopOverError(error.code, f"the loop cannot go on: {error.message}") from error

    def _keep(self, record: StepRecord) -> None:
        self.record.steps.append(record)
        self._report(record, "")


def _ends(error: PoiseError) -> bool:
    return isinstance(error, LoopOverError) or error.code in _ENDING
