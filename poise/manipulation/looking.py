"""A sweep of a camera on the hand over a region: viewpoints that cover it, and a motion through them that is free."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin

from poise.assembly import Box, RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose, plane_axes, unit
from poise.manipulation.arm import Arm
from poise.manipulation.bodies import se3_of
from poise.manipulation.carrying import free_way
from poise.manipulation.cell import Cell
from poise.manipulation.execution import joined
from poise.manipulation.inverse import solutions
from poise.manipulation.timing import Limits, timed
from poise.scanning import Camera, Coverage, ViewOptions, ViewRegion
from poise.simulation import WaypointTrajectory
from poise.types import Array

_ROLLS = 8
_TRIES = 240
"""Viewpoints for which the arm is asked, the best first."""
_NEIGHBOURS = 3
"""Viewpoints to which a way is looked for from each, the nearest in joint space first."""
_DWELL = 0.3
"""s at rest at each viewpoint: longer than the period of the images."""
_BODY = (0.1, 0.03, 0.04)
"""m along the optical axes: a camera as large as a D435."""
_LEAST_SEEN, _WELL_SEEN = 0.25, 0.9
_LIMITS = Limits(speed=0.4, acceleration=3.0)


@dataclass(frozen=True, eq=False)
class LookPlan:
    """A sweep.

    Args:
        motion: from where the arm is through all viewpoints and back, at rest at each.
        eyes: (V, 3) m where the camera rests, in the scene, in order.
        seen: 0..1 of the region's faces that at least one view sees.
        notes: to read it with.
    """

    motion: WaypointTrajectory
    eyes: Array
    seen: float
    notes: tuple[str, ...]


def plan_look(
    arm: Arm,
    eye: tuple[str, Pose],
    camera: Camera,
    region: ViewRegion,
    obstacles: Sequence[RigidObject],
    start: Array,
    options: ViewOptions = ViewOptions(),  # noqa: B008
    seconds: float = 20.0,
    seed: int = 0,
    cancelled: Callable[[], bool] = lambda: False,
) -> LookPlan:
    """Plan a sweep.

    Args:
        arm: the robot, at its place in the scene.
        eye: a link, and the pose of the optical frame in it.
        camera: intrinsics.
        region: to see, in the scene. The arm stays out of it: what is in it is not known yet.
        obstacles: what else stands there.
        start: (J,) where the arm is.
        options: distances and number of views.
        seconds: for looking for ways.
        seed: same seed, same motion (unless time runs out).
        cancelled: whether to give up.

    Raises:
        InputError: FRAME_UNKNOWN, UNSUPPORTED for a camera that is not on the hand.
        NoAnswerError: UNREACHABLE, INTERPENETRATION where the arm is; CANCELLED.
    """
    arm, wrist_eye = _with_camera(arm, *eye)
    around = (*obstacles, RigidObject("region", Box(tuple(region.size.tolist())), region.pose, mass=0.0, fixed=True))
    cell = Cell(arm, around, 0.0)
    _require_free(cell, start)
    rng, deadline = np.random.default_rng(seed), time.monotonic() + seconds
    coverage = Coverage(region, camera, options, [box for box in map(_box, obstacles) if not _meets(box, region)])
    found = _viewpoints(arm, wrist_eye, coverage, cell, start, rng, cancelled)
    tour = _tour(arm, around, found, start, rng, deadline, cancelled)
    if not tour or coverage.seen < _LEAST_SEEN:
        raise NoAnswerError(
            ErrorCode.UNREACHABLE,
            f"sweep: the arm brings the camera to {max(len(tour) - 1, 0)} viewpoints, which see {coverage.seen:.0%} of"
            f" the region at {np.round(region.pose.translation, 3).tolist()}: come nearer, make room, or choose a"
            " smaller region",
        )
    point = np.array((arm.wrist_tcp.inverse() * wrist_eye).translation)
    motions = [part for way, at in tour for part in (*timed(arm, way, at, point, _LIMITS), _dwell(way[-1]))]
    eyes = np.array([(_wrist(arm, way[-1]) * wrist_eye).translation for way, _ in tour[:-1]])
    notes = () if coverage.seen >= _WELL_SEEN else (f"the sweep sees {coverage.seen:.0%} of the faces of its region",)
    return LookPlan(joined(motions), eyes, coverage.seen, notes)


def _require_free(cell: Cell, start: Array) -> None:
    if (touching := cell.touching(start)) is not None:
        raise NoAnswerError(
            ErrorCode.INTERPENETRATION,
            f"where the arm is, {touching[0]} touches {touching[1]}, or nearly: move it away from what is scanned",
        )


def _with_camera(arm: Arm, link: str, pose: Pose) -> tuple[Arm, pin.SE3]:
    """The arm with the camera's body, and the pose of the optical frame in the last joint's."""
    if not arm.model.existFrame(link):
        raise InputError(
            ErrorCode.FRAME_UNKNOWN, f"sweep: robot_description has no link {link}, which carries the camera"
        )
    frame = arm.model.frames[arm.model.getFrameId(link)]
    if frame.parentJoint != arm.wrist:
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"sweep: the camera is on {link}, which does not move with the hand: give a sweep file",
        )
    wrist_eye = frame.placement * se3_of(pose)
    behind = wrist_eye * pin.SE3(np.eye(3), np.array([0.0, 0.0, -_BODY[2] / 2]))
    geometry = arm.geometry.copy()
    geometry.addGeometryObject(pin.GeometryObject("camera", arm.wrist, behind, coal.Box(*_BODY)))
    return replace(arm, geometry=geometry), wrist_eye


def _viewpoints(
    arm: Arm,
    wrist_eye: pin.SE3,
    coverage: Coverage,
    cell: Cell,
    start: Array,
    rng: np.random.Generator,
    cancelled: Callable[[], bool],
) -> list[Array]:
    """For each chosen viewpoint (N, J) configurations, with the camera rolled about its axis."""
    eye_tool = wrist_eye.inverse() * arm.wrist_tcp
    far = np.linalg.norm(coverage.eyes - np.array(arm.base.act(arm.shoulder)), axis=1)
    preferred = 1 - far / far.max()
    found: list[Array] = []
    near = start
    for _ in range(_TRIES):
        number = coverage.best(preferred)
        if number is None:
            break
        _give_up(cancelled)
        configurations = _facing(arm, coverage.eyes[number], coverage.aims[number], eye_tool, cell, [near, start], rng)
        if len(configurations):
            coverage.choose(number)
            found.append(configurations)
            near = configurations[0]
        else:
            coverage.refuse(number)
    return found


def _facing(
    arm: Arm, eye: Array, aim: Array, eye_tool: pin.SE3, cell: Cell, near: list[Array], rng: np.random.Generator
) -> Array:
    """(N, J) free configurations with which the camera stands at a place and looks at a point, the nearest first."""
    forwards = unit(aim - eye)
    side, other = plane_axes(forwards)
    found = []
    for roll in 2 * np.pi * np.arange(_ROLLS) / _ROLLS:
        right = np.cos(roll) * side + np.sin(roll) * other
        rotation = np.column_stack([right, np.cross(forwards, right), forwards])
        found += [q for q in solutions(arm, pin.SE3(rotation, eye) * eye_tool, near, rng, 2) if cell.free(q)][:1]
    return np.array(sorted(found, key=lambda q: float(np.abs(q - near[0]).max())))


def _tour(
    arm: Arm,
    around: tuple[RigidObject, ...],
    found: list[Array],
    start: Array,
    rng: np.random.Generator,
    deadline: float,
    cancelled: Callable[[], bool],
) -> list[tuple[Array, Cell]]:
    """Ways through the viewpoints, each from the one before to one that is near in joint space, and back to the start.

    A viewpoint to which there is no way is left out.
    """
    left, here, tour = list(found), start, list[tuple[Array, Cell]]()
    while left:
        pairs = [(float(np.abs(q - here).max()), number, q) for number, qs in enumerate(left) for q in qs]
        pairs.sort(key=lambda pair: pair[0])
        taken = pairs[0][1]
        for _, number, q in pairs[:_NEIGHBOURS]:
            _give_up(cancelled)
            until = time.monotonic() + (deadline - time.monotonic()) / (len(left) + 1)
            way = free_way(arm, here, q, (around, 0.0, None), rng, until)
            if way is not None:
                tour.append(way)
                here, taken = q, number
                break
        left.pop(taken)
    if not tour:
        return []
    back = free_way(arm, here, start, (around, 0.0, None), rng, deadline + 1.0)
    if back is None:  # the way out is a way back
        back = np.concatenate([way for way, _ in tour])[::-1], tour[0][1]
    return [*tour, back]


def _dwell(q: Array) -> WaypointTrajectory:
    still = np.zeros((2, len(q)))
    return WaypointTrajectory(np.array([0.0, _DWELL]), np.stack([q, q]), still, still)


def _wrist(arm: Arm, q: Array) -> pin.SE3:
    return arm.tool(q) * arm.wrist_tcp.inverse()


def _box(item: RigidObject) -> tuple[Array, Array]:
    corners = item.vertices
    return corners.min(axis=0), corners.max(axis=0)


def _meets(box: tuple[Array, Array], region: ViewRegion) -> bool:
    """Whether an obstacle is in the region, or it stands on it: that hides nothing before the region."""
    half = region.size / 2 + 0.01
    corners = region.pose.apply(np.array(np.meshgrid(*zip(-half, half, strict=True))).reshape(3, -1).T)
    return bool(np.all(corners.min(axis=0) < box[1]) and np.all(corners.max(axis=0) > box[0]))


def _give_up(cancelled: Callable[[], bool]) -> None:
    if cancelled():
        raise NoAnswerError(ErrorCode.CANCELLED, "sweep: cancelled")
