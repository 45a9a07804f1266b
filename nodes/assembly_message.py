"""Assembly, pushes and answers of the core <-> the messages of these names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Twist
from geometry_msgs.msg import Pose as PoseMessage
from shape_msgs.msg import Mesh as MeshMessage
from shape_msgs.msg import MeshTriangle, SolidPrimitive

from poise.assembly import Analysis, Assembly, Box, Cylinder, FrictionPair, Mesh, Push, RigidObject, Sphere, load_scene
from poise.assembly.robustness import Robustness, balance_findings, gap_findings, rolling_findings
from poise.assembly.scene import ROLLING, check_density, read_object, scene_findings
from poise.assembly.statics import NO_DEADLINE, Deadline
from poise.errors import ErrorCode, InputError
from poise.files import package_file
from poise.geometry import Pose
from poise.shape import check_mesh
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import AssemblyObject
from poise_msgs.msg import FrictionPair as FrictionPairMessage
from poise_msgs.msg import Push as PushMessage
from poise_msgs.msg import Robustness as RobustnessMessage

_MAX_OBJECTS = 2000
"""Of an assembly in a message: finding what touches takes time with its square."""
NOT_GIVEN = -1.0
"""Friction and rolling resistance of messages in which they are not given."""
_NAMED = 8
"""Objects with an assumption that are named one by one."""
_MODES = {
    "none": RobustnessMessage.MODE_NONE,
    "slip": RobustnessMessage.MODE_SLIP,
    "topple": RobustnessMessage.MODE_TOPPLE,
    "mixed": RobustnessMessage.MODE_MIXED,
    "roll": RobustnessMessage.MODE_ROLL,
}


def assembly_of(message: AssemblyMessage, folders: Sequence[Path] = ()) -> Assembly:
    """Read a message.

    Args:
        message: of poise_msgs.
        folders: in which files named by `mesh_uri` may lie, besides the share folders of packages.

    Raises:
        InputError: as `poise.assembly.read_scene`, naming the object.
    """
    gravity = _xyz(message.gravity)
    if not any(gravity):
        raise InputError(
            ErrorCode.BAD_INPUT,
            "gravity is not given (0 0 0): give it in the frame of the assembly, m/s2",
        )
    if len(message.objects) > _MAX_OBJECTS:
        raise InputError(ErrorCode.BAD_INPUT, f"{len(message.objects)} objects; an assembly has {_MAX_OBJECTS} at most")
    return Assembly(
        objects_of(message, folders),
        np.array(gravity),
        None if message.friction == NOT_GIVEN else message.friction,
        pairs_of(message),
        ROLLING if message.rolling == NOT_GIVEN else message.rolling,
        message.friction_std,
    )


def objects_of(message: AssemblyMessage, folders: Sequence[Path] = ()) -> tuple[RigidObject, ...]:
    """The objects of a message; raises as `assembly_of`."""
    return tuple(object_of(item, folders) for item in message.objects)


def pairs_of(message: AssemblyMessage) -> tuple[FrictionPair, ...]:
    """The friction pairs of a message."""
    return tuple(
        FrictionPair(
            (pair.objects[0], pair.objects[1]),
            pair.coefficient,
            pair.coefficient_std,
            None if pair.rolling == NOT_GIVEN else pair.rolling,
        )
        for pair in message.friction_pairs
    )


def object_of(message: AssemblyObject, folders: Sequence[Path] = ()) -> RigidObject:
    """One object, through the door of scene files: the same checks, the same words; raises as `assembly_of`."""
    inertia, place = message.inertia, message.pose
    content: dict[str, Any] = {
        "id": message.id,
        "fixed": message.fixed,
        "pose": [*_xyz(place.position), *_xyz(place.orientation), place.orientation.w],
        **_shape(message, folders),
    }
    if not message.fixed:
        content["mass"] = inertia.m
    moments = [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz]
    for name, values, given in (
        ("com", _xyz(inertia.com), message.com_given),
        ("inertia", moments, message.inertia_given),
    ):
        if given and name == "inertia" and not (any(values) or message.fixed):
            what = "inertia_given is true, but all numbers are 0: give it, or leave inertia_given false"
            raise InputError(ErrorCode.BAD_INPUT, f"object {message.id}: {what}")
        if given:
            content[name] = values
        elif np.any(np.nan_to_num(values)) and not message.fixed:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"object {message.id}: {name} is {values}, but {name}_given is false: set {name}_given, or leave it 0",
            )
    for name in ("covariance", "pose_covariance"):
        if len(getattr(message, name)):
            content[name] = list(getattr(message, name))
    item = read_object(content)
    require_body(item)
    return item


def require_body(item: RigidObject) -> None:
    """Raise unless a body of this shape can weigh what it should: units and frames are as they must be.

    Raises:
        InputError: OBJECT_INVALID for a density that no matter has, a centre of mass that is farther off the bounding
            box of the shape than the box is large, or an inertia that no matter in that distance has.
    """
    if item.fixed:
        return
    check_density(item)
    where, corners = f"object {item.id}: ", item.shape.polyhedron.vertices
    least, greatest = corners.min(axis=0), corners.max(axis=0)
    sides = greatest - least
    size = float(np.linalg.norm(sides))
    com = item.shape.centroid if item.com is None else item.com
    off = float(np.linalg.norm(np.maximum(0.0, np.maximum(least - com, com - greatest))))
    if off > size:
        what = f"com is {off:.3g} m off its shape: give it in m, in the object frame"
        raise InputError(ErrorCode.OBJECT_INVALID, where + what)
    if item.inertia is not None and np.trace(item.inertia) / 2 > item.mass * (2 * size) ** 2:
        what = f"inertia is far more than {item.mass:g} kg in {size:.3g} m have: give it in kg m2, about com"
        raise InputError(ErrorCode.OBJECT_INVALID, where + what)


def assumptions_of(assembly: Assembly) -> list[str]:
    """What an assembly does not give and what is used instead, one sentence each."""
    found = []
    for name, used in (("com", "taken at the centroid"), ("inertia", "taken as that of uniform density")):
        ids = [item.id for item in assembly.objects if not item.fixed and getattr(item, name) is None]
        found += [f"{one}: {name} not given; {used}" for one in ids[:_NAMED]]
        if len(ids) > _NAMED:
            found.append(f"{len(ids) - _NAMED} more objects: {name} not given; {used}")
    return found + [f"probably wrong: {finding.sentence}" for finding in scene_findings(assembly)]


def notes_of(analysis: Analysis, deadline: Deadline = NO_DEADLINE) -> list[str]:
    """What an assembly does not give, and what in it was found to roll before the deadline, one sentence each."""
    found = (*rolling_findings(analysis, deadline), *balance_findings(analysis), *gap_findings(analysis))
    return assumptions_of(analysis.assembly) + [finding.sentence for finding in found]


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _shape(message: AssemblyObject, folders: Sequence[Path]) -> dict[str, Any]:
    """The entry of a scene file that names the shape."""
    where = f"object {message.id}"
    if message.shape == AssemblyObject.SHAPE_PRIMITIVE:
        sizes = list(message.primitive.dimensions)
        if message.primitive.type == SolidPrimitive.BOX:
            return {"box": sizes}
        if message.primitive.type == SolidPrimitive.SPHERE and len(sizes) == 1:
            return {"sphere": sizes[SolidPrimitive.SPHERE_RADIUS]}
        if message.primitive.type == SolidPrimitive.CYLINDER and len(sizes) == 2:
            return {"cylinder": [sizes[SolidPrimitive.CYLINDER_RADIUS], sizes[SolidPrimitive.CYLINDER_HEIGHT]]}
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"{where}: primitive of type {message.primitive.type} with {len(sizes)} dimensions; give a box (3), a "
            "cylinder (2) or a sphere (1), or a mesh",
        )
    if message.shape == AssemblyObject.SHAPE_MESH:
        vertices = np.array([_xyz(vertex) for vertex in message.mesh.vertices]).reshape(-1, 3)
        triangles = np.array([face.vertex_indices for face in message.mesh.triangles], dtype=np.int64).reshape(-1, 3)
        mesh = check_mesh(vertices, triangles, name=where)
        return {"mesh": Mesh(mesh.vertices, mesh.triangles, notes=mesh.notes)}
    if message.shape == AssemblyObject.SHAPE_URI:
        return {"mesh": _allowed(message.mesh_uri, folders, where), "scale": message.mesh_scale}
    raise InputError(ErrorCode.OBJECT_INVALID, f"{where}: shape {message.shape} is none of primitive, mesh, URI")


def _allowed(uri: str, folders: Sequence[Path], where: str) -> str:
    """A package:// URI, or the path of a file in one of the folders: a message must not read what it likes."""
    if uri.startswith("package://"):
        return uri
    path = Path(uri.removeprefix("file://")).resolve()
    if not any(path.is_relative_to(folder.resolve()) for folder in folders):
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"{where}: mesh {uri!r} is outside the folders that messages may name; use package://, send the mesh "
            "itself, or add its folder to the parameter mesh_folders",
        )
    return str(path)


def scene_of_node(scene: str) -> Assembly:
    """The scene file of a node's parameter: a path or package:// URI.

    Raises:
        InputError: as `load_scene`.
    """
    return load_scene(package_file(scene))


def assembly_message(assembly: Assembly, frame_id: str) -> AssemblyMessage:
    """Turn an assembly into a message; meshes are sent in full, or by their package:// URI."""
    friction = NOT_GIVEN if assembly.friction is None else float(assembly.friction)
    deviation = float(assembly.friction_deviation)
    message = AssemblyMessage(friction=friction, friction_std=deviation, rolling=float(assembly.rolling))
    message.header.frame_id = frame_id
    gravity = message.gravity
    gravity.x, gravity.y, gravity.z = np.asarray(assembly.gravity).tolist()
    message.objects = [object_message(item) for item in assembly.objects]
    message.friction_pairs = [
        FrictionPairMessage(
            objects=list(pair.objects),
            coefficient=float(pair.coefficient),
            coefficient_std=float(pair.deviation),
            rolling=NOT_GIVEN if pair.rolling is None else float(pair.rolling),
        )
        for pair in assembly.friction_pairs
    ]
    return message


def object_message(item: RigidObject) -> AssemblyObject:
    """Turn one object into a message; as `assembly_message`."""
    message = AssemblyObject(id=item.id, fixed=item.fixed, pose=pose_message(item.pose), mesh_scale=1.0)
    shape, inertia = item.shape, message.inertia
    if isinstance(shape, Box):
        message.primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[float(size) for size in shape.size])
    elif isinstance(shape, Cylinder):
        sizes = [float(shape.length), float(shape.radius)]
        message.primitive = SolidPrimitive(type=SolidPrimitive.CYLINDER, dimensions=sizes)
    elif isinstance(shape, Sphere):
        message.primitive = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[float(shape.radius)])
    elif isinstance(shape, Mesh) and shape.source.startswith("package://"):
        message.shape, message.mesh_uri, message.mesh_scale = AssemblyObject.SHAPE_URI, shape.source, float(shape.scale)
    else:
        message.shape = AssemblyObject.SHAPE_MESH
        message.mesh = mesh_message(shape)
    inertia.m = float(item.mass)
    message.com_given, message.inertia_given = item.com is not None, item.inertia is not None
    com = [np.nan] * 3 if item.com is None else np.asarray(item.com).tolist()
    inertia.com.x, inertia.com.y, inertia.com.z = com
    moments = [np.nan] * 6 if item.inertia is None else np.asarray(item.inertia)[np.triu_indices(3)].tolist()
    inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz = moments
    if item.covariance is not None:
        message.covariance = np.ravel(item.covariance).tolist()
    if item.pose_covariance is not None:
        message.pose_covariance = np.ravel(item.pose_covariance).tolist()
    return message


def pose_message(pose: Pose) -> PoseMessage:
    """Turn a pose into a message."""
    message = PoseMessage()
    place, turn = message.position, message.orientation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = pose.vector.tolist()
    return message


def mesh_message(shape: Mesh) -> MeshMessage:
    """Turn a mesh into a message, in the object frame."""
    return MeshMessage(
        vertices=[Point(x=x, y=y, z=z) for x, y, z in shape.vertices.tolist()],
        triangles=[MeshTriangle(vertex_indices=triangle) for triangle in shape.triangles.astype(np.uint32)],
    )


def pushes_of(messages: Sequence[PushMessage], groups: Sequence[int]) -> list[Push | list[Push]]:
    """Read pushes; those of one group grow together, groups in ascending order.

    Raises:
        InputError: BAD_INPUT when there are groups, but not one for every push.
    """
    pushes = [Push(message.object, _xyz(message.point), _xyz(message.direction)) for message in messages]
    if not len(groups):
        return list(pushes)
    if len(groups) != len(pushes):
        raise InputError(ErrorCode.BAD_INPUT, f"{len(groups)} groups for {len(pushes)} pushes; give one each, or none")
    together: dict[int, list[Push]] = {group: [] for group in sorted(groups)}
    for group, push in zip(groups, pushes, strict=True):
        together[group].append(push)
    return list(together.values())


def robustness_message(result: Robustness, interval: tuple[float, float] | None = None) -> RobustnessMessage:
    """Turn an answer into a message; interval: N, over what is uncertain."""
    low, high = interval or (result.lower, result.upper)
    message = RobustnessMessage(
        interval_lower=float(low),
        interval_upper=float(high),
        robustness=float(result.robustness),
        lower=float(result.lower),
        upper=float(result.upper),
        mode=_MODES[result.mode],
        checked=bool(result.checked),
        doubtful=bool(result.doubtful),
        moves=list(result.moves),
    )
    for values in result.mechanism.tolist():
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y, twist.angular.z = values
        message.mechanism.append(twist)
    return message
