"""Where an arm is and whether it rests, from joint states as they come in, and what their clock says now."""

from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, PoiseError, SensorError
from poise.excitation.execution.options import DEFAULT_EXECUTION
from poise.types import Array

REST_SPAN, REST_TRAVEL = 0.1, 2e-3
"""s within which a resting arm's joints move by less than this, rad or m."""


class Jointed(Protocol):
    """A robot, as far as its joints have names."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J)."""


class JointWatch:
    """The newest joint states of one robot.

    Args:
        model: the robot.
        stale: s after which joint states do not count.
    """

    def __init__(self, model: Jointed, stale: float = DEFAULT_EXECUTION.stale) -> None:
        self._model, self._stale = model, stale
        self._recent: deque[tuple[int, float, Array]] = deque(maxlen=2000)
        self.foreign = 0
        """Messages that lack joints of this robot."""
        self._foreign_names = ""

    @property
    def names(self) -> tuple[str, ...]:
        """(J,) of the joints."""
        return self._model.joint_names

    def add(self, stamp: int, names: Sequence[str], position: ArrayLike, now: float) -> None:
        """Take a joint state: ns, names (K), positions (K,), and when it came, s."""
        where = dict(zip(names, np.asarray(position, dtype=np.float64).tolist(), strict=False))
        values = np.array([where.get(name, np.nan) for name in self._model.joint_names])
        if not np.isfinite(values).all():
            self.foreign += 1
            self._foreign_names = ", ".join(list(names)[:8])
            return
        if self._recent and stamp <= self._recent[-1][0] - 500_000_000:
            self._recent.clear()  # the clock was set
        if self._recent and stamp <= self._recent[-1][0]:
            return  # late
        self._recent.append((stamp, now, values))
        while self._recent[-1][0] - self._recent[0][0] > 2 * REST_SPAN * 1e9:
            self._recent.popleft()

    def problem(self, now: float) -> PoiseError | None:
        """Why the joints are not known now; None: they are."""
        if not self._recent:
            if self.foreign:
                return SensorError(
                    ErrorCode.JOINT_MISSING,
                    f"joint_states belong to another robot: they have {self._foreign_names}; the robot description has"
                    f" {', '.join(self._model.joint_names)}",
                )
            return SensorError(
                ErrorCode.TOPIC_MISSING, "no joint_states have arrived: start the robot's state publisher"
            )
        if self.age(now) > self._stale:
            return SensorError(
                ErrorCode.SENSOR_STALE,
                f"the last joint state arrived {self.age(now):.2f} s ago: the robot's driver has stopped",
            )
        return None

    def age(self, now: float) -> float:
        """s since the newest came; infinite when none has."""
        return now - self._recent[-1][1] if self._recent else np.inf

    @property
    def stamp(self) -> int:
        """ns of the newest."""
        return self._recent[-1][0] if self._recent else 0

    @property
    def position(self) -> Array:
        """(J,) of the newest, rad or m."""
        return self._recent[-1][2]

    def clock(self, now: float) -> int:
        """ns: the present time on the clock of the stamps, up to the least delay of the messages.

        The message with the least delay gives it.
        """
        if not self._recent:
            return 0
        offset = max(stamp - came * 1e9 for stamp, came, _ in self._recent)
        return round(now * 1e9 + offset)

    def at_rest(self) -> bool:
        """The joints have not moved for a while; not before that while has been seen."""
        newest = self.stamp
        seen = [(stamp, values) for stamp, _, values in self._recent if stamp >= newest - REST_SPAN * 1e9]
        if len(seen) < 3 or newest - self._recent[0][0] < REST_SPAN * 1e9:
            return False
        travel = np.ptp(np.array([values for _, values in seen]), axis=0)
        return bool(travel.max() < REST_TRAVEL)
