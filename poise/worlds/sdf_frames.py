"""Names and poses in SDFormat: nested models, frames, poses that are relative to them, and models of other files."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.worlds.groups import WORLD
from poise.worlds.mesh_sources import found_file
from poise.worlds.xml_tree import numbers_of, pose_of_rpy, read_xml

_MOST_DEEP = 8
_FOLDER = "poise_folder"
"""Attribute of an element of another file: the folder of that file."""
_SCOPE = "::"
_ITSELF = ("__model__", "__root__")


def is_true(text: str | None) -> bool:
    """Whether a boolean of SDFormat is true; not given is false."""
    return (text or "").strip().lower() in ("true", "1")


def expanded(scope: ET.Element, folder: Path, depth: int = 0) -> ET.Element:
    """A world or model with the models of other files in place of each `include`, or merged into it.

    Raises:
        InputError: BAD_INPUT where models include each other; FILE_UNREADABLE, FILE_CORRUPT, UNSUPPORTED.
    """
    if depth > _MOST_DEEP:
        raise InputError(ErrorCode.BAD_INPUT, f"models include each other more than {_MOST_DEEP} deep")
    found = ET.Element(scope.tag, scope.attrib)
    for child in scope:
        if child.tag == "include":
            model = _included(child, folder, depth)
            found.extend(_merged(model) if is_true(child.get("merge")) else [model])
        elif child.tag == "model":
            found.append(expanded(child, folder, depth + 1))
        else:
            found.append(child)
    return found


def take_state(scope: ET.Element) -> int:
    """Give the models of a world the poses that its `state` has, as Gazebo does when it opens a world that it saved.

    Returns:
        How many models the state moves.
    """
    saved = {model.get("name"): model.find("pose") for model in scope.findall("state/model")}
    moved = 0
    for model in scope.findall("model"):
        pose = saved.get(model.get("name"))
        if pose is None:
            continue
        old = model.find("pose")
        moved += (None if old is None else (old.text or "").split()) != (pose.text or "").split()
        for each in model.findall("pose"):
            model.remove(each)
        model.append(pose)
        model.attrib.pop("placement_frame", None)
    return moved


def folder_of(element: ET.Element, folder: Path) -> Path:
    """The folder of the file that an element is from, if it is another one than that of its parent."""
    given = element.get(_FOLDER)
    return folder if given is None else Path(given)


def _included(include: ET.Element, folder: Path, depth: int) -> ET.Element:
    """The model of a file, with the name, the pose and the state that `include` gives it."""
    place = found_file((include.findtext("uri") or "").strip(), folder)
    file = _model_file(place) if place.is_dir() else place
    model = read_xml(file, "sdf").find("model")
    if model is None:
        raise InputError(ErrorCode.BAD_INPUT, f"{file}: it has no model to include")
    model = expanded(model, file.parent, depth + 1)
    for name in ("pose", "static"):
        if (given := include.find(name)) is not None:
            for old in model.findall(name):
                model.remove(old)
            model.append(given)
    if (frame := include.findtext("placement_frame")) is not None:
        model.set("placement_frame", frame.strip())
    model.set("name", (include.findtext("name") or model.get("name") or "model").strip())
    for element in (model, *model):
        element.attrib.setdefault(_FOLDER, str(file.parent))
    return model


def _merged(model: ET.Element) -> list[ET.Element]:
    """What a model that is merged into another adds to it: its children, in a frame in its place."""
    name = f"_merged__{model.get('name')}__model__"
    frame = ET.Element("frame", {"name": name})
    frame.extend(model.findall("pose"))
    if (placed := model.get("placement_frame")) is not None:
        frame.set("name", f"{name}placement")
        after = ET.Element("frame", {"name": name})
        inside = ET.SubElement(after, "pose", {"relative_to": f"{name}placement", "rotation_format": "quat_xyzw"})
        inside.text = " ".join(map(repr, _Origin(model).named(placed).inverse.vector.tolist()))
        frames = [frame, after]
    else:
        frames = [frame]
    children = [child for child in model if child.tag in ("link", "model", "frame", "joint")]
    for child in children:
        pose = child.find("pose")
        base = "" if pose is None else pose.get("relative_to", "")
        if child.tag == "joint" or (base or child.get("attached_to", "")) not in ("", *_ITSELF):
            continue
        if pose is None:
            pose = ET.SubElement(child, "pose")
        pose.set("relative_to", name)
        child.attrib.pop("attached_to", None)
    return [*frames, *children]


def _model_file(folder: Path) -> Path:
    """That of a folder with `model.config`: of several versions of SDFormat the newest, as in Gazebo."""
    config = folder / "model.config"
    named = read_xml(config, "model").findall("sdf") if config.exists() else []
    newest = max(named, key=_version, default=None)
    return folder / ((None if newest is None else newest.text) or "model.sdf").strip()


def _version(element: ET.Element) -> tuple[int, ...]:
    parts = element.get("version", "0").strip().split(".")
    return tuple(int(part) if part.isdigit() else 0 for part in parts)


def pose_inside(element: ET.Element, where: str) -> Pose:
    """Of `pose` alone, without the frame that it may name."""
    given = element.find("pose")
    if given is None:
        return Pose.identity()
    if given.get("rotation_format", "euler_rpy") == "quat_xyzw":
        return Pose.from_vector(numbers_of(given.text, 7, f"{where}: pose", "0 0 0 0 0 0 1"))
    values = numbers_of(given.text, 6, f"{where}: pose", "0 0 0 0 0 0")
    angles = np.radians(values[3:]) if is_true(given.get("degrees")) else values[3:]
    return pose_of_rpy(values[:3], angles)


class Frames:
    """The poses, in the world, of what has a name in a world or a model.

    Args:
        scope: the element of the world or model, `expanded`.
        origin: its own pose.
    """

    def __init__(self, scope: ET.Element, origin: Pose) -> None:
        self.origin = origin
        self._scope = scope
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
        if depth > len(self._named):
            raise InputError(ErrorCode.FRAME_UNKNOWN, f"{where}: its pose is relative to itself, by way of {base}")
        pose = self._base(base, where, depth) @ pose_inside(element, where)
        placed = element.get("placement_frame") if element.tag == "model" else None
        return pose if not placed else pose @ _Origin(element).named(placed).inverse

    def inside(self, model: ET.Element) -> "Frames":
        """Those of a nested model."""
        return Frames(model, self.pose_of(model))

    def named(self, name: str) -> Pose:
        """The pose of a frame, link or nested model; `model::name` for one in a nested model."""
        return self._base(name, name, 0)

    def link_of(self, name: str) -> str | None:
        """The link to which a name belongs, `model::link` for one of a nested model; None if there is none."""
        for _ in range(len(self._named) + 1):
            first, _, rest = name.partition(_SCOPE)
            child = self._named.get(first)
            if child is None:
                return WORLD if name == WORLD else None
            if child.tag == "model":
                inner = Frames(child, self.origin)
                found = inner.link_of(rest) if rest else inner.canonical
                return None if found is None else f"{first}{_SCOPE}{found}"
            if child.tag == "link":
                return name
            name = child.get("attached_to") or self.canonical or ""
        return None

    @property
    def canonical(self) -> str | None:
        """The link that stands for the model."""
        given = self._scope.get("canonical_link")
        if given:
            return given
        link = self._scope.find("link")
        if link is not None:
            return link.get("name")
        nested = self._scope.find("model")
        inner = None if nested is None else Frames(nested, self.origin).canonical
        return None if nested is None or inner is None else f"{nested.get('name')}{_SCOPE}{inner}"

    def _base(self, name: str, where: str, depth: int) -> Pose:
        if name in ("", WORLD, *_ITSELF):
            return self.origin
        first, _, rest = name.partition(_SCOPE)
        child = self._named.get(first)
        if child is None or (rest and child.tag != "model"):
            what = f"{where}: its pose is relative to {name}, which is no link, model or frame beside it"
            raise InputError(ErrorCode.FRAME_UNKNOWN, what)
        pose = self.pose_of(child, depth + 1)
        return Frames(child, pose).named(rest) if rest else pose


class _Origin(Frames):
    """The frames of a model in its own frame."""

    def __init__(self, scope: ET.Element) -> None:
        super().__init__(scope, Pose.identity())
