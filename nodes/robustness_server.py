"""Node: answers how hard an assembly may be pushed and in which order it comes apart, and keeps the assembly."""

import contextlib
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from poise.assembly import Analysis, RigidObject, assess, load_scene, plan_disassembly, robustness_map
from poise.assembly.robustness import MAX_MAP_POINTS, Robustness, RobustnessMap
from poise.assembly.statics import Deadline, analysis_after, unstable
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.files import package_file
from poise.geometry import Pose
from poise.nodes.assembly_markers import MOST_DRAWN, cleared, map_markers, mechanism_markers, scene_markers
from poise.nodes.assembly_message import (
    assembly_message,
    assembly_of,
    assumptions_of,
    objects_of,
    pairs_of,
    pushes_of,
    robustness_message,
)
from poise.nodes.jobs import Jobs, run_with_jobs
from poise.nodes.map_message import map_message
from poise.nodes.parameters import WORDS, Parameter, declare_parameters
from poise.nodes.runtime import LATCHED, TF_STATIC, guarded
from poise.nodes.transforms import add_transforms
from poise.robot import FrameTree
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

_MARKER_PERIOD = 0.5
"""s between looks for markers that have changed."""
_MARKER_SECONDS = 2.0
"""s that the map of the markers may take."""
_MAP_TOLERANCE = 0.03
_MAX_PUSHES = 10_000
"""Pushes in one call."""

ROBUSTNESS_SERVER_PARAMETERS = (
    Parameter("scene", "", "scene file to begin with; empty: none"),
    Parameter("frame_id", "world", "frame of the poses of that scene (on a mobile base: the tray's)"),
    Parameter("waiting", 200, "calls that may wait; further calls are refused with BUSY", (1, 10_000)),
    Parameter("longest", 30.0, "deadline of calls without one, s", (0.01, 3600.0)),
    Parameter("poses_from_tf", False, "poses of movable objects are those of the tf frames named by their ids"),
    Parameter("tf_rate", 5.0, "Hz at which tf is read", (0.1, 50.0)),
    Parameter("tf_tolerance", 0.0005, "m and rad; smaller motions in tf are ignored", (0.0, 1.0)),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
    Parameter("most_map_points", 100_000, "largest number of map points of one call", (1, MAX_MAP_POINTS)),
    Parameter("marker_map_points", 0, "points of the map in the markers of a new assembly; 0: none", (0, MOST_DRAWN)),
)


class RobustnessServer(Node):
    """Services assess_robustness, plan_disassembly, set_assembly; topics assembly and robustness_markers (latched).

    The assembly and its analysis belong to the thread of the jobs; the executor only takes in and hands out.
    """

    def __init__(self) -> None:
        super().__init__("robustness_server")
        values = declare_parameters(self, ROBUSTNESS_SERVER_PARAMETERS)
        self._longest: float = values["longest"]
        self._marker_map_points: int = values["marker_map_points"]
        self._most_map_points: int = values["most_map_points"]
        self._folders = tuple(Path(folder) for folder in values["mesh_folders"])
        self._frame_id: str = values["frame_id"]
        self._analysis: Analysis | None = None
        self._version = 0
        self._problem: PoiseError | None = None
        self._recent: Analysis | None = None
        self._own_stamps: deque[tuple[int, int]] = deque(maxlen=100)
        self._answered: tuple[Sequence[Robustness], RobustnessMap | None] = (), None
        self._drawn = True
        self._assemblies = self.create_publisher(AssemblyMessage, "assembly", LATCHED)
        self._clouds = self.create_publisher(PointCloud2, "robustness_map", LATCHED)
        self._marker_arrays = self.create_publisher(MarkerArray, "robustness_markers", LATCHED)
        if values["scene"]:
            self._keep(Analysis.of(load_scene(package_file(values["scene"]))))
        self._jobs = Jobs(self, values["waiting"])
        self._jobs.serve(AssessRobustness, "assess_robustness", self._assess, self._seconds)
        self._jobs.serve(PlanDisassembly, "plan_disassembly", self._plan, self._seconds)
        self._jobs.serve(SetAssembly, "set_assembly", self._set, self._seconds)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED)
        self.create_timer(_MARKER_PERIOD, guarded(self, self._draw_soon))
        if values["poses_from_tf"]:
            self._follow_tf(values["tf_rate"], values["tf_tolerance"])

    def destroy_node(self) -> None:
        """Answer those who wait before the node goes."""
        if hasattr(self, "_jobs"):
            self._jobs.close()
        super().destroy_node()

    def _seconds(self, request: Any) -> float:
        """That a call may take; a deadline that is not a positive number is none."""
        return request.deadline if 0 < request.deadline < self._longest else self._longest

    # -- in the thread of the jobs ---------------------------------------------------------------------------------

    def _assess(self, request: AssessRobustness.Request, response: AssessRobustness.Response, deadline: float) -> None:
        for name, count, most in (
            ("pushes", len(request.pushes), _MAX_PUSHES),
            ("map_points", request.map_points, self._most_map_points),
        ):
            if count > most:
                raise InputError(ErrorCode.BAD_INPUT, f"{name}: {count} in one call; this server takes {most} at most")
        pushes = pushes_of(request.pushes, request.groups)
        start = time.perf_counter()
        analysis = self._analysis_for(request)
        found = assess(analysis, pushes, request.model, max(deadline - time.monotonic(), 0.0))
        complete, mapped = found.complete, None
        if request.map_points and found.stable:
            tolerance = request.map_tolerance or _MAP_TOLERANCE
            left = max(deadline - time.monotonic(), 0.0)
            mapped = robustness_map(analysis, request.map_points, tolerance, request.model, left)
            complete &= mapped.complete
        for result in found.results:
            _ = result.mode, result.mechanism  # computed when first used: part of the computation, too
        response.seconds = time.perf_counter() - start
        response.stable, response.margin, response.falling = found.stable, found.margin, list(found.falling)
        response.robustness = [robustness_message(result) for result in found.results]
        response.version = 0 if request.assembly else self._version
        response.assumptions = assumptions_of(analysis.assembly)
        if mapped is not None:
            header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._frame_of(request))
            response.map = [map_message(mapped, header)]
            self._clouds.publish(response.map[0].cloud)
        if analysis is self._analysis and found.stable:
            self._remember(found.results, mapped)
        if not (found.stable or found.doubtful):
            raise unstable(found.falling, found.margin)
        if not complete:
            raise _late("the bounds are what was certified by then")

    def _plan(self, request: PlanDisassembly.Request, response: PlanDisassembly.Response, deadline: float) -> None:
        start = time.perf_counter()
        analysis = self._analysis_for(request)
        found = plan_disassembly(analysis, request.target or None, max(deadline - time.monotonic(), 0.0))
        response.seconds = time.perf_counter() - start
        response.version = 0 if request.assembly else self._version
        response.assumptions = assumptions_of(analysis.assembly)
        response.order, response.safe, response.margins = list(found.order), list(found.safe), list(found.margins)
        if not found.complete:
            raise _late("what is not marked safe was not looked into")

    def _set(self, request: SetAssembly.Request, response: SetAssembly.Response, deadline: float) -> None:
        response.version = self._version
        if request.expected_version not in (0, self._version):
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"expected_version {request.expected_version}: the assembly is version {self._version} by now; read it "
                "from the topic assembly, and send the change again",
            )
        analysis = self._changed(request)
        self._frame_id = request.assembly.header.frame_id or self._frame_id
        self._keep(analysis)
        response.version, response.assumptions = self._version, assumptions_of(analysis.assembly)
        found = analysis.stability(Deadline(deadline))
        response.stable, response.margin, response.falling = found.stable, found.margin, list(found.falling)
        if found.doubtful:
            raise _late("the assembly is set, but elastic contacts were not asked everywhere whether it stands")
        if not found.stable:
            raise unstable(found.falling, found.margin)

    def _changed(self, request: SetAssembly.Request) -> Analysis:
        message = request.assembly
        if request.operation == SetAssembly.Request.REPLACE:
            return analysis_after(self._analysis, assembly_of(message, self._folders))
        if self._analysis is None:
            raise self._problem or InputError(ErrorCode.EMPTY, "there is no assembly to change; set one with REPLACE")
        if request.operation == SetAssembly.Request.ADD_OR_MOVE:
            return self._analysis.with_object(*objects_of(message, self._folders), pairs=pairs_of(message))
        if request.operation == SetAssembly.Request.REMOVE:
            analysis = self._analysis
            for item in message.objects:
                analysis = analysis.without(item.id)
            return analysis
        raise InputError(ErrorCode.BAD_INPUT, f"operation {request.operation} is none of REPLACE, ADD_OR_MOVE, REMOVE")

    def _analysis_for(self, request: Any) -> Analysis:
        """Of the assembly that a call brings, else of the one that was set."""
        if not request.assembly:
            if self._problem is not None:
                raise self._problem
            if self._analysis is None:
                raise InputError(ErrorCode.EMPTY, "no assembly has been set; call set_assembly, or send one along")
            return self._analysis
        self._recent = analysis_after(self._recent, assembly_of(request.assembly[0], self._folders))
        return self._recent

    def _frame_of(self, request: Any) -> str:
        return request.assembly[0].header.frame_id if request.assembly else self._frame_id

    def _keep(self, analysis: Analysis, publish: bool = True) -> None:
        """Make an analysis the one for calls without an assembly, and publish its assembly."""
        self._analysis, self._problem = analysis, None
        self._version += 1
        self._answered = (), None
        self._drawn = False
        if publish:
            message = assembly_message(analysis.assembly, self._frame_id)
            message.header.stamp = self.get_clock().now().to_msg()
            self._own_stamps.append((message.header.stamp.sec, message.header.stamp.nanosec))
            self._assemblies.publish(message)

    def _remember(self, results: Sequence[Robustness], mapped: RobustnessMap | None) -> None:
        """Keep what the markers show; they are made after the answer."""
        self._answered = (results or self._answered[0], mapped or self._answered[1])
        self._drawn = False

    def _draw(self) -> None:
        markers = [cleared(self._frame_id)]
        if self._analysis is not None:
            results, mapped = self._answered
            if mapped is None and self._marker_map_points:
                with contextlib.suppress(PoiseError):  # an assembly that does not stand has no map
                    mapped = robustness_map(self._analysis, self._marker_map_points, deadline=_MARKER_SECONDS)
                self._answered = results, mapped
            markers += scene_markers(self._analysis, self._frame_id)
            markers += mechanism_markers(self._analysis, results, self._frame_id) if results else []
            markers += map_markers(mapped, self._frame_id) if mapped is not None else []
        self._marker_arrays.publish(MarkerArray(markers=markers))

    def _take_message(self, message: AssemblyMessage) -> None:
        """Take an assembly from the topic. After a bad one there is no assembly, and callers get its error."""
        before, self._analysis = self._analysis, None
        try:
            analysis = analysis_after(before, assembly_of(message, self._folders))
        except PoiseError as error:
            self._drawn = False
            self._refuse("assembly", error)
            return
        self._frame_id = message.header.frame_id or self._frame_id
        self._keep(analysis, publish=False)

    def _take_poses(self, poses: dict[str, Pose], reference: str, tolerance: float) -> None:
        """Move what has moved in tf, all at once; poses in a frame that the assembly no longer has are left out.

        An error of poses holds until tf gives better ones; that of an assembly message until a good assembly comes.
        """
        if self._analysis is None or reference != self._frame_id:
            return
        assembly = self._analysis.assembly
        moved = [
            replace(item, pose=poses[item.id])
            for item in assembly.objects
            if item.id in poses and _apart(item, poses[item.id]) > tolerance
        ]
        if not moved:
            self._problem = None
            return
        try:
            self._keep(self._analysis.with_object(*moved))
        except PoiseError as error:
            self._refuse("poses from tf", error)

    def _refuse(self, what: str, error: PoiseError) -> None:
        self._problem = error
        self.get_logger().error(f"{what}: {error.code.name}: {error.message}", throttle_duration_sec=1.0)

    # -- in the executor -------------------------------------------------------------------------------------------

    def _on_assembly(self, message: AssemblyMessage) -> None:
        if (message.header.stamp.sec, message.header.stamp.nanosec) in self._own_stamps:
            return
        if not self._jobs.do(lambda: self._take_message(message)):
            raise NoAnswerError(ErrorCode.BUSY, "an assembly came while too many calls were waiting; it was left out")

    def _draw_soon(self) -> None:
        if not self._drawn:
            self._drawn = self._jobs.do(self._draw)

    def _follow_tf(self, rate: float, tolerance: float) -> None:
        frames = FrameTree(one_parent=False, keep=False)
        take = partial(add_transforms, frames)
        self.create_subscription(TFMessage, "tf", guarded(self, take), QoSProfile(depth=1000))
        self.create_subscription(TFMessage, "tf_static", guarded(self, partial(take, fixed=True)), TF_STATIC)

        def look() -> None:
            analysis, reference = self._analysis, self._frame_id
            if analysis is None:
                return
            names = [item.id for item in analysis.assembly.objects if not item.fixed]
            poses = {name: pose for name in names if (pose := frames.pose(name, reference)) is not None}
            if poses:
                self._jobs.do(lambda: self._take_poses(poses, reference, tolerance))

        self.create_timer(1.0 / rate, guarded(self, look))


def _apart(item: RigidObject, pose: Pose) -> float:
    """How far an object is from a pose, m or rad, whichever is more."""
    turn = item.pose.rotation.T @ pose.rotation
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return max(float(np.linalg.norm(item.pose.translation - pose.translation)), angle)


def _late(what: str) -> NoAnswerError:
    return NoAnswerError(ErrorCode.DEADLINE, f"the deadline passed: {what}")


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_with_jobs(RobustnessServer, args)


if __name__ == "__main__":
    main()
