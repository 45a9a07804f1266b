"""What a planned sweep is planned with: the camera, the arm at its place, the region to see, and what stands there."""

from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from poise.assembly import Box, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.manipulation import Arm, LookPlan, plan_look, pose_of
from poise.nodes.assembly_message import assembly_of, object_of
from poise.nodes.placed_arm import base_of, placed_arm
from poise.nodes.request_checks import check_assembly
from poise.nodes.runtime import LATCHED, guarded
from poise.nodes.transforms import heard_frames
from poise.robot import parse_urdf
from poise.scanning import Camera, RobotLog, ScannedBody, ViewOptions, ViewRegion, camera_of, hand_eye_of, names_of
from poise.shape import Solid
from poise.types import Array, Cancelled
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import WorldObject, WorldState

PLANNED = "plan"
"""Of the parameter `sweep`."""
_MARGIN = 0.03
"""m around an object of the assembly that is scanned again."""
_SLAB = 0.02


class SweepPlanner:
    """Hears assembly, world and tf all the time, and camera_info while a goal waits for it.

    Args:
        node: object_scanner.
        topic: of camera_info.
        values: parameters of the node.
    """

    def __init__(self, node: Node, topic: str, values: dict[str, Any]) -> None:
        self._node, self._topic, self._values = node, topic, values
        self._base = base_of(values)
        self._assembly: AssemblyMessage | None = None
        self._frames = heard_frames(node)
        self._camera: tuple[str, Camera] | None = None
        self._listening: Any = None
        self._world: WorldState | None = None
        node.create_subscription(AssemblyMessage, "assembly", guarded(node, self._on_assembly), LATCHED)
        node.create_subscription(WorldState, "world", guarded(node, self._on_world), LATCHED)

    def listen(self) -> None:
        """Begin to wait for the camera; it must be there before the arm moves."""
        self._camera = None
        if self._listening is None:
            qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._listening = self._node.create_subscription(
                CameraInfo, self._topic, guarded(self._node, self._on_camera), qos
            )

    def hush(self) -> None:
        """Wait no more."""
        if self._listening is not None:
            self._node.destroy_subscription(self._listening)
            self._listening = None

    def _on_assembly(self, message: AssemblyMessage) -> None:
        self._assembly = message

    def _on_world(self, message: WorldState) -> None:
        self._world = message

    def names(self, asked: str, solids: list[Solid], base: str) -> list[str]:
        """Of scanned objects, the one that was meant first; one that the world knows keeps its name.

        Args:
            asked: id of the goal; empty: it has none.
            solids: of the objects, in the frame `base`; without `all_objects`, one.
        """
        name = asked or self._values["object_id"]
        if not self._values["all_objects"]:
            return [name]
        bodies = [ScannedBody(solid.volumes @ solid.centroids / solid.volume, solid.volume) for solid in solids]
        known, held = self._known(base)
        if asked not in known:
            return names_of(bodies, known, name, held)
        del known[asked]
        return [asked, *names_of(bodies[1:], known, name, [*held, asked])]

    def _known(self, frame: str) -> tuple[dict[str, ScannedBody], list[str]]:
        """The objects of the world that stand or were lost, in a frame, and the names of those in the hand.

        Both are empty without a world, or where tf does not connect it with the frame.
        """
        world = self._world
        joined = None if world is None else self._frames.pose(world.header.frame_id, frame)
        if world is None or joined is None:
            return {}, []
        bodies = dict[str, ScannedBody]()
        for each in world.objects:
            if each.state != WorldObject.HELD:
                item = object_of(each.object)
                centre = joined.apply(item.pose.apply(item.shape.centroid))
                where = None if each.state == WorldObject.LOST else centre
                bodies[item.id] = ScannedBody(where, float(item.shape.volume))
        return bodies, [each.object.id for each in world.objects if each.state == WorldObject.HELD]

    def _on_camera(self, message: CameraInfo) -> None:
        self._camera = message.header.frame_id, camera_of(message)

    def arm(self, robot: RobotLog) -> tuple[Arm, list[str]]:
        """The arm at its place in the assembly's frame, by tf, else by the parameter `base`; what was assumed.

        Raises:
            InputError: ROBOT_DESCRIPTION_MISSING, ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN.
        """
        if not robot.description:
            raise InputError(ErrorCode.ROBOT_DESCRIPTION_MISSING, "there is no robot_description to sweep with")
        arm = Arm.from_urdf(robot.description, self._base, tcp_frame=self._values["tcp_frame"])
        if self._assembly is None:
            return arm, []
        return placed_arm(arm, self._frames, self._assembly.header.frame_id, self._values["base"])

    def task(self, name: str, arm: Arm, robot: RobotLog, given: list[Any]) -> "SweepTask":
        """What a goal is planned with; given: the parameter `hand_eye`, where there is one.

        Raises:
            InputError: TOPIC_MISSING without a camera, FRAME_UNKNOWN without a hand-eye transform, EMPTY without the
                assembly that is needed, OBJECT_UNKNOWN, BAD_INPUT.
        """
        if self._camera is None:
            raise InputError(
                ErrorCode.TOPIC_MISSING,
                f"no camera_info came on {self._topic}: start the camera's driver, or remap the topic; the arm did not"
                " move",
            )
        frame, camera = self._camera
        given = [replace(mounting, child=frame) for mounting in given]
        eye = hand_eye_of(robot.description, frame, [*robot.fixed.values(), *given])
        objects: tuple[RigidObject, ...] = ()
        if self._assembly is not None:
            check_assembly(self._assembly)
            objects = assembly_of(self._assembly).objects
        region, wanted = region_of(name, objects, self._values)
        around = tuple(item for item in objects if item is not wanted)
        if not any(item.fixed for item in around):
            around = (*around, _slab(region))
        options = ViewOptions(nearest=self._values["view_nearest"], farthest=self._values["view_farthest"])
        root = None
        if self._assembly is not None:
            root = self._frames.pose(parse_urdf(robot.description).root, self._assembly.header.frame_id)
        return SweepTask(arm, (eye.parent, eye), camera, region, around, options, root or pose_of(arm.base))


class SweepTask:
    """The plan of one goal, before it is made.

    Args:
        arm, eye, camera, region, around, options: as `plan_look` takes them.
        root: pose of the robot's root link in the scene.
    """

    def __init__(
        self,
        arm: Arm,
        eye: tuple[str, Pose],
        camera: Camera,
        region: ViewRegion,
        around: tuple[RigidObject, ...],
        options: ViewOptions,
        root: Pose,
    ) -> None:
        self.arm, self._options = arm, options
        self._with = eye, camera, region, around
        self.region = ViewRegion(root.inverse @ region.pose, region.size)
        """In the robot's root link."""

    def plan(self, start: Array, seconds: float, cancelled: Cancelled) -> LookPlan:
        """As `plan_look`; in the thread of the jobs."""
        return plan_look(self.arm, *self._with, start, self._options, seconds, cancelled=cancelled)


def region_of(
    name: str, objects: tuple[RigidObject, ...], values: dict[str, Any]
) -> tuple[ViewRegion, RigidObject | None]:
    """The region to see, and the object of the assembly that is scanned again, or None.

    Args:
        name: id of the goal.
        objects: of the assembly.
        values: the parameters region, support and region_height.

    Raises:
        InputError: OBJECT_UNKNOWN when the support is not there; EMPTY, BAD_INPUT when nothing gives a region.
    """
    known = next((item for item in objects if item.id == name and not item.fixed), None)
    if known is not None:
        low, high = known.vertices.min(axis=0), known.vertices.max(axis=0)
        return _upright(low - [_MARGIN, _MARGIN, 0.0], high + _MARGIN), known
    given = np.asarray(values["region"], dtype=np.float64)
    if given.shape != (6,) or np.isinf(given).any() or np.isnan(given).any() != np.isnan(given).all():
        raise InputError(
            ErrorCode.BAD_INPUT, "parameter region: give x y z of the middle of its bottom and its size, m"
        )
    if not np.isnan(given).any():
        if given[3:].min() <= 0:
            raise InputError(ErrorCode.BAD_INPUT, "parameter region: its size must be positive")
        half = np.array([given[3] / 2, given[4] / 2, 0.0])
        return _upright(given[:3] - half, given[:3] + half + [0.0, 0.0, given[5]]), None
    support = _support(values["support"], objects)
    low, high = support.vertices.min(axis=0), support.vertices.max(axis=0)
    return _upright(np.append(low[:2], high[2]), np.append(high[:2], high[2] + values["region_height"])), None


def _support(name: str, objects: tuple[RigidObject, ...]) -> RigidObject:
    fixed = [item for item in objects if item.fixed]
    found = [item for item in fixed if item.id == name] if name else fixed
    if len(found) == 1:
        return found[0]
    if not objects:
        raise InputError(
            ErrorCode.EMPTY, "no assembly has come, so that the table is not known: start world_model, or give region"
        )
    there = ", ".join(item.id for item in fixed) or "none"
    if name:
        raise InputError(
            ErrorCode.OBJECT_UNKNOWN, f"support: the assembly has no fixed object {name!r}; it has {there}"
        )
    raise InputError(
        ErrorCode.BAD_INPUT, f"the fixed objects of the assembly are {there}: choose the table by the parameter support"
    )


def _upright(low: Array, high: Array) -> ViewRegion:
    return ViewRegion(Pose(np.eye(3), (low + high) / 2), high - low)


def _slab(region: ViewRegion) -> RigidObject:
    """What the region stands on, where the assembly has nothing fixed."""
    size = region.size[:2] + 0.3
    place = region.pose.translation - [0.0, 0.0, (region.size[2] + _SLAB) / 2]
    return RigidObject("support", Box((*size.tolist(), _SLAB)), Pose(np.eye(3), place), fixed=True)
