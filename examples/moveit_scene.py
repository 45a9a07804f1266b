"""A MoveIt planning scene as a scene of Poise, and back, without moveit_msgs.

ros2 topic echo --once --full-length monitored_planning_scene moveit_msgs/msg/PlanningScene > planning_scene.yaml
python examples/moveit_scene.py to-poise planning_scene.yaml --masses masses.yaml --friction 0.5 --output scene.yaml
poise msa scene.yaml --directions 36
python examples/moveit_scene.py to-moveit scene.yaml --frame world --output planning_scene.yaml

Reads and writes the YAML (or JSON) of moveit_msgs/PlanningScene. MoveIt does not know masses: `--masses` is a file with
`id: kg`; an object without a mass is fixed. Objects of several shapes, spheres and cones become meshes beside the
output. What the hand holds (attached objects), planes and octomaps are left out; stderr lists them. MoveIt publishes
the whole scene once, and then differences (`is_diff`), which lack what did not change; stderr says so.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from poise.assembly import Assembly, Box, Cylinder, load_scene
from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import Pose
from poise.shape import check_mesh

BOX, SPHERE, CYLINDER, CONE = 1, 2, 3, 4
"""shape_msgs/SolidPrimitive."""


def pose_of(content: Mapping[str, Any] | None) -> Pose:
    """Of geometry_msgs/Pose; a pose whose quaternion is zero (a field that was left out) is the identity."""
    content = content or {}
    position, turn = content.get("position", {}), content.get("orientation", {})
    quaternion = [float(turn.get(axis, 0.0)) for axis in "xyzw"]
    quaternion = quaternion if any(quaternion) else [0.0, 0.0, 0.0, 1.0]
    return Pose.from_vector(np.array([*(float(position.get(axis, 0.0)) for axis in "xyz"), *quaternion]))


def matrix_of(content: Mapping[str, Any] | None) -> np.ndarray:
    """(4, 4) of geometry_msgs/Pose."""
    pose, matrix = pose_of(content), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def pose_content(pose: Pose) -> dict[str, dict[str, float]]:
    """geometry_msgs/Pose."""
    x, y, z, qx, qy, qz, qw = pose.vector.tolist()
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}}


def solid(primitive: Mapping[str, Any], where: str) -> trimesh.Trimesh:
    """The surface of a SolidPrimitive, about its own frame."""
    kind, sizes = primitive["type"], list(primitive["dimensions"])
    if kind == BOX:
        return trimesh.creation.box(sizes[:3])
    if kind == SPHERE:
        return trimesh.creation.icosphere(subdivisions=3, radius=sizes[0])
    if kind == CYLINDER:
        return trimesh.creation.cylinder(radius=sizes[1], height=sizes[0], sections=48)
    if kind == CONE:  # centred on its frame, trimesh's stands on it
        cone = trimesh.creation.cone(radius=sizes[1], height=sizes[0], sections=48)
        return cone.apply_translation([0, 0, -sizes[0] / 2])
    raise InputError(ErrorCode.UNSUPPORTED, f"{where}: primitive type {kind}; 1 to 4 (box to cone) are read")


def shape_entry(item: Mapping[str, Any], pose_world_item: Pose, folder: Path) -> dict[str, Any]:
    """Shape and pose of a collision object, as in a scene file; a mesh is written into the folder."""
    name = item["id"]
    primitives, meshes = item.get("primitives") or [], item.get("meshes") or []
    pairs = list(zip(primitives, item.get("primitive_poses") or [None] * len(primitives), strict=True))
    if len(pairs) == 1 and not meshes and pairs[0][0]["type"] in (BOX, CYLINDER):
        primitive, place = pairs[0]
        sizes = [float(size) for size in primitive["dimensions"]]
        shape = {"box": sizes[:3]} if primitive["type"] == BOX else {"cylinder": [sizes[1], sizes[0]]}
        return shape | {"pose": (pose_world_item @ pose_of(place)).vector.tolist()}
    surfaces = [solid(primitive, name).apply_transform(matrix_of(place)) for primitive, place in pairs]
    places = item.get("mesh_poses") or [None] * len(meshes)
    for mesh, place in zip(meshes, places, strict=True):
        vertices = [[float(vertex[axis]) for axis in "xyz"] for vertex in mesh["vertices"]]
        faces = [list(face["vertex_indices"]) for face in mesh["triangles"]]
        surfaces.append(trimesh.Trimesh(vertices, faces, process=False).apply_transform(matrix_of(place)))
    if not surfaces:
        raise InputError(ErrorCode.OBJECT_INVALID, f"{name}: it has no primitive and no mesh")
    together = trimesh.util.concatenate(surfaces)
    checked = check_mesh(np.asarray(together.vertices), np.asarray(together.faces), name=name)  # unites what overlaps
    path = folder / f"{name.replace('/', '_')}.stl"
    trimesh.Trimesh(checked.vertices, checked.triangles, process=False).export(path)
    return {"mesh": path.name, "pose": pose_world_item.vector.tolist()}


def to_poise(
    scene: Mapping[str, Any], masses: Mapping[str, float], friction: float, folder: Path
) -> tuple[dict[str, Any], list[str]]:
    """The content of a scene file, and what was left out, one sentence each.

    Raises:
        InputError: objects in several frames; an object that cannot be read, or is removed or moved; a mass of an
            unknown object.
    """
    items = (scene.get("world") or {}).get("collision_objects") or []
    frames = {item["header"]["frame_id"] for item in items}
    if len(frames) > 1:
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"the objects are in several frames: {', '.join(sorted(frames))}")
    if unknown := set(masses) - {item["id"] for item in items}:
        raise InputError(ErrorCode.OBJECT_UNKNOWN, f"masses: there is no {', '.join(sorted(unknown))}")
    objects = []
    for item in items:
        if item.get("operation", 0) not in (0, b"\0", "\0"):
            raise InputError(ErrorCode.UNSUPPORTED, f"{item['id']}: operation {item['operation']!r} is not that of ADD")
        entry = {"id": item["id"], **shape_entry(item, pose_of(item.get("pose")), folder)}
        mass = masses.get(item["id"])
        objects.append(entry | ({"fixed": True} if mass is None else {"mass": float(mass)}))
    left = ["the scene is a difference (is_diff): it lacks what did not change"] if scene.get("is_diff") else []
    left += [f"{item['id']}: no mass is given; it is fixed" for item in items if item["id"] not in masses]
    held = (scene.get("robot_state") or {}).get("attached_collision_objects") or []
    left += [f"{one['object']['id']}: the robot holds it; left out" for one in held]
    left += [f"{item['id']}: its planes are left out" for item in items if item.get("planes")]
    return {"gravity": [0.0, 0.0, -9.80665], "friction": friction, "objects": objects}, left


def to_moveit(assembly: Assembly, frame: str) -> dict[str, Any]:
    """A PlanningScene that adds the objects to that of MoveIt (`is_diff`)."""
    found = []
    for item in assembly.objects:
        content: dict[str, Any] = {"header": {"frame_id": frame}, "id": item.id, "pose": pose_content(item.pose)}
        shape = item.shape
        identity = pose_content(Pose.identity())
        if isinstance(shape, Box):
            content["primitives"] = [{"type": BOX, "dimensions": [float(size) for size in shape.size]}]
            content["primitive_poses"] = [identity]
        elif isinstance(shape, Cylinder):
            content["primitives"] = [{"type": CYLINDER, "dimensions": [float(shape.length), float(shape.radius)]}]
            content["primitive_poses"] = [identity]
        else:
            vertices = [dict(zip("xyz", vertex, strict=True)) for vertex in np.asarray(shape.vertices).tolist()]
            triangles = [{"vertex_indices": face} for face in np.asarray(shape.triangles).tolist()]
            content["meshes"], content["mesh_poses"] = [{"vertices": vertices, "triangles": triangles}], [identity]
        found.append(content)
    return {"is_diff": True, "world": {"collision_objects": found}}


def read_yaml(path: Path) -> Any:
    """The first document: `ros2 topic echo` ends each message with ---."""
    try:
        return next(iter(yaml.safe_load_all(path.read_text())), None)
    except (OSError, yaml.YAMLError) as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error}") from error


def main() -> None:
    """Convert a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ways = parser.add_subparsers(dest="way", required=True)
    there = ways.add_parser("to-poise", help="planning scene to scene file")
    there.add_argument("--masses", type=Path, help="YAML file with id: kg")
    there.add_argument("--friction", type=float, required=True, help="Coulomb coefficient of all contacts")
    back = ways.add_parser("to-moveit", help="scene file to planning scene")
    back.add_argument("--frame", default="world", help="frame of the poses")
    for one in (there, back):
        one.add_argument("file", type=Path)
        one.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    try:
        if arguments.way == "to-poise":
            masses = read_yaml(arguments.masses) if arguments.masses else {}
            folder = arguments.output.parent
            content, left = to_poise(read_yaml(arguments.file) or {}, masses or {}, arguments.friction, folder)
            print(*left, sep="\n", file=sys.stderr)
        else:
            content = to_moveit(load_scene(arguments.file), arguments.frame)
        arguments.output.write_text(yaml.safe_dump(content, sort_keys=False))
    except PoiseError as error:
        sys.exit(f"{error.code.name}: {error.message}")


if __name__ == "__main__":
    main()
