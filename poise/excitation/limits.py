"""What a motion must keep to: joints, the speed of whatever moves along with the hand, and how far that may go."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel
from poise.types import Array

COLLABORATIVE_SPEED = 0.25
"""m/s: the reduced speed of ISO 10218-1, which ISO/TS 15066 takes over for work beside people."""

_ACCELERATION = 10.0
"""rad/s2 or m/s2 of a joint, by default: what the maker of the FR3 allows each of its joints."""

_MARGIN = 0.05
"""rad or m kept from the ends of a joint's range."""

_BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""Joints of a driving base, by their names in the contract: it stands still while the arm moves."""


@dataclass(frozen=True)
class MotionLimits:
    """Bounds of an identification motion.

    Args:
        speed: m/s that no point of hand and object exceeds.
        joint_speed: share of each joint's velocity limit.
        acceleration: rad/s2 (m/s2) of any joint, which a URDF does not say.
        room: m that the tool centre point may go from where it starts.

    Raises:
        InputError: BAD_INPUT for a number that is not positive, or a share above one.
    """

    speed: float = COLLABORATIVE_SPEED
    joint_speed: float = 0.8
    acceleration: float = _ACCELERATION
    room: float = 0.15

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise InputError(ErrorCode.BAD_INPUT, f"motion limit {name} is {value}: it must be a positive number")
        if self.joint_speed > 1:
            raise InputError(ErrorCode.BAD_INPUT, f"joint_speed is a share of the limit: {self.joint_speed} is above 1")


@dataclass(frozen=True, eq=False)
class Guard:
    """The points that have to stay slow, all rigid with the sensor: balls about points cover an object.

    Args:
        points: (P, 3) m in the sensor frame; the first is the tool centre point.
        radius: m of the ball about each.
    """

    points: Array
    radius: float = 0.0
    tcp: Array = field(init=False)

    def __post_init__(self) -> None:
        points = np.atleast_2d(np.asarray(self.points, dtype=np.float64))
        if points.shape[1:] != (3,) or not np.isfinite(points).all():
            raise InputError(ErrorCode.NOT_FINITE, "the object's outline must be rows of three finite numbers, m")
        if not (np.isfinite(self.radius) and self.radius >= 0):
            raise InputError(ErrorCode.BAD_INPUT, f"the object's radius is {self.radius} m: it must be zero or more")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "tcp", points[0])

    @classmethod
    def ball(cls, tcp: ArrayLike, radius: float) -> "Guard":
        """An object of unknown shape, nowhere farther than `radius` m from the tool centre point (3,) m."""
        return cls(np.asarray(tcp, dtype=np.float64)[None], radius)

    @classmethod
    def outline(cls, tcp: ArrayLike, corners: ArrayLike, margin: float = 0.0) -> "Guard":
        """The hull of corners (P, 3) m in the sensor frame, known to within `margin` m.

        Speed is a convex function of the place in a rigid body, so the corners of the hull are enough.
        """
        return cls(np.vstack([np.asarray(tcp, dtype=np.float64), _hull(np.asarray(corners, dtype=np.float64))]), margin)

    @property
    def reach(self) -> float:
        """m from the sensor's origin to the farthest point."""
        return float(np.linalg.norm(self.points, axis=1).max()) + self.radius


def tool_centre(model: RobotModel, frame: str) -> Array:
    """(3,) m: origin of the tool frame in the sensor frame; the sensor's own origin when `frame` is empty.

    Raises:
        InputError: FRAME_UNKNOWN when there is no such frame, or a joint lies between it and the sensor.
    """
    if not frame:
        return np.zeros(3)
    sensor, tool = (model.pinocchio.frames[model.frame_id(name)] for name in (model.sensor_frame, frame))
    if sensor.parentJoint != tool.parentJoint:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN, f"a joint moves {frame} against {model.sensor_frame}: name a frame fixed to it"
        )
    return np.asarray(sensor.placement.actInv(tool.placement).translation)


def check_start(model: RobotModel, start: ArrayLike) -> Array:
    """(J,) the joints at the beginning.

    Raises:
        InputError: TYPE_MISMATCH, NOT_FINITE, or JOINT_LIMIT when it is outside a joint's range.
    """
    position = np.asarray(start, dtype=np.float64)
    names = model.joint_names
    if position.shape != (len(names),):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"start: {position.size} numbers for the joints {', '.join(names)}")
    if not np.isfinite(position).all():
        raise InputError(ErrorCode.NOT_FINITE, "start: a joint position is not a finite number")
    for name, value, lower, upper in zip(names, position, model.lower, model.upper, strict=True):
        if not lower <= value <= upper:
            raise InputError(
                ErrorCode.JOINT_LIMIT, f"start: {name} is at {value:.4f}, outside its range {lower:.4f} to {upper:.4f}"
            )
    return position


def position_range(model: RobotModel, start: Array) -> tuple[Array, Array]:
    """(J,) twice: where joints may go; a margin inside their ranges, unless they start nearer to the end than that."""
    return np.minimum(model.lower + _MARGIN, start), np.maximum(model.upper - _MARGIN, start)


def moving_joints(model: RobotModel, names: "tuple[str, ...]" = ()) -> Array:
    """(J,) one for joints that may move, zero for others: those named, or all but a driving base's.

    Raises:
        InputError: JOINT_MISSING.
    """
    unknown = [name for name in names if name not in model.joint_names]
    if unknown:
        raise InputError(
            ErrorCode.JOINT_MISSING,
            f"the robot has no joint {', '.join(unknown)}; it has {', '.join(model.joint_names)}",
            missing=unknown,
        )
    wanted = names or [name for name in model.joint_names if name not in _BASE_JOINTS]
    return np.array([float(name in wanted) for name in model.joint_names])


def _hull(corners: Array) -> Array:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(corners[ConvexHull(corners).vertices])
    except (QhullError, ValueError):  # flat, or a few points only
        return corners
