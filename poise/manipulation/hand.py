"""A two-finger gripper: how far it opens, where its fingers then are, and how hard it holds."""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from poise.assembly import RigidObject
from poise.geometry import unit
from poise.types import Array

_HALF_TURN = pin.SE3(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


@dataclass(frozen=True)
class Hand:
    """Parallel fingers that close along y of the tool frame, which is between the tips and looks out of them along z.

    The defaults are a Robotiq 2F-85's (its manual, chapter 6) with half of its greatest force.

    Args:
        stroke: m, the widest opening.
        finger: m, width along x, thickness along y and free length along z of a finger.
        clearance: m, by which each finger is opened wider than what it grasps, where the stroke allows it.
        least_clearance: m, without which nothing is grasped.
        force: N, of the grip.
        friction: Coulomb coefficient between pads and objects.
        pad_radius: m, of the disc that stands for what a pad touches.
    """

    stroke: float = 0.085
    finger: tuple[float, float, float] = (0.022, 0.012, 0.04)
    clearance: float = 0.01
    least_clearance: float = 0.004
    force: float = 100.0
    friction: float = 0.5
    pad_radius: float = 0.011

    @property
    def widest(self) -> float:
        """m, of what is grasped."""
        return self.stroke - 2 * self.least_clearance

    def opening(self, width: float) -> float:
        """m, to which the fingers open for an object of a width."""
        return min(self.stroke, width + 2 * self.clearance)

    def fingers(self, opening: float) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
        """Both fingers at an opening, in the tool frame."""
        x, y, z = self.finger
        places = (np.array([0.0, sign * (opening + y) / 2, -z / 2]) for sign in (-1, 1))
        return [(coal.Box(x, y, z), pin.SE3(np.eye(3), place)) for place in places]

    def acceleration_limit(self, item: RigidObject, object_tcp: pin.SE3, gravity: float) -> float:
        """m/s2 of the object's centre of mass that the grip holds in any direction; negative when it cannot hold it.

        The pads bear a force across and a torque about the closing direction inside the limit surface of two discs
        (an ellipsoid: Howe and Cutkosky 1996, "Practical force-motion models for sliding manipulation"); what acts
        along the closing direction, the fingers bear.
        """
        com = item.pose.undo(item.com_in_world) - object_tcp.translation
        closing = object_tcp.rotation[:, 1]
        lever = float(np.linalg.norm(com - (com @ closing) * closing))
        most = 2 * self.friction * self.force
        per_force = np.hypot(1 / most, lever / (most * 2 / 3 * self.pad_radius))
        return float(1 / (item.mass * per_force) - gravity)


@dataclass(frozen=True, eq=False)
class Grasp:
    """Two opposite places of an object between the fingers.

    Args:
        object_tcp: pose of the tool frame in the object's.
        width: m, between the places.
    """

    object_tcp: pin.SE3
    width: float

    @property
    def turned(self) -> "Grasp":
        """The same grasp with the fingers in each other's place."""
        return Grasp(self.object_tcp * _HALF_TURN, self.width)

    @property
    def approach(self) -> Array:
        """(3,) unit vector in the object frame along which the hand comes."""
        return unit(np.array(self.object_tcp.rotation[:, 2]))
