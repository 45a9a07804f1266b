"""The numbers of a request are in their ranges; checked once, before anything is computed."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from poise.errors import ErrorCode, InputError
from poise.ranges import check_covariance, check_range, directions_of, vectors
from poise.robot import RobotModel
from poise_msgs.srv import SetAssembly

_MOST_VERTICES = 3
"""Vertices per mesh triangle that a call may bring: those of triangles that share none."""


class CallLimits(NamedTuple):
    """The largest numbers of things in one call; triangles: of the meshes in messages."""

    objects: int = 2000
    pushes: int = 10_000
    map_points: int = 100_000
    triangles: int = 500_000
    bytes: int = 64_000_000


def check_request(request: Any, limits: CallLimits) -> None:
    """Raise for the first number of a request of the robustness services that is out of its range.

    Raises:
        InputError: as `check_range`; BAD_INPUT for more of something than `limits` allow.
    """
    if hasattr(request, "pushes"):
        _check_count("pushes", len(request.pushes), limits.pushes)
        _check_count("map_points", request.map_points, limits.map_points)
    if request.__class__ is SetAssembly.Request:
        if request.operation == SetAssembly.Request.REMOVE:
            _check_count("objects", len(request.assembly.objects), limits.objects)
        elif request.operation in (SetAssembly.Request.REPLACE, SetAssembly.Request.ADD_OR_MOVE):
            _check_assembly(request.assembly, limits, whole=request.operation == SetAssembly.Request.REPLACE)
        else:
            what = f"operation {request.operation} is none of REPLACE, ADD_OR_MOVE, REMOVE"
            raise InputError(ErrorCode.BAD_INPUT, what)
    else:
        for assembly in request.assembly:
            _check_assembly(assembly, limits, whole=True)
    if request.deadline != 0:
        check_range("deadline", request.deadline)
    if hasattr(request, "pushes"):
        if request.map_tolerance != 0:
            check_range("map_tolerance", request.map_tolerance)
        _check_pushes(request.pushes)


def check_assembly(message: Any, limits: CallLimits = CallLimits()) -> None:  # noqa: B008  # a value that never changes
    """Raise for the first number of a poise_msgs/Assembly that is out of its range; as `check_request`."""
    _check_assembly(message, limits, whole=True)


def check_object(message: Any) -> None:
    """Raise for the first number of a poise_msgs/AssemblyObject that is out of its range; as `check_range`."""
    check_range("characters of an id", len(message.id), "object: ")
    where = f"object {message.id}: "
    check_range("position", _xyz(message.pose.position), where)
    check_range("position", [*_xyz(message.pose.orientation), message.pose.orientation.w], where)
    _check_shape(message, where)
    if message.fixed:
        return
    inertia = message.inertia
    check_range("mass", inertia.m, where)
    if message.com_given:
        check_range("com", _xyz(inertia.com), where)
    if message.inertia_given:
        moments = [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz]
        check_range("inertia", moments, where)
    if len(message.covariance):
        check_covariance(message.covariance, where)
    if len(message.pose_covariance):
        check_covariance(message.pose_covariance, where, name="pose_covariance")


def _check_assembly(message: Any, limits: CallLimits, whole: bool) -> None:
    _check_count("objects", len(message.objects), limits.objects)
    _check_count("friction_pairs", len(message.friction_pairs), limits.objects**2)
    _check_count("mesh triangles", sum(len(item.mesh.triangles) for item in message.objects), limits.triangles)
    vertices = sum(len(item.mesh.vertices) for item in message.objects)
    _check_count("mesh vertices", vertices, _MOST_VERTICES * limits.triangles)
    gravity = _xyz(message.gravity)
    if whole or any(gravity):
        if not any(gravity):
            raise InputError(ErrorCode.BAD_INPUT, "gravity is not given (0 0 0): give it in the frame of the assembly")
        check_range("gravity", math.hypot(*gravity))
    if message.friction != -1.0:
        check_range("friction", message.friction)
    check_range("friction", message.friction_std, "friction_std: ")
    _check_rolling(message.rolling)
    for pair in message.friction_pairs:
        where = f"friction_pairs of {pair.objects[0]} and {pair.objects[1]}: "
        check_range("friction", [pair.coefficient, pair.coefficient_std], where)
        _check_rolling(pair.rolling, where)
    for item in message.objects:
        check_object(item)


def _check_rolling(value: float, where: str = "") -> None:
    if value != -1.0:
        check_range("rolling", value, where)


def _check_shape(message: Any, where: str) -> None:
    if message.shape == message.SHAPE_PRIMITIVE:
        check_range("size", list(message.primitive.dimensions), where)
    elif message.shape == message.SHAPE_URI:
        check_range("mesh_scale", message.mesh_scale, where)
    else:
        check_range("mesh vertex", [_xyz(vertex) for vertex in message.mesh.vertices], where)


def _check_pushes(pushes: Iterable[Any]) -> None:
    rows = list(pushes)
    vectors("point", [_xyz(push.point) for push in rows], where="pushes: ")
    directions_of([_xyz(push.direction) for push in rows], "pushes: ")


def _check_count(name: str, count: int, most: int) -> None:
    if count > most:
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: {count} in one call; this server takes {most} at most")


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def newer_description(text: str, before: str) -> str:
    """The robot description to use from here on; before any is known (empty), an invalid one is taken, to be reported.

    Raises:
        InputError: for an invalid one, which does not replace what is known.
    """
    if before:
        RobotModel.from_urdf(text)
    return text
