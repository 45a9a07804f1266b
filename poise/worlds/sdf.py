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
from poise.worlds import solids
from poise.worlds.assembling import inertial_of
from poise.worlds.base import WorldContent, WorldFormat, WorldSolid
from poise.worlds.groups import WORLD, WorldLink, grouped
from poise.worlds.mesh_beside import stl_bytes, stl_name
from poise.worlds.mesh_sources import scaled_mesh
from poise.worlds.sdf_frames import Frames, expanded, folder_of, is_true, pose_inside, take_state
from poise.worlds.sdf_inertia import link_inertial
from poise.worlds.xml_tree import direction_of, numbers_of, read_xml, xyz_rpy_of

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
        if not self.static:
            notes.extend(f"{name}: {what}" for what in _left_out(element))
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


def _left_out(link: ET.Element) -> list[str]:
    """What changes how a link moves in Gazebo, and is not part of a scene."""
    masked = any(each.find("surface/contact/collide_bitmask") is not None for each in link.findall("collision"))
    found = {
        "the file takes gravity from it, which is left out: it has its weight": link.find("gravity") is not None
        and not is_true(link.findtext("gravity")),
        "its collide_bitmask is left out: it touches everything here": masked,
        "it is kinematic in the file, which is left out: forces move it here": is_true(link.findtext("kinematic")),
    }
    return [what for what, there in found.items() if there]


def _link(link: ET.Element, frames: Frames, folder: Path, where: str, notes: list[str]) -> WorldLink:
    found = [(each, _solid(each, folder, where)) for each in link.findall("collision")]
    known = [(each, solid) for each, solid in found if solid is not None]
    if len(known) < len(found):
        notes.append(f"{where}: a collision shape of an unknown kind is left out; {', '.join(_KINDS)} are read")
    if any(each.find("geometry/mesh/submesh") is not None for each, _ in known):
        notes.append(f"{where}: a submesh is not read alone; the whole mesh is taken")
    weighed = [(each, solid) for each, solid in known if each.find("geometry/plane") is None]
    inertial = link_inertial(link, weighed, where)
    return WorldLink(where, frames.pose_of(link), tuple(solid for _, solid in known), inertial)


def _solid(collision: ET.Element, folder: Path, where: str) -> WorldSolid | None:
    where = f"{where}::{collision.get('name')}"
    geometry = collision.find("geometry")
    shape = None if geometry is None else _shape(geometry, folder, where)
    if shape is None:
        return None
    pose = pose_inside(collision, where)
    if geometry is not None and geometry.find("plane") is not None:
        pose = pose @ solids.below_plane(direction_of(geometry.findtext("plane/normal"), f"{where}: plane/normal"))
    return WorldSolid(shape, pose, _coefficient(collision, where))


def _coefficient(collision: ET.Element, where: str) -> float | None:
    """Of a surface; the least of both directions, which is on the safe side. None: the file has none."""
    for path in (("ode/mu", "ode/mu2"), ("bullet/friction", "bullet/friction2")):
        given = {name: collision.findtext(f"surface/friction/{name}") for name in path}
        known = [float(numbers_of(text, 1, f"{where}: {name}")[0]) for name, text in given.items() if text]
        if known:
            return min(known)
    return None


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
