"""Planning scenes of MoveIt: moveit_msgs/PlanningScene as YAML or JSON, and the text of RViz (`.scene`)."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from poise.assembly import Assembly, Box, Cylinder, Mesh, RigidObject, Sphere
from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.files import yaml_documents
from poise.geometry import Pose
from poise.shape import check_mesh
from poise.worlds import solids
from poise.worlds.base import WorldBody, WorldContent, WorldFormat, WorldSolid

_BOX, _SPHERE, _CYLINDER, _CONE = 1, 2, 3, 4
"""shape_msgs/SolidPrimitive."""
_FRAME = "world"


class MoveItFormat(WorldFormat):
    """Objects without masses and friction: give them beside the file. What the robot holds is left out."""

    name = "moveit"
    description = "MoveIt, a PlanningScene message as YAML or JSON, or the text that RViz saves"
    suffixes = (".scene", ".json", ".yaml", ".yml")

    def recognises(self, head: bytes) -> bool:
        """See `WorldFormat`. A scene file of Poise has `objects`, and no `collision_objects`."""
        return b"collision_objects" in head or b"\n* " in head or b"planning_scene" in head

    def read(self, path: Path) -> WorldContent:
        """See `WorldFormat`."""
        try:
            text = path.read_text(encoding="utf-8")
            if path.suffix.lower() == ".scene":
                return WorldContent(tuple(_bodies_of_text(text)))
            content = next(yaml_documents(text), None)  # ros2 topic echo ends each message with ---
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: {' '.join(str(error).split())}") from error
        except (ValueError, IndexError, StopIteration, RuntimeError) as error:
            what = f"{path}: the text ends early, or has a word in the place of a number; save it again"
            raise InputError(ErrorCode.FILE_CORRUPT, what) from error
        try:
            return _content_of_message(content or {})
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not a PlanningScene: {error!r}") from error

    def written(self, assembly: Assembly, path: Path) -> tuple[bytes, tuple[str, ...]]:
        """See `WorldFormat`: the text of RViz, or for `.json` a PlanningScene that adds the objects (`is_diff`)."""
        lost: tuple[str, ...] = ("MoveIt knows neither masses nor friction",)
        if not np.allclose(assembly.gravity, WorldContent(()).gravity, atol=0.01):
            along = ", ".join(f"{value:.4g}" for value in assembly.gravity)
            lost += (f"MoveIt has no gravity: this scene has ({along}) m/s2, the file is read with 9.81 m/s2 along -z",)
        if path.suffix.lower() == ".scene":
            lines = [path.stem, *(line for item in assembly.objects for line in _text_of(item)), ".", ""]
            return "\n".join(lines).encode(), lost
        items = [_message_of(item) for item in assembly.objects]
        return json.dumps({"is_diff": True, "world": {"collision_objects": items}}, indent=1).encode(), lost


def _content_of_message(scene: Mapping[str, Any]) -> WorldContent:
    items = (scene.get("world") or {}).get("collision_objects") or []
    frames = {item["header"]["frame_id"] for item in items}
    if len(frames) > 1:
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"the objects are in several frames: {', '.join(sorted(frames))}")
    notes = ["the scene is a difference (is_diff): it lacks what did not change"] if scene.get("is_diff") else []
    held = (scene.get("robot_state") or {}).get("attached_collision_objects") or []
    notes += [f"{one['object']['id']}: the robot holds it; left out" for one in held]
    notes += [f"{item['id']}: its planes are left out" for item in items if item.get("planes")]
    return WorldContent(tuple(_body(item) for item in items), notes=tuple(notes))


def _body(item: Mapping[str, Any]) -> WorldBody:
    name = item["id"]
    if item.get("operation", 0) not in (0, b"\0", "\0"):
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: operation {item['operation']!r} is not that of ADD")
    primitives, meshes = item.get("primitives") or [], item.get("meshes") or []
    found = [
        WorldSolid(_primitive(each["type"], each["dimensions"], name), _pose(place))
        for each, place in _with_poses(primitives, item.get("primitive_poses"))
    ]
    found += [
        WorldSolid(
            _mesh(
                [[float(vertex[axis]) for axis in "xyz"] for vertex in mesh["vertices"]],
                [list(face["vertex_indices"]) for face in mesh["triangles"]],
                name,
            ),
            _pose(place),
        )
        for mesh, place in _with_poses(meshes, item.get("mesh_poses"))
    ]
    if not found:
        raise InputError(ErrorCode.OBJECT_INVALID, f"{name}: it has no primitive and no mesh")
    return WorldBody(name, _pose(item.get("pose")), tuple(found), fixed=False)


def _with_poses(items: Sequence[Any], poses: Sequence[Any] | None) -> Iterator[tuple[Any, Any]]:
    return zip(items, poses or [None] * len(items), strict=True)


def _primitive(kind: int, sizes: Sequence[float], where: str) -> Shape:
    if kind == _BOX:
        return solids.box(np.array(_sizes(sizes, 3, where)))
    if kind == _SPHERE:
        return solids.sphere(*_sizes(sizes, 1, where))
    if kind in (_CYLINDER, _CONE):
        length, radius = _sizes(sizes, 2, where)
        return solids.cylinder(radius, length) if kind == _CYLINDER else solids.cone(radius, length)
    raise InputError(ErrorCode.UNSUPPORTED, f"{where}: primitive type {kind}; 1 to 4 (box to cone) are read")


def _sizes(numbers: Sequence[float], count: int, where: str) -> list[float]:
    """The sizes of a primitive, as many as it has.

    Raises:
        InputError: OBJECT_INVALID.
    """
    if len(numbers) != count:
        what = f"{where}: its shape has {len(numbers)} sizes, expected {count}"
        raise InputError(ErrorCode.OBJECT_INVALID, what, object=where)
    return [float(size) for size in numbers]


def _mesh(vertices: Sequence[Sequence[float]], triangles: Sequence[Sequence[int]], where: str) -> Mesh:
    whole = check_mesh(np.array(vertices), np.array(triangles), name=where)
    return Mesh(whole.vertices, whole.triangles, notes=whole.notes)


def _pose(content: Mapping[str, Any] | None) -> Pose:
    """Of geometry_msgs/Pose; a pose whose quaternion is zero (a field that was left out) is the identity."""
    content = content or {}
    position, turn = content.get("position", {}), content.get("orientation", {})
    quaternion = [float(turn.get(axis, 0.0)) for axis in "xyzw"]
    quaternion = quaternion if any(quaternion) else [0.0, 0.0, 0.0, 1.0]
    return Pose.from_vector(np.array([*(float(position.get(axis, 0.0)) for axis in "xyz"), *quaternion]))


def _primitive_of(shape: Box | Cylinder | Sphere) -> tuple[int, tuple[float, ...]]:
    """Type and dimensions of shape_msgs/SolidPrimitive."""
    if isinstance(shape, Box):
        return _BOX, shape.size
    return (_CYLINDER, (shape.length, shape.radius)) if isinstance(shape, Cylinder) else (_SPHERE, (shape.radius,))


def _message_of(item: RigidObject) -> dict[str, Any]:
    """moveit_msgs/CollisionObject."""
    shape = item.shape
    content: dict[str, Any] = {"header": {"frame_id": _FRAME}, "id": item.id, "pose": _pose_message(item.pose)}
    identity = _pose_message(Pose.identity())
    if isinstance(shape, Box | Cylinder | Sphere):
        kind, sizes = _primitive_of(shape)
        content["primitives"] = [{"type": kind, "dimensions": [float(size) for size in sizes]}]
        return content | {"primitive_poses": [identity]}
    surface = shape.polyhedron
    vertices = [dict(zip("xyz", vertex, strict=True)) for vertex in surface.vertices.tolist()]
    triangles = [{"vertex_indices": face} for face in surface.triangles.tolist()]
    return content | {"meshes": [{"vertices": vertices, "triangles": triangles}], "mesh_poses": [identity]}


def _pose_message(pose: Pose) -> dict[str, dict[str, float]]:
    x, y, z, qx, qy, qz, qw = pose.vector.tolist()
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}}


def _bodies_of_text(text: str) -> Iterator[WorldBody]:
    """The objects of `PlanningScene::saveGeometryToStream`; older texts have neither poses of objects nor subframes."""
    lines = iter([line.strip() for line in text.splitlines()[1:]])

    def numbers() -> list[float]:
        return [float(word) for word in next(lines).split()]

    def pose(position: list[float]) -> Pose:
        return Pose.from_vector(np.array([*position, *numbers()]))

    for line in lines:
        if line == ".":
            return
        if not line.startswith("* "):
            continue
        name, first = line[2:], numbers()
        newer = len(first) == 3
        place = pose(first) if newer else Pose.identity()
        count = int(numbers()[0]) if newer else int(first[0])
        found = []
        for _ in range(count):
            shape = _shape_of_text(next(lines), numbers, name)
            found.append(WorldSolid(shape, pose(numbers())))
            next(lines)  # its colour
        for _ in range(int(numbers()[0]) if newer else 0):
            for _ in range(3):  # a subframe: name, position, orientation
                next(lines)
        yield WorldBody(name, place, tuple(found), fixed=False)


def _text_of(item: RigidObject) -> Iterator[str]:
    """One object in the text of RViz: its pose, its shape, where that is in the object, and a colour."""
    shape, surface = item.shape, item.shape.polyhedron
    x, y, z, *turn = (f"{value!r}" for value in item.pose.vector.tolist())
    yield from (f"* {item.id}", f"{x} {y} {z}", " ".join(turn), "1")
    if isinstance(shape, Box):
        yield from ("box", " ".join(f"{float(size)!r}" for size in shape.size))
    elif isinstance(shape, Cylinder):
        yield from ("cylinder", f"{float(shape.radius)!r} {float(shape.length)!r}")
    elif isinstance(shape, Sphere):
        yield from ("sphere", f"{float(shape.radius)!r}")
    else:
        yield from ("mesh", f"{len(surface.vertices)} {len(surface.triangles)}")
        yield from (" ".join(map(repr, row)) for row in [*surface.vertices.tolist(), *surface.triangles.tolist()])
    yield from ("0 0 0", "0 0 0 1", "0 0 0 0", "0")


def _shape_of_text(kind: str, numbers: Callable[[], list[float]], where: str) -> Shape:
    sizes = numbers()
    if kind == "mesh":
        vertices = [numbers() for _ in range(int(sizes[0]))]
        return _mesh(vertices, [[int(each) for each in numbers()] for _ in range(int(sizes[1]))], where)
    if kind == "box":
        return solids.box(np.array(_sizes(sizes, 3, where)))
    if kind == "sphere":
        return solids.sphere(*_sizes(sizes, 1, where))
    if kind in ("cylinder", "cone"):
        radius, length = _sizes(sizes, 2, where)
        return solids.cylinder(radius, length) if kind == "cylinder" else solids.cone(radius, length)
    raise InputError(ErrorCode.UNSUPPORTED, f"{where}: a shape {kind}; box, sphere, cylinder, cone, mesh are read")
