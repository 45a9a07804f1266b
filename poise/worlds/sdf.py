"""SDFormat (http://sdformat.org/spec): worlds and models of Gazebo and Drake."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, RigidObject, Sphere
from poise.assembly.scene import Shape
from poise.exporting import sdf_inertial
from poise.files import write_whole
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.worlds import solids
from poise.worlds.assembling import inertial_of
from poise.worlds.base import WorldContent, WorldFormat, WorldSolid
from poise.worlds.groups import WORLD, WorldLink, grouped
from poise.worlds.mesh_beside import stl_bytes, stl_name
from poise.worlds.mesh_sources import scaled_mesh
from poise.worlds.sdf_frames import Frames, expanded, folder_of, is_true, pose_inside, take_state
from poise.worlds.xml_tree import (
    AXES_OF_INERTIA,
    direction_of,
    inertial_at,
    numbers_of,
    read_xml,
    xyz_rpy_of,
)

_GRAVITY = "0 0 -9.8"
_FRICTION = 1.0
"""Defaults of SDFormat: gravity, and mu of surfaces that give none."""
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
        scope = expanded(scope, path.parent)
        if moved := take_state(scope):
            notes.append(
                f"{moved} models are where the saved state of Gazebo has them; poses of their links are not read"
            )
        model = _Model(scope, Frames(scope, Pose.identity()), "", path.parent, False)
        links, joined = model.parts(notes)
        bodies = grouped("", links, joined, notes)
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


@dataclass(frozen=True, eq=False)
class _Model:
    """A model, or a world of them.

    Args:
        element: `expanded`.
        frames: of what is in it.
        name: with those of the models that it is in; empty for a world.
        folder: of the file that it is from.
        static: nothing in it moves.
    """

    element: ET.Element
    frames: Frames
    name: str
    folder: Path
    static: bool

    def parts(self, notes: list[str]) -> tuple[list[WorldLink], list[tuple[str, str]]]:
        """All links, also of nested models, and pairs of them that joints fix to each other."""
        links = [self._link(link, notes) for link in self.element.findall("link")]
        joined = [pair for joint in self.element.findall("joint") for pair in self._pairs(joint, notes)]
        for element in self.element.findall("model"):
            static = self.static or is_true(element.findtext("static"))
            name = self._named(element.get("name", "model"))
            nested = _Model(element, self.frames.inside(element), name, folder_of(element, self.folder), static)
            inner, pairs = nested.parts(notes)
            links += inner
            joined += pairs
        return links, joined

    def _link(self, element: ET.Element, notes: list[str]) -> WorldLink:
        name = self._named(element.get("name", "link"))
        found = _link(element, self.frames, folder_of(element, self.folder), name, notes)
        if element.find("inertial") is None and found.solids and not self.static:
            notes.append(f"{name}: no inertial; SDFormat's default of 1 kg is taken")
        return replace(found, fixed=self.static)

    def _pairs(self, joint: ET.Element, notes: list[str]) -> list[tuple[str, str]]:
        name, where = joint.get("name"), self.name or WORLD
        ends = [(joint.findtext(end) or "").strip() for end in ("parent", "child")]
        links = [self.frames.link_of(end) for end in ends]
        if None in links:
            missing = ends[links.index(None)]
            notes.append(f"{where}: the joint {name} is of {missing}, which is no link; left out")
            return []
        if joint.get("type") != "fixed":
            notes.append(f"{where}: the joint {name} is taken as rigid")
        first, second = (WORLD if link == WORLD else self._named(str(link)) for link in links)
        return [(first, second)]

    def _named(self, name: str) -> str:
        return f"{self.name}::{name}" if self.name else name


def _link(link: ET.Element, frames: Frames, folder: Path, where: str, notes: list[str]) -> WorldLink:
    found = [_solid(each, folder, where) for each in link.findall("collision")]
    known = tuple(each for each in found if each is not None)
    if len(known) < len(found):
        notes.append(f"{where}: a collision shape of an unknown kind is left out; {', '.join(_KINDS)} are read")
    inertial = _inertial(link.find("inertial"), where)
    return WorldLink(where, frames.pose_of(link), known, inertial)


def _inertial(element: ET.Element | None, where: str) -> InertialParameters:
    if element is None:
        return InertialParameters(1.0, np.full(3, np.nan), np.full((3, 3), np.nan))
    mass = float(numbers_of(element.findtext("mass"), 1, f"{where}: mass", "1")[0])
    tensor = element.find("inertia")
    if tensor is None:
        return inertial_at(mass, pose_inside(element, where), None)
    entries = zip(AXES_OF_INERTIA, ("1", "0", "0", "1", "0", "1"), strict=True)
    six = [numbers_of(tensor.findtext(axis), 1, f"{where}: {axis}", value)[0] for axis, value in entries]
    return inertial_at(mass, pose_inside(element, where), np.array(six))


def _solid(collision: ET.Element, folder: Path, where: str) -> WorldSolid | None:
    where = f"{where}::{collision.get('name')}"
    geometry = collision.find("geometry")
    shape = None if geometry is None else _shape(geometry, folder, where)
    if shape is None:
        return None
    pose = pose_inside(collision, where)
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
