"""Robot descriptions as untrusted input: text becomes a checked tree of links and joints."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from poise.errors import ErrorCode, InputError

_MAX_CHARACTERS = 10_000_000
"""A description without its meshes is some tens of kilobytes."""
_LONGEST, _WIDEST = 100.0, 5.0
"""m: larger robots have other units: sum of the offsets between joints that move, and radius of gyration of a link of
the robot's mass with the sum of the moments of all links."""
_TURN = 6.5
"""rad, beyond a whole turn: whole numbers above it are degrees."""


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: position = multiplier * source + offset."""

    joint: str
    source: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Inertial:
    """The <inertial> of a link: mass kg, centre of mass m and its axes' roll, pitch, yaw in the link's axes, and the
    moments (Ixx, Ixy, Ixz, Iyy, Iyz, Izz) kg m2 about the centre of mass in those axes."""

    mass: float
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    moments: tuple[float, ...]


@dataclass(frozen=True)
class UrdfTree:
    """What Poise itself reads from a description; the rest is pinocchio's."""

    text: str
    name: str
    root: str
    parent_of: dict[str, str]  # child link -> parent link
    links: tuple[str, ...]
    inertials: dict[str, Inertial]
    mimics: tuple[Mimic, ...]

    def beyond(self, link: str) -> tuple[str, ...]:
        """The links that hang on `link`, without itself."""

        def hangs(child: str) -> bool:
            while child in self.parent_of:
                child = self.parent_of[child]
                if child == link:
                    return True
            return False

        return tuple(child for child in self.links if hangs(child))


def read_urdf(path: str | Path) -> str:
    """The text of a URDF file.

    Raises:
        InputError: FILE_UNREADABLE when there is no such file, ROBOT_DESCRIPTION_INVALID when it is too large.
    """
    try:
        if Path(path).stat().st_size > _MAX_CHARACTERS:
            raise _invalid(f"{path} is larger than {_MAX_CHARACTERS} bytes")
        return Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _invalid(f"{path} is not UTF-8 text") from error
    except OSError as error:
        raise InputError(
            ErrorCode.FILE_UNREADABLE, f"cannot read the robot description {path}: {error.strerror}"
        ) from error


def parse_urdf(text: str) -> UrdfTree:
    """Check a description before anything is built from it; nothing it names (meshes, files) is opened.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID, saying which link or joint and why.
    """
    if len(text) > _MAX_CHARACTERS:
        raise _invalid(f"it has more than {_MAX_CHARACTERS} characters")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities can grow without bound and name files
        raise _invalid("it declares a document type or entities; remove them")
    try:
        robot = ElementTree.fromstring(text.strip())
    except (ElementTree.ParseError, ValueError) as error:
        raise _invalid(f"it is not well-formed XML ({error})") from error
    if robot.tag != "robot":
        raise _invalid(f"its root element is <{robot.tag}>, expected <robot>")
    if any("ros.org/wiki/xacro" in str(element.tag) for element in robot.iter()):
        raise _invalid("it is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf")

    links = tuple(_name(link) for link in robot.findall("link"))
    joints = robot.findall("joint")
    _unique("link", links)
    _unique("joint", [_name(joint) for joint in joints])
    _finite(robot)
    parent_of = _tree(links, joints)
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1:
        raise _invalid(f"it must have one root link, it has {len(roots)}: {', '.join(roots[:5]) or 'a circle'}")
    inertials = _inertials(robot)
    _in_si(joints, inertials.values())
    return UrdfTree(text, robot.get("name", ""), roots[0], parent_of, links, inertials, _mimics(joints))


def _tree(links: tuple[str, ...], joints: list[ElementTree.Element]) -> dict[str, str]:
    parent_of: dict[str, str] = {}
    for joint in joints:
        ends = []
        for role in ("parent", "child"):
            element = joint.find(role)
            link = "" if element is None else element.get("link", "")
            if link not in links:
                raise _invalid(f"joint {_name(joint)} names the {role} link '{link}', which does not exist")
            ends.append(link)
        parent, child = ends
        if child in parent_of:
            raise _invalid(f"link {child} is the child of two joints")
        parent_of[child] = parent
    for link in links:  # a circle apart from the root's tree would make walks endless
        seen = {link}
        while link in parent_of:
            link = parent_of[link]
            if link in seen:
                raise _invalid(f"its joints form a circle through link {link}")
            seen.add(link)
    return parent_of


def _inertials(robot: ElementTree.Element) -> dict[str, Inertial]:
    found = {}
    for link in robot.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            mass, moments = inertial.find("mass"), inertial.find("inertia")
            if mass is None or moments is None:
                raise _invalid(f"the inertial of link {_name(link)} needs a <mass> and an <inertia>")
            origin = inertial.find("origin")
            place = {} if origin is None else origin.attrib
            found[_name(link)] = Inertial(
                float(mass.get("value", "0")),
                _triple(place.get("xyz", "0 0 0")),
                _triple(place.get("rpy", "0 0 0")),
                tuple(float(moments.get(key, "0")) for key in _NUMBERS["inertia"]),
            )
    return found


def _triple(text: str) -> tuple[float, ...]:
    values = tuple(float(part) for part in text.split())
    if len(values) != 3:
        raise _invalid(f"expected three numbers, found '{text[:40]}'")
    return values


def _mimics(joints: list[ElementTree.Element]) -> tuple[Mimic, ...]:
    found = []
    names = {_name(joint) for joint in joints}
    for joint in joints:
        element = joint.find("mimic")
        if element is None:
            continue
        source = element.get("joint", "")
        if source not in names:
            raise _invalid(f"joint {_name(joint)} mimics '{source}', which does not exist")
        multiplier, offset = (float(element.get(key, default)) for key, default in (("multiplier", 1), ("offset", 0)))
        found.append(Mimic(_name(joint), source, multiplier, offset))
    followers = {mimic.joint for mimic in found}
    for mimic in found:
        if mimic.source in followers:
            raise _invalid(f"joint {mimic.joint} mimics {mimic.source}, which is itself a mimic joint")
    return tuple(found)


def _in_si(joints: Iterable[ElementTree.Element], inertials: Iterable[Inertial]) -> None:
    """Refuse lengths in mm, angles in degrees, and moments of inertia in kg cm2 or g mm2."""
    reach = 0.0
    for joint in joints:
        origin = joint.find("origin")
        if origin is None:
            continue
        angles = _triple(origin.get("rpy", "0 0 0"))
        degrees = [angle for angle in angles if abs(angle) > _TURN and abs(angle - round(angle)) < 1e-6]
        if degrees:
            raise _invalid(f"joint {_name(joint)} is turned by {degrees[0]:g} rad: give rpy in rad, not in degrees")
        reach += math.hypot(*_triple(origin.get("xyz", "0 0 0"))) if joint.get("type") != "fixed" else 0.0
    if reach > _LONGEST:
        raise _invalid(f"its joints are {reach:.4g} m apart in total: give xyz in m, not in mm")
    mass, moments = 0.0, 0.0
    for inertial in inertials:
        mass += inertial.mass
        moments += sum(inertial.moments[k] for k in (0, 3, 5))
    if moments > 2.0 * _WIDEST**2 * mass > 0.0:
        width = math.sqrt(moments / mass / 2.0)
        raise _invalid(f"its moments of inertia are those of {mass:.4g} kg spread over {width:.3g} m: give kg m2")


_NUMBERS = {
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
    "mimic": ("multiplier", "offset"),
    "dynamics": ("friction", "damping"),
}


def _finite(robot: ElementTree.Element) -> None:
    # urdfdom drops an inertial that it cannot read and goes on without it.
    for owner in [*robot.findall("link"), *robot.findall("joint")]:
        for element in owner.iter():
            for key in _NUMBERS.get(str(element.tag), ()):
                value = element.get(key)
                if value is not None and not _are_finite(value.split()):
                    raise _invalid(f"{owner.tag} {_name(owner)}: <{element.tag}> has {key}='{value[:40]}'")
            fixed = owner.get("type") == "fixed"  # its axis means nothing, and exporters write zeros
            if element.tag == "axis" and not (fixed or any(map(float, element.get("xyz", "1 0 0").split()))):
                raise _invalid(f"joint {_name(owner)} has an axis of length zero")


def _are_finite(parts: list[str]) -> bool:
    try:
        return bool(parts) and all(math.isfinite(float(part)) for part in parts)
    except ValueError:
        return False


def _unique(kind: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise _invalid(f"two {kind}s are named '{name}'")
        seen.add(name)


def _name(element: ElementTree.Element) -> str:
    name = element.get("name", "")
    if not name:
        raise _invalid(f"a <{element.tag}> has no name")
    return name


def _invalid(reason: str) -> InputError:
    return InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"robot description: {reason}")
