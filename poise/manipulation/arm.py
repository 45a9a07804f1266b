"""An arm at its place in the scene: joints, tool frame, and the simple shapes of its links."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about
from poise.manipulation.bodies import se3_of
from poise.manipulation.hand import Hand
from poise.robot import find_urdf, parse_urdf, read_urdf
from poise.types import Array

_BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""A mobile base stands still while its arm works."""
_SAMPLES = 200
_ALWAYS = 0.5
"""Pairs of links that touch in this share of all configurations do so because their shapes are coarse."""


def standing_at(base: Sequence[float]) -> Pose:
    """Of a root link that stands upright in the scene: x, y, z, m, and yaw, rad."""
    return Pose(rotation_about(np.array([0.0, 0.0, 1.0]), base[3]), np.array(base[:3]))


@dataclass(frozen=True, eq=False)
class Arm:
    """The joints that move a tool frame, and the collision shapes of the URDF.

    Args:
        model: of pinocchio, reduced to the joints that move the tool frame.
        geometry: collision shapes of its links.
        tcp: index of the tool frame.
        hand: the fingers at the tool frame; the palm is one of the URDF's shapes.
        base: pose of the root link in the scene.
    """

    model: pin.Model
    geometry: pin.GeometryModel
    tcp: int
    hand: Hand
    base: pin.SE3

    @classmethod
    def load(
        cls,
        robot: str | Path,
        base: Pose | None = None,
        hand: Hand | None = None,
        tcp_frame: str = "tcp",
    ) -> "Arm":
        """Read a URDF, or a robot that comes with Poise (fr3, xarm7, ur5e, ur10e, ridgeback_ur10).

        Args:
            robot: path or name; collision shapes that are meshes are not opened.
            base: pose of its root link in the scene; None: at the origin.
            hand: what is mounted; None: a Robotiq 2F-85.
            tcp_frame: the frame between the finger tips.

        Raises:
            InputError: FILE_UNREADABLE, ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN.
        """
        path = find_urdf(robot)
        return cls.from_urdf(read_urdf(path), base, hand, tcp_frame, str(path))

    @classmethod
    def from_urdf(
        cls,
        text: str,
        base: Pose | None = None,
        hand: Hand | None = None,
        tcp_frame: str = "tcp",
        source: str = "robot description",
    ) -> "Arm":
        """Build from the text of a URDF.

        Args:
            text: collision shapes that are meshes are not opened.
            base, hand, tcp_frame: as `load`.
            source: where the text is from, for errors.

        Raises:
            InputError: ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN, UNSUPPORTED.
        """
        parse_urdf(text)
        try:
            model = pin.buildModelFromXML(text)
            geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
        except Exception as error:  # any pinocchio exception
            raise InputError(
                ErrorCode.ROBOT_DESCRIPTION_INVALID, f"{source}: cannot be built with its collision shapes: {error}"
            ) from error
        if not model.existFrame(tcp_frame, pin.FrameType.BODY):
            raise InputError(ErrorCode.FRAME_UNKNOWN, f"{source}: there is no frame {tcp_frame!r} to grasp with")
        moving = set(model.supports[model.frames[model.getFrameId(tcp_frame, pin.FrameType.BODY)].parentJoint])
        still = [i for i in range(1, model.njoints) if i not in moving or model.names[i] in _BASE_JOINTS]
        reference = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
        model, (geometry,) = pin.buildReducedModel(model, [geometry], still, reference)
        if model.nq != model.nv or not model.nv:
            raise InputError(ErrorCode.UNSUPPORTED, f"{source}: an arm of joints without limits is not planned for")
        tcp = int(model.getFrameId(tcp_frame, pin.FrameType.BODY))
        at = pin.SE3.Identity() if base is None else se3_of(base)
        return cls(model, geometry, tcp, hand or Hand(), at)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """From the base outwards."""
        return tuple(self.model.names[1:])

    @cached_property
    def lower(self) -> Array:
        """(J,) rad; joints that turn more than once are asked for one turn."""
        return np.asarray(np.maximum(self.model.lowerPositionLimit, -np.pi))

    @cached_property
    def upper(self) -> Array:
        """(J,) rad."""
        return np.asarray(np.minimum(self.model.upperPositionLimit, np.pi))

    @cached_property
    def velocity_limit(self) -> Array:
        """(J,) rad/s."""
        return np.array(self.model.upperVelocityLimit)

    @cached_property
    def data(self) -> pin.Data:
        """Work space of pinocchio; one thread at a time."""
        return self.model.createData()

    def tool(self, q: Array) -> pin.SE3:
        """Pose of the tool frame in the scene."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.base * self.data.oMf[self.tcp]

    def joint_origins(self, q: Array) -> Array:
        """(J, 3) m, in the scene: where the joints are at a configuration, from the base outwards."""
        self.tool(q)
        return np.array([(self.base * place).translation for place in list(self.data.oMi)[1:]])

    @cached_property
    def wrist(self) -> int:
        """The joint that carries the hand."""
        return int(self.model.frames[self.tcp].parentJoint)

    @cached_property
    def wrist_tcp(self) -> pin.SE3:
        """The tool frame in the last joint's."""
        return self.model.frames[self.tcp].placement

    @cached_property
    def palm(self) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
        """Shapes of the last link and what is mounted on it, in the tool frame."""
        return [
            (shape.geometry, self.wrist_tcp.actInv(shape.placement))
            for shape in self.geometry.geometryObjects
            if shape.parentJoint == self.wrist
        ]

    def shapes(self, q: Array, opening: float) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
        """The shapes of links and fingers at a configuration, in the scene; for looking at."""
        tool, data = self.tool(q), self.geometry.createData()
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, data, q)
        links = zip(self.geometry.geometryObjects, data.oMg, strict=True)
        fingers = [(shape, tool * place) for shape, place in self.hand.fingers(opening)]
        return [*((link.geometry, self.base * place) for link, place in links), *fingers]

    @cached_property
    def foot(self) -> tuple[str, pin.SE3]:
        """The link that carries the first joint, and its pose in the root link: joints of a base before it stand still.

        Where a base has driven, tf has this link elsewhere; `standing_on` minds that.
        """
        number = self.model.frames[self.model.getFrameId(self.model.names[1])].parentFrame
        return str(self.model.frames[number].name), self.model.frames[number].placement

    def standing_on(self, foot: Pose) -> "Arm":
        """The same arm with the link that carries its first joint at a pose in the scene."""
        return replace(self, base=se3_of(foot) * self.foot[1].inverse())

    @cached_property
    def shoulder(self) -> Array:
        """(3,) m, in the root link: where the second joint is, which the first does not move far."""
        pin.forwardKinematics(self.model, self.data, (self.lower + self.upper) / 2)
        return np.array(self.data.oMi[min(2, self.model.njoints - 1)].translation)

    @cached_property
    def reach(self) -> float:
        """m, how far from the shoulder the tool frame can be at most: all links in one line."""
        joints = [np.linalg.norm(place.translation) for place in self.model.jointPlacements[2:]]
        return float(sum(joints) + np.linalg.norm(self.wrist_tcp.translation))

    @cached_property
    def self_pairs(self) -> list[tuple[int, int]]:
        """Pairs of shapes that may meet: on joints that are not neighbours, and not nearly always in touch."""
        shapes = self.geometry.geometryObjects
        asked = self.geometry.copy()
        asked.removeAllCollisionPairs()
        pairs = []
        for i in range(len(shapes)):
            for j in range(i + 1, len(shapes)):
                joints = sorted((shapes[i].parentJoint, shapes[j].parentJoint))
                if joints[0] != joints[1] and self.model.parents[joints[1]] != joints[0]:
                    asked.addCollisionPair(pin.CollisionPair(i, j))
                    pairs.append((i, j))
        data, rng = asked.createData(), np.random.default_rng(0)
        often = np.zeros(len(pairs))
        for q in rng.uniform(self.lower, self.upper, (_SAMPLES, self.model.nq)):
            pin.computeCollisions(self.model, self.data, asked, data, q, False)
            often += [result.isCollision() for result in data.collisionResults]
        return [pair for pair, count in zip(pairs, often, strict=True) if count < _ALWAYS * _SAMPLES]
