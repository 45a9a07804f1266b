"""SDFormat of Gazebo (http://sdformat.org/spec): links with inertials, joints, position controllers, force sensors.

No parser of SDFormat on PyPI is maintained, so that this reads the subset that a prediction needs. What a file includes
is not read: `gz sdf -p FILE` writes it in one piece.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.inertia.model import InertialParameters
from poise.simulation.models.description import JointDrive, JointPhysics, SensorNoise, SimulatorModel
from poise.simulation.models.urdf_text import LinkMotion, TreeBody, TreeJoint, urdf_of

_MAX_BYTES = 10_000_000
_KINDS: dict[str, LinkMotion] = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
_ENDLESS = 1e15
"""Limits of a joint from which it has none."""
_JOINT_FRAME = (1, 7)
"""Version from which the axis of a joint is in the joint's frame; before, in the model's where the file says so."""


def read_sdf(path: Path) -> SimulatorModel:
    """A model of Gazebo: the only one of the file that has joints.

    Raises:
        InputError: FILE_UNREADABLE; ROBOT_DESCRIPTION_INVALID with the element; UNSUPPORTED for includes, models in
            models, and joints with more than one axis.
    """
    root = _parsed(path)
    if root.find(".//include") is not None:
        uri = root.findtext(".//include/uri", "")
        raise InputError(
            ErrorCode.UNSUPPORTED, f"{path} includes {uri}: write it in one piece first, gz sdf -p {path.name} > whole"
        )
    models = [each for each in root.iter("model") if each.find("joint") is not None]
    if len(models) != 1 or models[0].find("model") is not None:
        what = "a model in a model" if len(models) == 1 else f"{len(models)} models with joints"
        raise InputError(ErrorCode.UNSUPPORTED, f"{path} has {what}: give a file with one model that has joints")
    version = tuple(int(part) for part in root.get("version", "1.9").split(".")[:2] if part.isdigit())
    try:
        return _Sdf(models[0], version, path, root.findtext(".//world/gravity")).described()
    except (ValueError, np.linalg.LinAlgError) as error:
        raise _invalid(path, str(error)) from error


def _parsed(path: Path) -> ElementTree.Element:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise _invalid(path, f"larger than {_MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _invalid(path, "not UTF-8 text") from error
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"cannot read the model {path}: {error.strerror}") from error
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities can grow without bound and name files
        raise _invalid(path, "it declares a document type or entities; remove them")
    try:
        root = ElementTree.fromstring(text.strip())
    except ElementTree.ParseError as error:
        raise _invalid(path, f"not well-formed XML ({error})") from error
    if root.tag != "sdf":
        raise _invalid(path, f"its root element is <{root.tag}>, expected <sdf>")
    return root


def _invalid(path: Path, reason: str) -> InputError:
    return InputError(ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{path}: {reason}")


class _Sdf:
    """One <model>."""

    def __init__(self, model: ElementTree.Element, version: tuple[int, ...], path: Path, gravity: str | None) -> None:
        self._model, self._version, self._path = model, version, path
        self._gravity = gravity
        self._links = {each.get("name", ""): each for each in model.findall("link")}
        self._joints = {each.get("name", ""): each for each in model.findall("joint")}
        frames = {each.get("name", ""): each for each in model.findall("frame")}
        self._placed = {**frames, **self._joints, **self._links}
        self._lost: list[str] = []

    def described(self) -> SimulatorModel:
        sensors, feeling = self._sensors()
        bodies = self._bodies(feeling)
        joints = {name: _physics(each) for name, each in self._joints.items() if each.get("type") != "fixed"}
        name = self._model.get("name", "")
        drives = self._drives()
        return SimulatorModel(
            self._path, "sdf", urdf_of(name, bodies), joints, drives, sensors, self._down(), tuple(self._lost)
        )

    def _down(self) -> float | None:
        if self._gravity is None:
            return None
        x, y, z = _numbers(self._gravity, 3, "gravity")
        if abs(x) + abs(y) > 1e-3 * abs(z) or z > 0.0:
            raise InputError(ErrorCode.UNSUPPORTED, f"{self._path}: gravity is {x:g} {y:g} {z:g}: turn the model")
        return -z

    def _pose(self, name: str, seen: tuple[str, ...] = ()) -> Pose:
        """A link, joint or frame in the model's frame."""
        if name in ("", "__model__", "world"):
            return Pose.identity()
        if name not in self._placed or name in seen:
            raise ValueError(f"the frame {name} {'is in a circle' if name in seen else 'does not exist'}")
        element = self._placed[name]
        pose = element.find("pose")
        # Of a joint, the default is the frame of its child; of a frame, the one that it is attached to.
        usual = element.findtext("child", "").strip() if element.tag == "joint" else element.get("attached_to", "")
        relative = usual if pose is None else pose.get("relative_to", usual)
        return self._pose(relative, (*seen, name)) @ _pose_of(pose)

    def _bodies(self, feeling: dict[str, list[SensorNoise]]) -> list[TreeBody]:
        parents = {self._end(each, "child"): each for each in self._joints.values()}
        if len(parents) != len(self._joints):
            raise ValueError("a link is the child of two joints")
        found = [TreeBody("world", None, Pose.identity())]
        placed, left = {"world"}, dict(self._links)
        while left:
            ready = [n for n in left if n not in parents or self._end(parents[n], "parent") in placed]
            if not ready:
                raise ValueError(f"joints form a circle, or a parent is missing: {', '.join(left)}")
            for name in ready:
                found += self._link(name, parents.get(name), feeling)
                placed.add(name)
                del left[name]
        return found

    def _end(self, joint: ElementTree.Element, role: str) -> str:
        name = joint.findtext(role, "").strip()
        if name not in self._links and not (role == "parent" and name == "world"):
            raise ValueError(f"joint {joint.get('name')} names the {role} {name}, which is no link")
        return name

    def _link(
        self, name: str, joint: ElementTree.Element | None, feeling: dict[str, list[SensorNoise]]
    ) -> list[TreeBody]:
        """A link, behind its joint and its force sensors."""
        parent = "world" if joint is None else self._end(joint, "parent")
        made: list[TreeBody] = []
        place = self._pose(parent).inverse @ self._pose(name)
        if joint is not None and joint.get("type") != "fixed":
            at = self._pose(name).inverse @ self._pose(joint.get("name", ""))
            made.append(TreeBody(f"{name}__{joint.get('name')}", parent, place @ at, self._tree_joint(joint, at)))
            place = at.inverse
        for sensor in feeling.get(name, []):
            made.append(TreeBody(sensor.frame, made[-1].name if made else parent, place))
            place = Pose.identity()
        last = TreeBody(name, made[-1].name if made else parent, place)
        if len(made) == 1 and made[0].joint is not None and _is_identity(place):
            last = replace(made.pop(), name=name)
        return [*made, replace(last, inertial=_inertial(self._links[name]))]

    def _tree_joint(self, joint: ElementTree.Element, at: Pose) -> TreeJoint:
        name, kind = joint.get("name", ""), joint.get("type", "")
        axis = joint.find("axis")
        if kind not in _KINDS or axis is None or joint.find("axis2") is not None:
            raise InputError(ErrorCode.UNSUPPORTED, f"{self._path}: joint {name} is {kind}: joint states have one axis")
        xyz = axis.find("xyz")
        direction = np.array(_numbers("0 0 1" if xyz is None else xyz.text or "", 3, f"the axis of joint {name}"))
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        old = self._version < _JOINT_FRAME and axis.findtext("use_parent_model_frame", "").strip() in ("1", "true")
        if frame or old:
            here = self._pose(joint.get("name", ""))
            direction = here.rotation.T @ self._pose(frame or "__model__").rotation @ direction
        length = float(np.linalg.norm(direction))
        if not length > 0.0:
            raise ValueError(f"the axis of joint {name} has no length")
        limits = (_number(axis, "limit/lower", -np.inf), _number(axis, "limit/upper", np.inf))
        lower, upper = (value if abs(value) < _ENDLESS else np.sign(value) * np.inf for value in limits)
        endless = not np.isfinite([lower, upper]).all()
        if kind == "revolute" and endless:
            kind = "continuous"
        if kind == "prismatic" and endless:
            lower, upper = -1e3, 1e3
        return TreeJoint(name, _KINDS[kind], direction / length, float(lower), float(upper), _follows(axis))

    def _sensors(self) -> tuple[tuple[SensorNoise, ...], dict[str, list[SensorNoise]]]:
        """Force-torque sensors; and by the link that each carries: the child of its joint, or the link that has it."""
        found: dict[str, list[SensorNoise]] = {}
        for element in (*self._joints.values(), *self._links.values()):
            for sensor in element.findall("sensor"):
                if sensor.get("type") != "force_torque":
                    continue
                carried = self._end(element, "child") if element.tag == "joint" else element.get("name", "")
                noise = [
                    max(_number(sensor, f"force_torque/{what}/{axis}/noise/stddev", 0.0) for axis in "xyz")
                    for what in ("force", "torque")
                ]
                if sensor.find("pose") is not None:
                    self._lost.append(f"the pose of sensor {sensor.get('name')}: it is taken at the origin of its link")
                found.setdefault(carried, []).append(SensorNoise(sensor.get("name", ""), *noise))
        return tuple(each for some in found.values() for each in some), found

    def _drives(self) -> dict[str, JointDrive]:
        """Position controllers among the plugins of the model."""
        found = {}
        for plugin in self._model.findall("plugin"):
            joint = plugin.findtext("joint_name", "").strip()
            if "JointPositionController" not in plugin.get("name", "") or joint not in self._joints:
                continue
            gain, limit = _number(plugin, "p_gain", 1.0), abs(_number(plugin, "cmd_max", np.inf))
            if _number(plugin, "i_gain", 0.0):
                self._lost.append(f"the integral gain of the controller of {joint}")
            damping = _number(plugin, "d_gain", 0.0)
            found[joint] = JointDrive("", "position", gain, gain, damping, limit=(-limit, limit))
        return found


def _physics(joint: ElementTree.Element) -> JointPhysics:
    names = ("friction", "damping", "", "spring_stiffness", "spring_reference")
    return JointPhysics(*(_number(joint, f"axis/dynamics/{name}", 0.0) if name else 0.0 for name in names))


def _follows(axis: ElementTree.Element) -> tuple[str, float, float] | None:
    mimic = axis.find("mimic")
    if mimic is None:
        return None
    multiplier, offset, reference = (_number(mimic, name, 0.0) for name in ("multiplier", "offset", "reference"))
    return mimic.get("joint", ""), multiplier, offset - multiplier * reference


def _inertial(link: ElementTree.Element) -> InertialParameters | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    pose = _pose_of(inertial.find("pose"))
    xx, xy, xz, yy, yz, zz = (
        _number(inertial, f"inertia/{name}", usual)
        for name, usual in (("ixx", 1.0), ("ixy", 0.0), ("ixz", 0.0), ("iyy", 1.0), ("iyz", 0.0), ("izz", 1.0))
    )
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    turned = pose.rotation @ about_com @ pose.rotation.T
    return InertialParameters(_number(inertial, "mass", 1.0), pose.translation, turned)


def _pose_of(element: ElementTree.Element | None) -> Pose:
    """x y z roll pitch yaw, or with rotation_format="quat_xyzw" a quaternion."""
    if element is None or not (element.text or "").split():
        return Pose.identity()
    if element.get("rotation_format") == "quat_xyzw":
        return Pose.from_vector(_numbers(element.text or "", 7, "a pose"))
    values = _numbers(element.text or "", 6, "a pose")
    angles = np.radians(values[3:]) if element.get("degrees") == "true" else values[3:]
    return Pose(pin.rpy.rpyToMatrix(*np.asarray(angles, dtype=np.float64)), np.array(values[:3]))


def _number(element: ElementTree.Element, place: str, usual: float) -> float:
    text = element.findtext(place)
    if text is None or not text.strip():
        return usual
    value = float(text)
    if np.isnan(value):
        raise ValueError(f"<{place}> is no number")
    return value


def _numbers(text: str, count: int, what: str) -> list[float]:
    values = [float(part) for part in text.split()]
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{what} must be {count} numbers, it is '{text.strip()[:60]}'")
    return values


def _is_identity(pose: Pose) -> bool:
    return bool(np.allclose(pose.rotation, np.eye(3), atol=1e-12) and not np.any(np.abs(pose.translation) > 1e-12))
