"""The kinematic chain of a robot up to its force-torque sensor, and the load of the links beyond it."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.kernels import Chain
from poise.robot.urdf import Inertial, Mimic, UrdfTree, parse_urdf, read_urdf
from poise.types import Array, Indices

MODELS = Path(__file__).parent / "models"
"""The URDFs that come with Poise: fr3, xarm7, ur5e, ur10e, ridgeback_ur10."""


@dataclass(frozen=True)
class RobotModel:
    """The kinematic chain from a robot's base to its force-torque sensor.

    Only joints between the base and the sensor move; all others (gripper fingers, wheels, a second arm) are locked at
    zero, or at the nearest position that their limits allow. Mimic joints follow their source.

    Args:
        pinocchio: the reduced model; with a floating base its first joint is a free flyer.
        sensor_frame: name of the measuring frame.
        base_frame: name of the root link.
        joint_names: (J) the independent joints that move the sensor, from the base outwards.
        coupling: (M, J) and
        offset: (M,) positions of the model's M moving joints = coupling @ joints + offset (mimic joints).
        lower, upper: (J,) rad or m, infinite for continuous joints.
        velocity_limit: (J,) rad/s or m/s.
        effort_limit: (J,) N m or N.
        load_in_sensor: (10,) what the URDF fixes beyond the sensor (a gripper) as
            (m, m c, Ixx, Ixy, Ixz, Iyy, Iyz, Izz), inertia about the sensor's origin. The sensor frame's own link
            counts as the robot's side.
    """

    pinocchio: pin.Model
    sensor_frame: str
    base_frame: str
    joint_names: tuple[str, ...]
    coupling: Array
    offset: Array
    lower: Array
    upper: Array
    velocity_limit: Array
    effort_limit: Array
    load_in_sensor: Array
    base: Literal["fixed", "floating"]

    @classmethod
    def from_urdf(
        cls,
        text: str,
        sensor_frame: str = "ft_sensor",
        base: Literal["fixed", "floating"] = "fixed",
        locked: Mapping[str, float] | None = None,
    ) -> "RobotModel":
        """Build from the text of a URDF; meshes are not opened.

        Args:
            text: the URDF.
            sensor_frame: a link.
            base: floating when odometry gives the motion of the root link.
            locked: joints that are held, and where, rad or m: odometry contains their motion, or they do not move.

        Raises:
            InputError: ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN when there is no such sensor frame, or UNSUPPORTED
                when a planar or floating joint of the URDF lies between base and sensor.
        """
        tree = parse_urdf(text)
        full = _build(tree, base)
        _require_frame(full, sensor_frame)
        reference = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
        stated = locked or {}
        for name, position in stated.items():
            if full.existJointName(name):
                joint = full.joints[full.getJointId(name)]
                at = (np.cos(position), np.sin(position)) if joint.nq == 2 else position
                reference[joint.idx_q : joint.idx_q + joint.nq] = at
        moving = _joints_that_move(full, sensor_frame, tree.mimics)
        held = [i for i in range(1, full.njoints) if full.names[i] not in moving or full.names[i] in stated]
        reduced = pin.buildReducedModel(full, held, reference) if held else full
        return cls._assemble(tree, reduced, sensor_frame, base, _load_beyond(tree, full, sensor_frame, reference))

    @classmethod
    def from_file(
        cls, path: str | Path, sensor_frame: str = "ft_sensor", base: Literal["fixed", "floating"] = "fixed"
    ) -> "RobotModel":
        """Build from a URDF file, or from the name of a robot that comes with Poise (`fr3`, `xarm7`, ...).

        Raises:
            InputError: FILE_UNREADABLE, or as `from_urdf`.
        """
        found = find_urdf(path)
        text = read_urdf(found)
        try:
            return cls.from_urdf(text, sensor_frame, base)
        except InputError as error:
            raise InputError(error.code, f"{found}: {error.message}", **error.data) from error

    @classmethod
    def _assemble(
        cls, tree: UrdfTree, model: pin.Model, sensor_frame: str, base: Literal["fixed", "floating"], load: Array
    ) -> "RobotModel":
        first = 1 if base == "fixed" else 2  # joint 0 is the universe, a free flyer follows it
        moving = [model.names[i] for i in range(first, model.njoints)]
        mimics = {mimic.joint: mimic for mimic in tree.mimics}
        names = tuple(name for name in moving if name not in mimics)
        coupling, offset = np.zeros((len(moving), len(names))), np.zeros(len(moving))
        for row, name in enumerate(moving):
            mimic = mimics.get(name, Mimic(name, name, 1.0, 0.0))
            coupling[row, names.index(mimic.source)] = mimic.multiplier
            offset[row] = mimic.offset
        joints = [model.joints[model.getJointId(name)] for name in names]
        continuous = np.array([joint.nq != joint.nv for joint in joints], dtype=bool)
        at_q, at_v = (np.array([getattr(j, key) for j in joints], dtype=int) for key in ("idx_q", "idx_v"))
        return cls(
            pinocchio=model,
            sensor_frame=sensor_frame,
            base_frame=tree.root,
            joint_names=names,
            coupling=coupling,
            offset=offset,
            lower=np.where(continuous, -np.inf, model.lowerPositionLimit[at_q]),
            upper=np.where(continuous, np.inf, model.upperPositionLimit[at_q]),
            velocity_limit=model.upperVelocityLimit[at_v],
            effort_limit=model.upperEffortLimit[at_v],
            load_in_sensor=load,
            base=base,
        )

    def frame_id(self, name: str) -> int:
        """Index of a frame in the pinocchio model.

        Raises:
            InputError: FRAME_UNKNOWN, naming the frames that are spelt like it.
        """
        _require_frame(self.pinocchio, name)
        return _body(self.pinocchio, name)

    def order(self, names: Sequence[str], *values: ArrayLike) -> tuple[Array, ...]:
        """Columns of joint arrays (N, K), named as in a joint_states message, in this model's order (N, J).

        Extra joints are dropped.

        Raises:
            InputError: JOINT_MISSING, naming the joints that the message does not have; they are never read as zero.
        """
        at = {name: column for column, name in enumerate(names)}
        missing = [name for name in self.joint_names if name not in at]
        if missing:
            foreign = " - another robot's message?" if len(missing) == len(self.joint_names) else ""
            raise InputError(
                ErrorCode.JOINT_MISSING,
                f"joint states lack {', '.join(missing)}; they have {', '.join(names) or 'no names'}{foreign}",
                missing=missing,
            )
        columns = [at[name] for name in self.joint_names]
        return tuple(np.asarray(value, dtype=np.float64)[..., columns] for value in values)

    def configuration(self, position: Array) -> Array:
        """(N, J) joint positions -> (N, nq) of the pinocchio model, without a floating base's own seven."""
        moving = position @ self.coupling.T + self.offset
        columns: list[Array] = []
        for column, joint in enumerate(self._moving_joints()):
            angle = moving[:, column]
            columns += [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
        return np.stack(columns, axis=1) if columns else np.zeros((len(position), 0))

    def chain(self, frame: str) -> tuple[Chain, Indices]:
        """The joints from the base to a frame, and (J,) which of the moving joints these are.

        Raises:
            InputError: FRAME_UNKNOWN.
        """
        if frame not in self._chains:
            self._chains[frame] = self._chain(frame)
        return self._chains[frame]

    @cached_property
    def _chains(self) -> dict[str, tuple[Chain, Indices]]:
        return {}

    def _chain(self, frame: str) -> tuple[Chain, Indices]:
        model, end = self.pinocchio, self.pinocchio.frames[self.frame_id(frame)]
        first = 1 if self.base == "fixed" else 2
        path = [i for i in model.supports[end.parentJoint] if i >= first]
        data = model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        columns = np.zeros((len(path), 6))
        for row, i in zip(columns, path, strict=True):
            row[:] = np.reshape(pin.getJointJacobian(model, data, i, pin.LOCAL), (6, -1))[:, model.joints[i].idx_v]
        slides = np.linalg.norm(columns[:, 3:], axis=1) < 0.5
        places = [*(model.jointPlacements[i] for i in path), end.placement]
        placements = np.array([np.append(place.rotation, place.translation) for place in places])
        chain = Chain(placements, np.where(slides[:, None], columns[:, :3], columns[:, 3:]), slides.astype(np.int64))
        return chain, np.array(path, dtype=np.int64) - first

    @cached_property
    def base_joints(self) -> int:
        """Three when the first joints are a mobile base: two horizontal prismatic joints and a vertical turning one.

        Other prismatic joints, such as a rail or a lift under an arm, or a gantry, are part of the arm.
        """
        data = self.pinocchio.createData()
        pin.computeJointJacobians(self.pinocchio, data, pin.neutral(self.pinocchio))
        kinds: list[str] = []
        for index, joint in enumerate(self._moving_joints()):
            if joint.nv != 1 or index > 2:
                break
            first = 1 if self.base == "fixed" else 2
            columns = np.reshape(
                pin.getJointJacobian(self.pinocchio, data, first + index, pin.LOCAL_WORLD_ALIGNED), (6, -1)
            )
            linear, angular = columns[:3, joint.idx_v], columns[3:, joint.idx_v]
            slides = np.linalg.norm(angular) < 0.5
            level = abs(linear[2]) < 0.1 if slides else abs(angular[2]) > 0.99
            kinds.append(("slide" if slides else "turn") if level else "other")
        return 3 if kinds == ["slide", "slide", "turn"] else 0

    @property
    def slides_first(self) -> bool:
        """The first joint is prismatic."""
        return not set(self.joint_names[:1]).isdisjoint(self.prismatic)

    @property
    def prismatic(self) -> tuple[str, ...]:
        """The joints that slide: their positions are in m, their efforts in N."""
        model = self.pinocchio
        slides = {name for name, joint in zip(model.names, model.joints, strict=True) if _slides(joint)}
        return tuple(name for name in self.joint_names if name in slides)

    def _moving_joints(self) -> list[pin.JointModel]:
        return [self.pinocchio.joints[i] for i in range(1 if self.base == "fixed" else 2, self.pinocchio.njoints)]


def _slides(joint: pin.JointModel) -> bool:
    return str(joint.shortname()).startswith("JointModelP")


def find_urdf(path: str | Path) -> Path:
    """A path, or the file of a robot that comes with Poise when `path` is its name."""
    own = MODELS / f"{path}.urdf"
    return own if own.parent == MODELS and own.is_file() else Path(path)


def chains(text: str) -> list[tuple[str, tuple[str, ...]]]:
    """The last link of every chain from the root, with the independent joints that move it; the longest chain first.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID.
    """
    tree = parse_urdf(text)
    full = _build(tree, "fixed")
    source = {mimic.joint: mimic.source for mimic in tree.mimics}
    found: dict[tuple[str, ...], tuple[int, str]] = {}
    for frame in full.frames:
        if frame.type == pin.FrameType.BODY:
            names = [full.names[i] for i in full.supports[frame.parentJoint] if i]
            moving = tuple(dict.fromkeys(source.get(name, name) for name in names))
            depth = sum(1 for _ in _above(tree, frame.name))
            if depth > found.get(moving, (-1, ""))[0]:
                found[moving] = depth, frame.name
    return [(link, joints) for joints, (_, link) in sorted(found.items(), key=lambda each: -len(each[0]))]


def _above(tree: UrdfTree, link: str) -> Iterator[str]:
    while link in tree.parent_of:
        link = tree.parent_of[link]
        yield link


def phi_of(inertia: pin.Inertia) -> Array:
    """(10,) parameters about the frame's origin, in Poise's order, of a pinocchio inertia."""
    # pinocchio: m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
    return np.asarray(inertia.toDynamicParameters()[[0, 1, 2, 3, 4, 5, 7, 6, 8, 9]])


def inertia_of(phi: ArrayLike) -> pin.Inertia:
    """The pinocchio inertia of (10,) parameters in Poise's order about the frame's origin; zero without mass."""
    values = np.asarray(phi, dtype=np.float64)
    return (
        pin.Inertia.FromDynamicParameters(values[[0, 1, 2, 3, 4, 5, 7, 6, 8, 9]]) if values[0] else pin.Inertia.Zero()
    )


def _build(tree: UrdfTree, base: str) -> pin.Model:
    try:
        if base == "fixed":
            return pin.buildModelFromXML(tree.text)
        return pin.buildModelFromXML(tree.text, pin.JointModelFreeFlyer())
    except Exception as error:  # any pinocchio exception; urdfdom prints its reason to stderr
        raise InputError(
            ErrorCode.ROBOT_DESCRIPTION_INVALID,
            f"robot description: {tree.name or 'the URDF'} cannot be built ({error}); check_urdf says where",
        ) from error


def _body(model: pin.Model, name: str) -> int:
    return int(model.getFrameId(name, pin.FrameType.BODY))  # a joint may have the same name


def _require_frame(model: pin.Model, name: str) -> None:
    if model.existFrame(name, pin.FrameType.BODY):
        return
    names = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    near = difflib.get_close_matches(name, names, n=5, cutoff=0.5)
    there = ", ".join([*near, *(other for other in names if other not in near)])
    raise InputError(
        ErrorCode.FRAME_UNKNOWN, f"the robot description has no frame '{name}'; it has {there}", near=near or names[-8:]
    )


def _joints_that_move(model: pin.Model, frame: str, mimics: Sequence[Mimic]) -> set[str]:
    joint = model.frames[_body(model, frame)].parentJoint
    moving = {model.names[i] for i in model.supports[joint]}
    moving |= {mimic.source for mimic in mimics if mimic.joint in moving}
    for name in moving:
        shape = model.joints[model.getJointId(name)]
        if name not in ("universe", "root_joint") and shape.nv != 1:
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"joint {name} has {shape.nv} degrees of freedom, which joint states cannot carry; "
                "leave it out of the URDF and give the motion of the base (odom) instead",
            )
    return moving


def _load_beyond(tree: UrdfTree, model: pin.Model, sensor_frame: str, reference: Array) -> Array:
    """(10,) what the links beyond the sensor weigh, about the sensor's origin, with moving fingers at `reference`."""
    beyond = set(tree.beyond(sensor_frame))
    if not beyond:
        return np.zeros(10)
    data = model.createData()
    pin.framesForwardKinematics(model, data, reference)
    sensor = data.oMf[_body(model, sensor_frame)]
    total = np.zeros(10)
    for link in beyond & tree.inertials.keys():
        sensor_link = sensor.actInv(data.oMf[_body(model, link)])
        total += phi_of(sensor_link.act(_inertia(tree.inertials[link])))
    return total


def phi_in_link(inertial: Inertial) -> Array:
    """(10,) parameters of a URDF <inertial> about its link's origin, in the link's axes, in Poise's order."""
    return phi_of(_inertia(inertial))


def _inertia(inertial: Inertial) -> pin.Inertia:
    """The inertia of a URDF <inertial>, in its link's axes."""
    xx, xy, xz, yy, yz, zz = inertial.moments
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    rotation = pin.rpy.rpyToMatrix(*inertial.rpy)
    return pin.Inertia(inertial.mass, np.array(inertial.xyz), rotation @ about_com @ rotation.T)
