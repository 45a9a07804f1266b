"""URDF (http://wiki.ros.org/urdf/XML): objects and fixtures described like robots."""

import operator
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia import InertialParameters
from poise.worlds import solids
from poise.worlds.base import WorldContent, WorldFormat, WorldSolid
from poise.worlds.groups import WORLD, WorldLink, grouped
from poise.worlds.mesh_sources import scaled_mesh
from poise.worlds.xml_tree import AXES_OF_INERTIA, direction_of, inertial_at, numbers_of, pose_of_rpy, read_xml

_BULLET, _GAZEBO = 0.5, 1.0
"""Friction of surfaces of which a URDF for PyBullet or Gazebo says nothing, while it does of others."""


class UrdfFormat(WorldFormat):
    """One object, or several that a link `world` holds by joints that are fixed or floating.

    Coefficients of two surfaces are multiplied, as in PyBullet, where links have a `lateral_friction`; of those of
    Gazebo the smaller one counts.
    """

    name = "urdf"
    description = "URDF, links with collision shapes"
    suffixes = (".urdf", ".xml")

    def recognises(self, head: bytes) -> bool:
        """See `WorldFormat`."""
        return b"<robot" in head

    def read(self, path: Path) -> WorldContent:
        """See `WorldFormat`."""
        root, notes = read_xml(path, "robot"), list[str]()
        if b"xacro:" in path.read_bytes()[:65536]:
            raise InputError(ErrorCode.UNSUPPORTED, f"{path}: a xacro file; run xacro on it first")
        poses, surfaces = _poses(root), _surfaces(root)
        links = [
            _link(link, poses[name], path.parent, surfaces.get(name))
            for link in root.findall("link")
            if (name := link.get("name", "")) != WORLD
        ]
        joined = []
        for joint in root.findall("joint"):
            kind, parent, child = joint.get("type", "fixed"), _end(joint, "parent"), _end(joint, "child")
            if kind == "floating":
                continue
            if kind != "fixed":
                notes.append(f"the joint {joint.get('name')} is taken as rigid, at zero")
            joined.append((parent, child))
        bodies = tuple(grouped(root.get("name", "object"), links, joined, notes))
        if not surfaces:
            return WorldContent(bodies, notes=tuple(notes))
        bullet = root.find("link/contact/lateral_friction") is not None
        combine, default = (operator.mul, _BULLET) if bullet else (min, _GAZEBO)
        missing = sum(solid.friction is None for body in bodies for solid in body.solids)
        assumed = f"{missing} collision shapes have no friction; the default of {default:g} is taken"
        return WorldContent(
            bodies,
            combine=combine,
            notes=tuple(notes),
            friction=default,
            friction_note=assumed if missing else "",
        )


def _end(joint: ET.Element, name: str) -> str:
    found = joint.find(name)
    return "" if found is None else found.get("link", "")


def _origin(element: ET.Element | None, where: str) -> Pose:
    origin = None if element is None else element.find("origin")
    if origin is None:
        return Pose.identity()
    return pose_of_rpy(
        numbers_of(origin.get("xyz"), 3, f"{where}: xyz", "0 0 0"),
        numbers_of(origin.get("rpy"), 3, f"{where}: rpy", "0 0 0"),
    )


def _poses(root: ET.Element) -> dict[str, Pose]:
    """Of all links in the frame of the root link, with all joints at zero."""
    below = {_end(joint, "child"): joint for joint in root.findall("joint")}
    names = [link.get("name", "") for link in root.findall("link")]

    def pose_of(name: str, depth: int) -> Pose:
        joint = below.get(name)
        if joint is None:
            return Pose.identity()
        if depth > len(names) or _end(joint, "parent") not in names:
            what = f"the joint {joint.get('name')} has no parent link, or hangs on itself"
            raise InputError(ErrorCode.BAD_INPUT, what)
        return pose_of(_end(joint, "parent"), depth + 1) @ _origin(joint, f"joint {joint.get('name')}")

    return {name: pose_of(name, 0) for name in names}


def _surfaces(root: ET.Element) -> dict[str, float]:
    """Coefficients of links: `lateral_friction` of PyBullet, and the smaller one of `mu1` and `mu2` of Gazebo."""
    given: dict[str, list[float]] = {}
    for element in root.findall("gazebo"):
        for kind in ("mu1", "mu2"):
            found, where = element.find(kind), element.get("reference", "")
            if found is not None:
                text = found.text if (found.text or "").strip() else found.get("value")
                given.setdefault(where, []).append(float(numbers_of(text, 1, f"{where}: {kind}")[0]))
    for link in root.findall("link"):
        friction, name = link.find("contact/lateral_friction"), link.get("name", "")
        if friction is not None:
            value = numbers_of(friction.get("value"), 1, f"{name}: lateral_friction")[0]
            given.setdefault(name, []).append(float(value))
    return {name: min(values) for name, values in given.items()}


def _link(link: ET.Element, pose: Pose, folder: Path, mu: float | None) -> WorldLink:
    name = link.get("name", "")
    found = [WorldSolid(_shape(each, folder, name), _place(each, name), mu) for each in link.findall("collision")]
    return WorldLink(name, pose, tuple(found), _inertial(link.find("inertial"), name))


def _place(collision: ET.Element, where: str) -> Pose:
    """Where the shape of a collision is in its link."""
    plane = collision.find("geometry/plane")  # of PyBullet
    if plane is None:
        return _origin(collision, where)
    return _origin(collision, where) @ solids.below_plane(direction_of(plane.get("normal"), f"{where}: plane normal"))


def _inertial(element: ET.Element | None, where: str) -> InertialParameters | None:
    mass = None if element is None else element.find("mass")
    if element is None or mass is None:
        return None
    kilograms = float(numbers_of(mass.get("value"), 1, f"{where}: mass")[0])
    if kilograms == 0:  # what does not move, in PyBullet
        return None
    tensor = element.find("inertia")
    if tensor is None:
        return inertial_at(kilograms, _origin(element, where), None)
    six = [numbers_of(tensor.get(axis), 1, f"{where}: {axis}", "0")[0] for axis in AXES_OF_INERTIA]
    return inertial_at(kilograms, _origin(element, where), np.array(six))


def _shape(collision: ET.Element, folder: Path, where: str) -> Shape:
    geometry = collision.find("geometry")
    kind = None if geometry is None else next(iter(geometry), None)
    if kind is None:
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: a collision without a shape")

    def read(name: str, count: int = 1, default: str = "") -> np.ndarray:
        return numbers_of(kind.get(name), count, f"{where}: {kind.tag} {name}", default)

    if kind.tag == "box":
        return solids.box(read("size", 3))
    if kind.tag == "cylinder":
        return solids.cylinder(float(read("radius")[0]), float(read("length")[0]))
    if kind.tag == "capsule":
        return solids.capsule(float(read("radius")[0]), float(read("length")[0]))
    if kind.tag == "sphere":
        return solids.sphere(float(read("radius")[0]))
    if kind.tag == "plane":
        return solids.plane()
    if kind.tag == "mesh":
        return scaled_mesh(kind.get("filename", ""), folder, read("scale", 3, "1 1 1"))
    what = f"{where}: a collision shape <{kind.tag}> is not read; box, cylinder, capsule, sphere, mesh and plane are"
    raise InputError(ErrorCode.UNSUPPORTED, what)
