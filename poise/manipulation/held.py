"""Reach of an object that is in the hand: one grasp, the one it is held by, and the places where it can be put."""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from poise.assembly import Analysis, RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.geometry import Pose
from poise.manipulation.arm import Arm
from poise.manipulation.bodies import pose_of, se3_of
from poise.manipulation.cell import Cell
from poise.manipulation.hand import Grasp
from poise.manipulation.reach import End, Margins, Reach
from poise.types import Array

_LEAST_HOLD = 0.0
"""m/s2 besides gravity: it is in the hand, and the hand bears it."""


def grasp_of_held(item: RigidObject, pose_tool_object: Pose, arm: Arm, opening: float = np.nan) -> Grasp:
    """How an object is held.

    Args:
        item: its shape counts.
        pose_tool_object: of the object frame in the tool frame.
        arm: whose hand it is; it closes along y of the tool frame.
        opening: m between the fingers that hold it; NaN: not known, and the whole object counts as between them.

    Raises:
        NoAnswerError: NOT_HELD when no part of the object is between the fingers.
    """
    vertices = pose_tool_object.apply(item.shape.polyhedron.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    reach = np.array([*arm.hand.finger[:2], arm.hand.finger[2]]) / 2 + [0, arm.hand.stroke / 2, 0]
    if np.any(low > reach) or np.any(high < -reach - [0, 0, arm.hand.finger[2] / 2]):
        raise NoAnswerError(
            ErrorCode.NOT_HELD,
            f"{item.id} is not between the fingers, where the world has it: scan it, and pick it again",
        )
    width = float(np.clip(opening if np.isfinite(opening) else high[1] - low[1], 0.0, arm.hand.widest))
    return Grasp(se3_of(pose_tool_object).inverse(), width)


class HeldReach(Reach):
    """As `Reach`, of what is held: it is picked up already, by one grasp.

    Args:
        arm: the robot.
        before: the assembly; what is held is no part of it.
        item: the object; its pose is taken from the hand.
        grasp: by which it is held.
        start: (J,) where the arm is.
        seed: of the inverse kinematics.
    """

    held = True

    def __init__(
        self, arm: Arm, before: Analysis, item: RigidObject, grasp: Grasp, start: Array, seed: int = 0
    ) -> None:
        self._held_by = grasp
        there: pin.SE3 = arm.tool(start) * grasp.object_tcp.inverse()
        super().__init__(arm, before, replace(item, pose=pose_of(there)), start=start, seed=seed)

    def require_free_start(self) -> None:
        """As that of `Reach`, with the object in the hand."""
        cell = Cell(self.arm, self.around, self._held_by.width, (self.item, self._held_by), (0.0, 0.0))
        touching = cell.touching(self.start)
        if touching is not None:
            raise NoAnswerError(
                ErrorCode.INTERPENETRATION,
                f"where the arm is, {touching[0]} touches {touching[1]}: move it away, or correct base",
            )

    def _firm_grasps(self, sides: int) -> list[tuple[Grasp, float]]:
        gravity = float(np.linalg.norm(self.before.assembly.gravity))
        hold = self.arm.hand.acceleration_limit(self.item, self._held_by.object_tcp, gravity)
        self._no_grasp = "too_heavy", f"it weighs {self.item.mass:.3g} kg, and would slip from the fingers"
        return [(self._held_by, hold)] if hold > _LEAST_HOLD else []

    def _pick(self, number: int, margins: Margins) -> End | None:
        """It is in the hand, one way round."""
        return None if number % 2 else End(self.start[None], self.start[None])
