"""The arm among the objects of a scene: whether a configuration, or a straight way between two, touches anything."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from poise.assembly import RigidObject
from poise.manipulation.arm import Arm
from poise.manipulation.bodies import geometry_of, se3_of
from poise.manipulation.hand import Grasp
from poise.types import Array

ROBOT_CLEARANCE = 0.003
"""m between the robot and anything else."""
HELD_CLEARANCE = 0.005
"""m between what is held and anything else."""
CHECK_STEP = 0.025
"""rad between configurations that are looked at on a way: 1 cm to either side, at 0.8 m from the joint."""


class Cell:
    """Collision questions about one arm, one opening of its hand, one set of obstacles and perhaps something held.

    Args:
        arm: the robot.
        obstacles: what stands around, at its pose.
        opening: m, of the fingers.
        held: an object and how it is grasped; it may touch the hand.
        margins: m, of the robot and of what is held from everything else.
    """

    def __init__(
        self,
        arm: Arm,
        obstacles: Sequence[RigidObject],
        opening: float,
        held: tuple[RigidObject, Grasp] | None = None,
        margins: tuple[float, float] = (ROBOT_CLEARANCE, HELD_CLEARANCE),
    ) -> None:
        self._arm = arm
        self._geometry = arm.geometry.copy()
        self._geometry.removeAllCollisionPairs()
        robot = list(range(self._geometry.ngeoms))
        for number, (shape, place) in enumerate(arm.hand.fingers(opening)):
            robot.append(self._add(f"finger {number}", arm.wrist, arm.wrist_tcp * place, shape))
        from_scene = arm.base.inverse()
        around = [
            self._add(f"object {item.id}", 0, from_scene * se3_of(item.pose), geometry_of(item.shape))
            for item in obstacles
        ]
        kept: list[float] = []
        for i, j in arm.self_pairs:
            self._pair(i, j, 0.0, kept)
        for i in robot:
            # The root and the column on it stay where they are, on what they stand on.
            for j in around if self._geometry.geometryObjects[i].parentJoint > 1 else ():
                self._pair(i, j, margins[0], kept)
        if held is not None:
            item, grasp = held
            place = arm.wrist_tcp * grasp.object_tcp.inverse()
            carried = self._add("held", arm.wrist, place, geometry_of(item.shape))
            for j in around:
                self._pair(carried, j, margins[1], kept)
            for i in robot:
                if self._geometry.geometryObjects[i].parentJoint < arm.wrist - 1:
                    self._pair(i, carried, margins[1], kept)
        self._data = self._geometry.createData()
        for request, margin in zip(self._data.collisionRequests, kept, strict=True):
            request.security_margin = margin

    def _add(self, name: str, joint: int, place: pin.SE3, shape: object) -> int:
        return int(self._geometry.addGeometryObject(pin.GeometryObject(name, joint, place, shape)))

    def _pair(self, i: int, j: int, margin: float, kept: list[float]) -> None:
        self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        kept.append(margin)

    def free(self, q: Array) -> bool:
        """Whether nothing touches anything at a configuration (J,)."""
        return not pin.computeCollisions(self._arm.model, self._arm.data, self._geometry, self._data, q, True)

    def free_between(self, start: Array, end: Array) -> bool:
        """Whether nothing touches anything on the straight way between configurations, the end included."""
        count = int(np.ceil(np.abs(end - start).max() / CHECK_STEP))
        # The end and every other one first: what is not free is then known in half of the time.
        order = (*range(count, 0, -2), *range(count - 1, 0, -2))
        return all(self.free(start + (end - start) * k / count) for k in order)

    def touching(self, q: Array) -> tuple[str, str] | None:
        """The first pair of shapes that touch, by name."""
        if self.free(q):
            return None
        number = next(i for i, result in enumerate(self._data.collisionResults) if result.isCollision())
        pair = self._geometry.collisionPairs[number]
        shapes = self._geometry.geometryObjects
        return shapes[pair.first].name, shapes[pair.second].name
