"""The execution of one trajectory: whether the joints are within its tolerances on the way and at its end."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.simulation import JointMotion
from poise.types import Array


class Outcome(IntEnum):
    """The error codes of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


_CODES = {ErrorCode.JOINT_MISSING: Outcome.INVALID_JOINTS, ErrorCode.DEADLINE: Outcome.OLD_HEADER_TIMESTAMP}


def outcome_of(error: InputError) -> Outcome:
    """The code for a trajectory that is refused."""
    return _CODES.get(error.code, Outcome.INVALID_GOAL)


@dataclass(frozen=True)
class JointTolerances:
    """(3, J): the largest errors of position, velocity and acceleration of J joints; infinite: any."""

    most: Array

    @classmethod
    def read(
        cls, joints: tuple[str, ...], given: list[tuple[str, tuple[float, ...]]], position: float
    ) -> "JointTolerances":
        """Those of a goal.

        Args:
            joints: (J) names.
            given: name, and position, velocity, acceleration; 0: the default, -1: any error is allowed.
            position: the default of positions, rad or m, 0: any; velocities and accelerations have none.

        Raises:
            InputError: JOINT_MISSING for another joint, BAD_INPUT for other negative numbers.
        """
        most = np.full((3, len(joints)), np.inf)
        most[0] = position or np.inf
        for name, values in given:
            if name not in joints:
                raise InputError(ErrorCode.JOINT_MISSING, f"tolerances: the trajectory has no joint {name!r}")
            for row, value in enumerate(values):
                if not (value >= 0 or value == -1) or np.isinf(value):
                    raise InputError(
                        ErrorCode.BAD_INPUT,
                        f"tolerances: {value} for {name}; use a positive number, 0 (the default) or -1 (no limit)",
                    )
                if value:
                    most[row, joints.index(name)] = value if value > 0 else np.inf
        return cls(most)

    def violation(self, joints: tuple[str, ...], error: Array) -> str | None:
        """Which joint deviates most from what is allowed, for (3, J) errors; None: none does."""
        excess = np.abs(error) / self.most
        if not (excess > 1).any():
            return None
        row, column = np.unravel_index(np.argmax(excess), excess.shape)
        what = JointMotion._fields[row]
        return (
            f"{what} of {joints[column]} is off by {error[row, column]:.4f}; allowed are {self.most[row, column]:.4f}"
        )


@dataclass(frozen=True)
class Following:
    """One trajectory that is executed.

    Args:
        joints: (J) names.
        goal: (J,) last positions, rad or m.
        end: s at which it should be there.
        on_path, at_end: tolerances.
        patience: s after `end` in which the goal may still be reached.
    """

    joints: tuple[str, ...]
    goal: Array
    end: float
    on_path: JointTolerances
    at_end: JointTolerances
    patience: float

    @property
    def deadline(self) -> float:
        """s: the state at this time decides, also where the node looks later."""
        return self.end + self.patience

    def judge(self, now: float, commanded: Array, actual: Array) -> tuple[Outcome, str] | None:
        """How it has ended, or None, from (3, J) positions, velocities and accelerations at `now`, s."""
        if now < self.end:
            violation = self.on_path.violation(self.joints, commanded - actual)
            return violation and (Outcome.PATH_TOLERANCE_VIOLATED, f"path tolerance: {violation}")
        rest = np.zeros_like(self.goal)
        violation = self.at_end.violation(self.joints, np.stack([self.goal, rest, rest]) - actual)
        if violation is None:
            return Outcome.SUCCESSFUL, ""
        if now < self.deadline:
            return None
        return Outcome.GOAL_TOLERANCE_VIOLATED, f"goal tolerance, {self.patience:.2f} s after the end: {violation}"
