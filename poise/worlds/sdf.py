"""SDFormat (http://sdformat.org/spec): worlds and models of Gazebo and Drake."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, RigidObject, Sphere
from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.exporting import sdf_inertial
from poise.files import write_whole
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.worlds import solids
from poise.worlds.assembling import inertial_of
from poise.worlds.base import WorldBody, WorldContent, WorldFormat, WorldSolid
from poise.worlds.groups import WORLD, WorldLink, grouped
from poise.worlds.mesh_beside import stl_bytes, stl_name
from poise.worlds.mesh_sources import found_file, scaled_mesh
from poise.worlds.xml_tree import (
    AXES_OF_INERTIA,
    direction_of,
    inertial_at,
    numbers_of,
    pose_of_rpy,
    read_xml,
    xyz_rpy_of,
)

_GRAVITY = "0 0 -9.8"
_FRICTION = 1.0
"""Defaults of SDFormat: gravity, and mu of surfaces that give none."""
_MOST_DEEP = 8
_ROUND: dict[str, Callable[[float, float], Shape]] = {
    "cylinder": solids.cylinder,
    "capsule": solids.capsule,
    "cone": solids.cone,
}
_KINDS = ("box", *_ROUND, "sphere", "ellipsoid", "plane", "mesh")


class SdfFormat(WorldFormat):
    """A world, or one model; the coefficient of two surfaces is the least of both, as in Gazebo."""

    name = "sdf"
    description = "SDFormat, the worlds and models of Gazebo and Drake"
    suffixes = (".sdf", ".world")

    def recognises(self, head: bytes) -> bool:
        """See `WorldFormat`."""
        return b"<sdf" in head

    def read(self, path: Path) -> WorldContent:
        """See `WorldFormat`."""
        root, notes = read_xml(path, "sdf"), list[str]()
        worlds = root.findall("world")
        if len(worlds) > 1:
            notes.append(f"the file has {len(worlds)} worlds; the first is read")
        scope = worlds[0] if worlds else root
        bodies = list(_models(scope, path.parent, Pose.identity(), "", notes, 0))
        gravity = numbers_of(scope.findtext("gravity"), 3, "gravity", _GRAVITY)
        missing = sum(solid.friction is None for body in bodies for solid in body.solids)
        assumed = f"{missing} collision shapes have no friction; SDFormat's default of {_FRICTION:g} is taken"
        return WorldContent(
            tuple(bodies),
            gravity,
            min,
            notes=tuple(notes),
            friction=_FRICTION,
            friction_note=assumed if missing else "",
        )

    def written(self, assembly: Assembly, path: Path) -> tuple[bytes, tuple[str, ...]]:
        """See `WorldFormat`. Meshes become STL files."""
        lost = [
            f"friction of {' and '.join(pair.objects)}: SDFormat has no coefficients of pairs"
            for pair in assembly.friction_pairs
        ]
        friction = assembly.largest_friction if assembly.friction is None else assembly.friction
        models = []
        for item in assembly.objects:
            if not isinstance(item.shape, Box | Cylinder | Sphere):
                write_whole(path.parent / stl_name(path.stem, item.id), stl_bytes(item.shape.polyhedron))
            models.append(_model_text(item, friction, stl_name(path.stem, item.id)))
        gravity = " ".join(repr(float(value)) for value in assembly.gravity)
        remarks = "".join(f"\n  not written: {each}" for each in lost).replace("--", "- -")
        text = f"""<?xml version="1.0"?>
<!-- a scene of Poise{remarks} -->
<sdf version="1.9">
  <world name={quoteattr(path.stem)}>
    <gravity>{gravity}</gravity>
{"".join(models)}  </world>
</sdf>
"""
        return text.encode(), tuple(lost)


def _models(
    scope: ET.Element, folder: Path, pose: Pose, prefix: str, notes: list[str], depth: int
) -> Iterator[WorldBody]:
    """The bodies of all models in a world, a model or a file."""
    if depth > _MOST_DEEP:
        raise InputError(ErrorCode.BAD_INPUT, f"models include each other more than {_MOST_DEEP} deep")
    frames = _Frames(scope, pose)
    for model in scope.findall("model"):
        yield from _model(model, folder, frames, prefix, notes, depth)
    for include in scope.findall("include"):
        uri = (include.findtext("uri") or "").strip()
        place = found_file(uri, folder)
        file = _model_file(place) if place.is_dir() else place
        yield from _model(_included(include, file), file.parent, frames, prefix, notes, depth + 1)


def _included(include: ET.Element, file: Path) -> ET.Element:
    """The model of a file, with the name, the pose and the state that `include` gives it."""
    model = read_xml(file, "sdf").find("model")
    if model is None:
        raise InputError(ErrorCode.BAD_INPUT, f"{file}: it has no model to include")
    for name in ("pose", "static"):
        if (given := include.find(name)) is not None:
            for old in model.findall(name):
                model.remove(old)
            model.append(given)
    model.set("name", include.findtext("name") or model.get("name") or "model")
    return model


def _model_file(folder: Path) -> Path:
    config = folder / "model.config"
    named = read_xml(config, "model").findtext("sdf") if config.exists() else None
    return folder / (named or "model.sdf").strip()


def _model(
    model: ET.Element, folder: Path, outside: "_Frames", prefix: str, notes: list[str], depth: int
) -> Iterator[WorldBody]:
    name = prefix + model.get("name", "model")
    frames = _Frames(model, outside.pose_of(model))
    static = (model.findtext("static") or "").strip() in ("true", "1")
    links = [_link(link, frames, folder, f"{name}::{link.get('name')}", notes) for link in model.findall("link")]
    joined = []
    for joint in model.findall("joint"):
        pair = tuple((joint.findtext(end) or "").strip() for end in ("parent", "child"))
        if joint.get("type") != "fixed":
            notes.append(f"{name}: the joint {joint.get('name')} is taken as rigid")
        joined.append((pair[0], pair[1]))
    yield from grouped(name, links, joined, static, notes)
    yield from _models(model, folder, frames.origin, f"{name}::", notes, depth + 1)


def _link(link: ET.Element, frames: "_Frames", folder: Path, where: str, notes: list[str]) -> WorldLink:
    found = [_solid(each, folder, where) for each in link.findall("collision")]
    known = tuple(each for each in found if each is not None)
    if len(known) < len(found):
        notes.append(f"{where}: a collision shape of an unknown kind is left out; {', '.join(_KINDS)} are read")
    inertial = _inertial(link.find("inertial"), where)
    if link.find("inertial") is None and known:
        notes.append(f"{where}: no inertial; SDFormat's default of 1 kg is taken")
    return WorldLink(link.get("name", "link"), frames.pose_of(link), known, inertial)


def _inertial(element: ET.Element | None, where: str) -> InertialParameters:
    if element is None:
        return InertialParameters(1.0, np.full(3, np.nan), np.full((3, 3), np.nan))
    mass = float(numbers_of(element.findtext("mass"), 1, f"{where}: mass", "1")[0])
    tensor = element.find("inertia")
    if tensor is None:
        return inertial_at(mass, _pose(element, where), None)
    entries = zip(AXES_OF_INERTIA, ("1", "0", "0", "1", "0", "1"), strict=True)
    six = [numbers_of(tensor.findtext(axis), 1, f"{where}: {axis}", value)[0] for axis, value in entries]
    return inertial_at(mass, _pose(element, where), np.array(six))


def _solid(collision: ET.Element, folder: Path, where: str) -> WorldSolid | None:
    where = f"{where}::{collision.get('name')}"
    geometry = collision.find("geometry")
    shape = None if geometry is None else _shape(geometry, folder, where)
    if shape is None:
        return None
    pose = _pose(collision, where)
    if geometry is not None and geometry.find("plane") is not None:
        pose = pose @ solids.below_plane(direction_of(geometry.findtext("plane/normal"), f"{where}: plane/normal"))
    mu = collision.findtext("surface/friction/ode/mu") or collision.findtext("surface/friction/bullet/friction")
    return WorldSolid(shape, pose, None if mu is None else float(numbers_of(mu, 1, f"{where}: mu")[0]))


def _shape(geometry: ET.Element, folder: Path, where: str) -> Shape | None:
    def read(path: str, count: int = 1, default: str = "") -> np.ndarray:
        return numbers_of(geometry.findtext(path), count, f"{where}: {path}", default)

    kind = next((child.tag for child in geometry), "")
    if kind == "box":
        return solids.box(read("box/size", 3))
    if kind in _ROUND:
        return _ROUND[kind](float(read(f"{kind}/radius")[0]), float(read(f"{kind}/length")[0]))
    if kind == "sphere":
        return solids.sphere(float(read("sphere/radius")[0]))
    if kind == "ellipsoid":
        return solids.ellipsoid(read("ellipsoid/radii", 3))
    if kind == "plane":
        return solids.plane()
    if kind == "mesh":
        return scaled_mesh((geometry.findtext("mesh/uri") or "").strip(), folder, read("mesh/scale", 3, "1 1 1"))
    return None


def _pose(element: ET.Element, where: str) -> Pose:
    """Of `pose` alone, without the frame that it may name."""
    given = element.find("pose")
    if given is None:
        return Pose.identity()
    rotation = given.get("rotation_format", "euler_rpy")
    if rotation == "quat_xyzw":
        return Pose.from_vector(numbers_of(given.text, 7, f"{where}: pose"))
    values = numbers_of(given.text, 6, f"{where}: pose", "0 0 0 0 0 0")
    angles = np.radians(values[3:]) if given.get("degrees") in ("true", "1") else values[3:]
    return pose_of_rpy(values[:3], angles)


class _Frames:
    """The poses, in the world, of what has a name in a world or a model.

    Args:
        scope: the element of the world or model.
        origin: its own pose.
    """

    def __init__(self, scope: ET.Element, origin: Pose) -> None:
        self.origin = origin
        named = [child for kind in ("link", "model", "frame") for child in scope.findall(kind)]
        self._named = {child.get("name", ""): child for child in named}

    def pose_of(self, element: ET.Element, depth: int = 0) -> Pose:
        """Of a child, in the world.

        Raises:
            InputError: FRAME_UNKNOWN, BAD_INPUT.
        """
        where = element.get("name", element.tag)
        given = element.find("pose")
        base = "" if given is None else given.get("relative_to", "")
        base = base or element.get("attached_to", "")
        inside = _pose(element, where)
        if base in ("", WORLD, "__model__", "__root__"):
            return self.origin @ inside
        if base not in self._named or depth > len(self._named):
            what = f"{where}: its pose is relative to {base}, which is no link, model or frame beside it"
            raise InputError(ErrorCode.FRAME_UNKNOWN, what)
        return self.pose_of(self._named[base], depth + 1) @ inside


def _model_text(item: RigidObject, friction: float, mesh: str) -> str:
    shape = item.shape
    if isinstance(shape, Box):
        size = " ".join(repr(float(value)) for value in shape.size)
        geometry = f"<box><size>{size}</size></box>"
    elif isinstance(shape, Cylinder):
        geometry = f"<cylinder><radius>{shape.radius!r}</radius><length>{shape.length!r}</length></cylinder>"
    elif isinstance(shape, Sphere):
        geometry = f"<sphere><radius>{shape.radius!r}</radius></sphere>"
    else:
        geometry = f"<mesh><uri>{escape(mesh)}</uri></mesh>"
    surface = f"<surface><friction><ode><mu>{friction!r}</mu><mu2>{friction!r}</mu2></ode></friction></surface>"
    inertial = "" if item.fixed else sdf_inertial(inertial_of(item))
    return f"""    <model name={quoteattr(item.id)}>
      <static>{str(item.fixed).lower()}</static>
      <pose>{xyz_rpy_of(item.pose)}</pose>
      <link name="link">
        {inertial}
        <collision name="collision"><geometry>{geometry}</geometry>{surface}</collision>
        <visual name="visual"><geometry>{geometry}</geometry></visual>
      </link>
    </model>
"""
