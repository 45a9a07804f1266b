"""Node: the world as it is now: what stands in the assembly, what the hand holds, what each object weighs."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from poise.assembly import Analysis, settle
from poise.assembly.statics import Deadline, analysis_after, unstable
from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import Pose
from poise.nodes.assembly_changes import changed, changed_meanwhile, not_checked, stability_of
from poise.nodes.assembly_message import object_of, scene_of_node
from poise.nodes.clock import node_seconds
from poise.nodes.jobs import Job, Jobs, Task, run_with_jobs
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.payload import require_usable, weighed
from poise.nodes.request_checks import CallLimits, check_object
from poise.nodes.robustness_calls import Call, call_of
from poise.nodes.runtime import LATCHED, SCANS, TF_STATIC, coded, guarded
from poise.nodes.scanned_object import scanned_object
from poise.nodes.transforms import add_transforms, pose_between, pose_of, pose_of_transform
from poise.nodes.world_message import GRASP_EVENTS, standing_message, state_message, transforms_of
from poise.ranges import check_range
from poise.recording import stamp_of
from poise.robot import FrameTree
from poise.world import World, load_world, save_world, settled
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import GraspEvent, InertialEstimate, SegmentedObject, WorldState
from poise_msgs.srv import SetAssembly

_AHEAD = 1.0
"""s that a stamp may be ahead of this node's clock: one that is further would outlast all that happens until then."""
_FRAME_PATIENCE = 2.0
"""s that the transform of a scanned object may come after its scan."""

WORLD_MODEL_PARAMETERS = (
    Parameter("scene", "", "scene file to begin with, or package:// URI; empty: none"),
    Parameter("frame_id", "world", "frame of the poses of that scene (on a mobile base: the tray's)"),
    Parameter("state_file", "", "file that keeps the world over a restart; it goes before scene; empty: none"),
    Parameter(
        "longest",
        30.0,
        "longest deadline of set_assembly, and that of calls without one, s",
        (0.01, 3600.0),
        dynamic=True,
    ),
    Parameter("waiting", 50, "calls and scans that may wait; further ones are refused with BUSY", (1, 10_000)),
    Parameter("tf_rate", 10.0, "Hz at which the frames of objects are published on tf", (0.1, 100.0)),
    Parameter(
        "settle", 0.01, "m that a scan and the assembly may be off each other at the support", (0.0, 0.1), dynamic=True
    ),
    Parameter(
        "payload_age", 5.0, "age of its newest sample up to which an estimate is used, s", (0.1, 1e6), dynamic=True
    ),
    Parameter("payload_period", 1.0, "s between two estimates that are taken over", (0.0, 3600.0), dynamic=True),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
)


class WorldModel(Node):
    """Service set_assembly; topics assembly and world (latched), and tf of the objects.

    Subscribes to segmented_object, grasp_events, inertial_estimate, tf and tf_static. The lock guards `_world`.
    """

    def __init__(self) -> None:
        super().__init__("world_model")
        self._values = values = declare_parameters(self, WORLD_MODEL_PARAMETERS)
        self._folders = tuple(Path(folder) for folder in values["mesh_folders"])
        self._file = Path(values["state_file"]) if values["state_file"] else None
        self._lock = threading.RLock()
        self._frames = FrameTree(one_parent=False, keep=False)
        self._scan_frames: dict[str, tuple[str, Pose, int]] = {}
        self._scans: dict[str, tuple[SegmentedObject, float]] = {}
        self._weighed = 0.0
        self._known: Analysis | None = None
        self._assemblies = self.create_publisher(AssemblyMessage, "assembly", LATCHED)
        self._states = self.create_publisher(WorldState, "world", LATCHED)
        self._transforms = self.create_publisher(TFMessage, "tf", 10)
        self._world = World(values["frame_id"])
        try:
            self._change(lambda _: self._restored())
        except InputError as error:
            if error.code is not ErrorCode.FILE_UNWRITABLE:
                raise
            self.get_logger().error(f"the world is not kept over a restart: {error}")
        self._jobs = Jobs(self, values["waiting"])
        self._jobs.serve(SetAssembly, "set_assembly", self._task, self._seconds, self._say_version)
        for kind, topic, take, qos in (
            (SegmentedObject, "segmented_object", self._on_scan, SCANS),
            (GraspEvent, "grasp_events", self._on_event, GRASP_EVENTS),
            (InertialEstimate, "inertial_estimate", self._on_estimate, LATCHED),
        ):
            self.create_subscription(kind, topic, guarded(self, partial(self._heard, topic, take)), qos)
        self.create_subscription(TFMessage, "tf", guarded(self, self._on_tf), QoSProfile(depth=1000))
        self.create_subscription(TFMessage, "tf_static", guarded(self, self._on_tf_static), TF_STATIC)
        self.create_timer(1.0 / values["tf_rate"], guarded(self, self._publish_frames))

    def destroy_node(self) -> None:
        """Answer those who wait before the node goes."""
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    # -- the state --------------------------------------------------------------------------------------------------

    def _restored(self) -> World:
        """The world of the state file, else of the scene."""
        values = self._values
        if self._file is not None and self._file.exists():
            return load_world(self._file)
        if not values["scene"]:
            return self._world
        assembly = settle(scene_of_node(values["scene"])).assembly
        return self._world.with_assembly(assembly, values["frame_id"], self._now())

    def _change(self, transition: Callable[[World], World], expected: int = 0) -> World:
        """Make a transition, keep it in the file and publish it; what is refused changes nothing.

        Raises:
            InputError: of the transition; BAD_INPUT when the version is not the expected one; FILE_UNWRITABLE after
                the change, which holds until a restart.
        """
        with self._lock:
            before = self._world
            if expected not in (0, before.version):
                raise changed_meanwhile(expected, before.version)
            after = transition(before)
            if after is before and before.version:
                return before
            self._world = after
            self._publish(after.version != before.version)
            if self._file is not None and after.objects:
                save_world(after, self._file)
            return after

    def _publish(self, moved: bool, error: PoiseError | None = None) -> None:
        now = self._now()
        message = standing_message(self._world, now) if moved else None
        if message is not None:
            self._assemblies.publish(message)
        self._states.publish(state_message(self._world, now, error))

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _publish_frames(self) -> None:
        self._begin_scans()
        if transforms := transforms_of(self._world, self._now()):
            self._transforms.publish(TFMessage(transforms=transforms))

    # -- what is heard ----------------------------------------------------------------------------------------------

    def _heard(self, topic: str, take: Callable[[Any], None], message: Any) -> None:
        """Take a message; why it changes nothing is published, too."""
        try:
            take(message)
        except Exception as failure:
            self._refused(topic, coded(failure))

    def _refused(self, topic: str, error: PoiseError) -> None:
        what = f"{topic}: {error.code.name}: {error.message}"
        if topic == "inertial_estimate":  # one that is not used is no failure: the next ones follow
            self.get_logger().info(what, throttle_duration_sec=1.0)
        else:  # not in the same line of code: rclpy allows one severity for each
            self.get_logger().error(what, throttle_duration_sec=1.0)
        with self._lock:
            self._publish(False, error)

    def _on_tf(self, message: TFMessage) -> None:
        own = self._world.objects
        message.transforms = [each for each in message.transforms if each.child_frame_id not in own]
        add_transforms(self._frames, message)

    def _on_tf_static(self, message: TFMessage) -> None:
        for each in message.transforms:
            there = pose_of_transform(each.transform)
            self._scan_frames[each.child_frame_id] = each.header.frame_id, there, stamp_of(each)
        add_transforms(self._frames, message, fixed=True)

    def _stamp_of(self, message: Any) -> int:
        """ns; raises BAD_INPUT for a time that has not come."""
        stamp = stamp_of(message)
        if stamp > self._now() + _AHEAD * 1e9:
            what = f"its stamp is {1e-9 * (stamp - self._now()):.0f} s ahead: synchronize the clocks"
            raise InputError(ErrorCode.BAD_INPUT, what)
        return stamp

    def _on_event(self, message: GraspEvent) -> None:
        where = f"grasp_events of {message.id}: "
        stamp, pose = self._stamp_of(message), pose_of(message.pose, where)
        check_range("position", pose.translation, where)
        try:
            self._take_event(message, stamp, pose)
        except InputError as error:
            if error.code is ErrorCode.OBJECT_UNKNOWN:
                self._change(lambda world: world.passed(stamp))
            raise

    def _take_event(self, message: GraspEvent, stamp: int, pose: Pose) -> None:
        if message.event == GraspEvent.GRASPED:
            item = None
            for brought in message.object:
                check_object(brought)
                item = object_of(brought, self._folders)
            if not message.header.frame_id or (item is not None and item.id != message.id):
                what = "no frame_id of the hand, or an object of another id"
                raise InputError(ErrorCode.BAD_INPUT, f"grasp_events of {message.id}: {what}")
            lifted = (message.mass, message.mass_std) if message.mass > 0 and message.mass_std >= 0 else None
            hand = message.header.frame_id
            self._change(lambda world: world.grasped(message.id, pose, hand, stamp, item, lifted))
        elif message.event == GraspEvent.RELEASED:
            there = pose_between(self._frames, message.header.frame_id, self._world.frame) @ pose
            self._change(lambda world: world.released(message.id, there, stamp))
        elif message.event == GraspEvent.LOST:
            self._change(lambda world: world.lost(message.id, stamp, "the hand is empty: scan it again"))
        else:
            raise InputError(ErrorCode.BAD_INPUT, f"grasp_events of {message.id}: there is no event {message.event}")

    def _on_estimate(self, message: InertialEstimate) -> None:
        held, now = self._world.held, node_seconds()
        since = message.since.sec * 10**9 + message.since.nanosec
        if held is None or message.error.code != ErrorCode.OK or now - self._weighed < self._values["payload_period"]:
            return
        if since == 0:  # it uses all samples, also those from before the grasp
            return
        self._weighed = now
        require_usable(message, (self._now() - stamp_of(message)) * 1e-9, self._values["payload_age"])
        in_sensor = pose_between(self._frames, held.frame, message.header.frame_id) @ held.item.pose
        item = weighed(held.item, message, in_sensor)
        self._change(lambda world: world.weighed(item, since))

    # -- a scan -----------------------------------------------------------------------------------------------------

    def _on_scan(self, message: SegmentedObject) -> None:
        self._scans[message.id] = message, node_seconds()
        self._begin_scans()

    def _begin_scans(self) -> None:
        """Begin with the scans that wait, the oldest first: the world takes none that is older than its newest."""
        for message, heard in sorted(self._scans.values(), key=lambda waiting: stamp_of(waiting[0])):
            del self._scans[message.id]
            if not self._begin_scan(message, heard):
                self._scans[message.id] = message, heard
                return

    def _begin_scan(self, message: SegmentedObject, heard: float) -> bool:
        """Hand a scan to the thread, as soon as tf says where it was; False: not yet."""
        frame = message.header.frame_id
        try:
            if frame not in self._scan_frames:
                raise InputError(ErrorCode.FRAME_UNKNOWN, f"no transform of {frame} has come on tf_static")
            parent, pose, stamp = self._scan_frames[frame]
            if 0 < stamp < stamp_of(message):
                raise InputError(ErrorCode.FRAME_UNKNOWN, f"the transform of {frame} is of an earlier scan")
            there = pose_between(self._frames, parent, self._world.frame) @ pose
        except InputError as error:
            if node_seconds() < heard + _FRAME_PATIENCE:
                return False
            self._refused("segmented_object", error)
            return True
        if not self._jobs.do(partial(self._heard, "segmented_object", partial(self._take_scan, there), message)):
            self._refused("segmented_object", InputError(ErrorCode.BUSY, "too many calls wait; scan again"))
        return True

    def _take_scan(self, pose: Pose, message: SegmentedObject) -> None:
        """In the thread of the jobs: the object, settled on what it stands on, if that makes an assembly."""
        (item, notes), stamp = scanned_object(message, pose), self._stamp_of(message)
        while True:
            world = self._world
            assembly = world.assembly
            if assembly is not None:
                rest = assembly.without(item.id) if item.id in assembly.index else assembly
                item = settled(item, rest, self._values["settle"])
            after = world.scanned(item, stamp, notes)
            if after is world or after.assembly is None:
                return
            self._known = analysis_after(self._known, after.assembly)
            with self._lock:
                if self._world is world:
                    self._change(lambda _, after=after: after)  # type: ignore[misc]
                    return

    # -- set_assembly -----------------------------------------------------------------------------------------------

    def _seconds(self, request: SetAssembly.Request) -> float:
        return float(min(request.deadline or self._values["longest"], self._values["longest"]))

    def _say_version(self, response: SetAssembly.Response) -> None:
        response.version = self._world.version

    def _task(self, request: SetAssembly.Request) -> Task:
        longest, now = self._values["longest"], self._now()
        call = call_of("set", request, self._frames, self._world.frame, CallLimits(), longest, now)
        return Task(lambda job, _: self._set(call, job), size=len(call.request))

    def _set(self, call: Call, job: Job) -> SetAssembly.Response:
        """In the thread of the jobs: the change is made only while its caller still waits."""
        world, response = self._world, SetAssembly.Response()
        if call.expected not in (0, world.version):
            raise changed_meanwhile(call.expected, world.version)
        if call.uses_present and call.frame != world.frame:
            raise InputError(ErrorCode.BAD_INPUT, f"the frame of the assembly became {world.frame}; call again")
        request = deserialize_message(call.request, SetAssembly.Request)
        after = analysis_after(self._known, settle(changed(world.assembly, request, self._folders)).assembly)
        found = stability_of(after, response, Deadline(job.deadline))
        if found.doubtful:
            raise not_checked()
        world.with_assembly(after.assembly, call.frame, self._now())  # refused before its stability is looked into
        response.assumptions, response.version = [*call.notes, *response.assumptions], world.version
        if job.claim():
            with self._lock:
                if self._world.version != world.version:
                    raise changed_meanwhile(world.version, self._world.version)
                # What is held may have been weighed meanwhile: that is kept.
                change = partial(World.with_assembly, assembly=after.assembly, frame=call.frame, now=self._now())
                response.version = self._change(change).version
            self._known = after
        if not found.stable:
            error = unstable(found.falling, found.margin)
            response.error.code, response.error.message = int(error.code), error.message
        return response


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(WorldModel, args)


if __name__ == "__main__":
    main()
