"""Node: answers how hard an assembly may be pushed and in which order it comes apart, and keeps the assembly."""

import itertools
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.nodes.assembly_changes import changed_meanwhile
from poise.nodes.assembly_markers import cleared
from poise.nodes.assembly_message import assembly_message, scene_of_node
from poise.nodes.diagnostics import OK, WARN, DiagnosticsPublisher
from poise.nodes.jobs import Job, Jobs, Task, run_with_jobs
from poise.nodes.parameters import declare_parameters
from poise.nodes.perceived_scene import PoseDoubt
from poise.nodes.present_assembly import PresentAssembly, Proposal
from poise.nodes.request_checks import CallLimits
from poise.nodes.robustness_calls import SHORT_OBJECTS, Call, call_of
from poise.nodes.robustness_server_parameters import ROBUSTNESS_SERVER_PARAMETERS
from poise.nodes.robustness_worker import RobustnessWorker, load_type_supports
from poise.nodes.runtime import LATCHED, guarded
from poise.nodes.transforms import heard_frames, moved_poses
from poise.nodes.workers import Worker, WorkerTemplate
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

_MARKER_PERIOD = 0.5
"""s between looks for markers that have changed."""
_HEALTH_PERIOD = 1.0
"""s between messages on diagnostics."""
_NICE = 10
"""How much the workers that take heavy calls leave the processor to the one that does not."""
_SERVICES = {
    "assess": (AssessRobustness, "assess_robustness"),
    "plan": (PlanDisassembly, "plan_disassembly"),
    "set": (SetAssembly, "set_assembly"),
}


class RobustnessServer(Node):
    """Services assess_robustness, plan_disassembly, set_assembly; topics assembly, robustness_map, robustness_markers.

    The executor takes in and hands out; threads wait for the processes that compute. The assembly changes in one place
    (`_commit`), after its analysis has been computed, and only while the caller still waits.

    Args:
        template: forks those processes.
    """

    def __init__(self, template: WorkerTemplate) -> None:
        super().__init__("robustness_server")
        self._template = template
        values = declare_parameters(self, ROBUSTNESS_SERVER_PARAMETERS)
        self._values = values
        self._keys = itertools.count(1)
        self._moving = False
        self._newest: Call | None = None  # of the newest assembly on the topic
        # The lock guards changes of what follows. An answer is about one `PresentAssembly`, read once.
        self._lock = threading.RLock()
        self._present = PresentAssembly(0, values["frame_id"])
        self._own_stamps: deque[tuple[int, int]] = deque(maxlen=100)
        self._layers: dict[str, list[Any]] = {}
        self._drawn, self._mapped = True, 0
        self._follow = values["follow"]
        if self._follow and (values["scene"] or values["poses_from_tf"]):
            what = "with follow, world_model has the scene and the poses: leave scene and poses_from_tf out"
            raise InputError(ErrorCode.BAD_INPUT, what)
        if not self._follow:
            self._assemblies = self.create_publisher(AssemblyMessage, "assembly", LATCHED)
        self._clouds = self.create_publisher(PointCloud2, "robustness_map", LATCHED)
        self._marker_arrays = self.create_publisher(MarkerArray, "robustness_markers", LATCHED)
        doubt = PoseDoubt(values["pose_std_position"], values["pose_std_rotation_deg"], values["samples"])
        settings = (values["mesh_folders"], values["marker_map_points"], doubt)
        memory = values["worker_memory"] * 1_000_000
        self._workers = [Worker(template, settings, memory, _NICE * (n > 0)) for n in range(values["workers"])]
        if values["scene"]:
            self._begin_with(values["scene"])
        most_bytes = 4 * values["most_bytes"]
        self._jobs = Jobs(self, values["waiting"], values["waiting_heavy"], values["workers"], most_bytes)
        for kind, (service, name) in _SERVICES.items():
            if kind == "set" and self._follow:
                continue
            refused = self._say_version if kind == "set" else None
            self._jobs.serve(service, name, partial(self._task, kind), self._seconds, refused)
        self.create_subscription(AssemblyMessage, "assembly", guarded(self, self._on_assembly), LATCHED)
        self._frames = heard_frames(self, 1000)
        self.create_timer(_MARKER_PERIOD, guarded(self, self._draw_soon))
        self._diagnostics = DiagnosticsPublisher(self)
        self.create_timer(_HEALTH_PERIOD, guarded(self, self._publish_health))
        if values["poses_from_tf"]:
            self.create_timer(1.0 / values["tf_rate"], guarded(self, self._follow_tf))

    def destroy_node(self) -> None:
        """Answer those who wait before the node goes, and end the workers."""
        if hasattr(self, "_jobs"):
            self._jobs.close()
        self._template.close()
        for worker in getattr(self, "_workers", ()):
            worker.stop()
        super().destroy_node()

    @property
    def _longest(self) -> float:
        """s that a call may take at most, now."""
        return float(self._values["longest"])

    @property
    def _limits(self) -> CallLimits:
        """Of one call, now."""
        return CallLimits(*(self._values[f"most_{name}"] for name in CallLimits._fields))

    # -- in the executor -------------------------------------------------------------------------------------------

    def _seconds(self, request: Any) -> float:
        return min(request.deadline or self._longest, self._longest)

    def _say_version(self, response: SetAssembly.Response) -> None:
        response.version = self._present.version

    def _task(self, kind: str, request: Any) -> Task:
        now = self.get_clock().now().nanoseconds
        call = call_of(kind, request, self._frames, self._present.frame, self._limits, self._longest, now)
        return Task(partial(self._answer, call), call.heavy, kind == "set", len(call.request))

    def _on_assembly(self, message: AssemblyMessage) -> None:
        if (message.header.stamp.sec, message.header.stamp.nanosec) in self._own_stamps:
            return
        request = SetAssembly.Request(assembly=message)
        before, version = self._newest, message.version if self._follow else 0
        self._newest = None
        try:
            call = call_of("set", request, self._frames, self._present.frame, self._limits, self._longest)
            self._newest = replace(call, version=version)
            self._change_by(self._newest, len(message.objects))
        except PoiseError as error:
            if error.code == ErrorCode.BUSY and not self._follow:
                self._newest = before
                raise
            self._refuse("assembly", error, version=version)

    def _follow_tf(self) -> None:
        """Have what moved in tf moved, all at once; an error of poses holds until tf gives better ones."""
        present = self._present
        if present.message is None or self._moving:
            return
        poses = moved_poses(present.seen_message or present.message, self._frames, self._values["tf_tolerance"])
        if poses:
            heavy = len(present.message.objects) > SHORT_OBJECTS
            call = Call("move", b"", present.frame, True, heavy, present.version, poses=poses)
            self._moving = True  # before it can end
            try:
                self._change_by(call, len(poses))
            except NoAnswerError:
                self._moving = False
                raise
        elif poses is not None:
            with self._lock:
                if self._present.version == present.version:
                    self._present = self._present._replace(problem=None)

    def _change_by(self, call: Call, objects: int) -> None:
        if not self._jobs.add(Task(partial(self._take, call), call.heavy, True, len(call.request)), self._longest):
            what = f"{call.kind} of {objects} objects came while too many calls were waiting; it was left out"
            raise NoAnswerError(ErrorCode.BUSY, what)

    def _draw_soon(self) -> None:
        """Have what has changed drawn; the map of a new assembly, which takes long, in the queue of heavy calls."""
        if not self._drawn:
            self._drawn = self._jobs.add(Task(lambda _, thread: self._draw(self._workers[thread])), self._longest)
        version = self._present.version
        if self._values["marker_map_points"] and self._mapped != version and "map" not in self._layers:
            task = Task(lambda _, thread: self._draw(self._workers[thread], with_map=True), heavy=True)
            self._mapped = version if self._jobs.add(task, self._longest) else 0

    def _publish_health(self) -> None:
        state = self._jobs.state
        stopped = sum(max(worker.starts - 1, 0) for worker in self._workers)
        crowded = state["waiting"] > self._jobs.most // 2
        message = "more than half of the calls that may wait do" if crowded else "ready"
        values = {**state, "workers": len(self._workers), "restarts": stopped, "version": self._present.version}
        self._diagnostics.publish(WARN if crowded else OK, message, values)

    # -- in the threads of the jobs --------------------------------------------------------------------------------

    def _begin_with(self, scene: str) -> None:
        """Set the assembly of a scene file."""
        present = self._present
        assembly = assembly_message(scene_of_node(scene), present.frame)
        call = Call("set", serialize_message(SetAssembly.Request(assembly=assembly)), present.frame, False)
        worker = self._workers[0]
        response, proposed = self._asked(worker, call, present, time.monotonic() + self._longest)
        if proposed is None:
            raise InputError(ErrorCode(response.error.code), response.error.message)
        self._commit(proposed, worker)

    def _answer(self, call: Call, job: Job, thread: int) -> Any:
        """The response to a call; a change is made only while its caller still waits."""
        present = self._present
        _require(call, present)
        worker = self._workers[thread]
        response, proposed = self._asked(worker, call, present, job.due, job.deadline)
        response.assumptions = [*call.notes, *response.assumptions]
        version = present.version
        if proposed is not None and job.claim():
            version = self._commit(proposed, worker)
        response.version = version if call.uses_present or call.kind == "set" else 0
        if call.kind != "assess":
            return response
        for found in response.map:
            self._clouds.publish(found.cloud)
        if call.uses_present and response.stable:
            if call.heavy:  # only this worker has what is to be drawn
                job.finish(response)
                self._draw(worker)
            self._drawn = call.heavy and self._drawn
        return response

    def _take(self, call: Call, job: Job, thread: int) -> None:
        """Change the assembly by a message on its topic, or by tf. After a bad message callers get its error."""
        what = "assembly" if call.kind == "set" else "poses from tf"
        worker, present = self._workers[thread], self._present
        try:
            if call.expected != present.version if call.kind == "move" else call is not self._newest:
                return  # something else has come since
            response, proposed = self._asked(worker, call, present, job.due, job.deadline)
            if proposed is None:
                raise InputError(ErrorCode(response.error.code), response.error.message)
        except PoiseError as error:
            self._refuse(what, error, forget=call.kind == "set", version=call.version)
        else:
            self._commit(proposed, worker, publish=call.kind == "move", version=call.version)
        finally:
            if call.kind == "move":
                self._moving = False

    def _asked(
        self, worker: Worker, call: Call, present: PresentAssembly, due: float, deadline: float | None = None
    ) -> tuple[Any, Proposal | None]:
        """The response of a worker, and the assembly that it proposes.

        Raises:
            PoiseError: as `Worker.ask`.
        """
        worker.start(due)
        if call.uses_present or (present.seen and call.kind == "set"):  # the contacts of before may stay
            self._teach(worker, present)
        now = self.get_clock().now().to_msg()
        key = next(self._keys)
        header = {
            "do": call.kind,
            "key": worker.state.get("key", 0),
            "next": key,
            "frame": call.frame,
            "stamp": [now.sec, now.nanosec],
            "deadline": due if deadline is None else deadline,
            "poses": call.poses,
        }
        messages = self._exchanged(worker, header, [call.request], due)
        service, _ = _SERVICES.get(call.kind, _SERVICES["set"])
        response = deserialize_message(messages[0], service.Response)
        proposed = Proposal(*messages[1:], call.frame, key, present.version) if len(messages) > 1 else None
        return response, proposed

    def _teach(self, worker: Worker, present: PresentAssembly) -> None:
        """Give a worker the assembly that is set, in a time of its own: one call may be too short for that."""
        if present.message is not None and worker.state.get("key", 0) != present.key:
            until = time.monotonic() + self._longest
            header = {"do": "hold", "key": present.key, "deadline": until}
            self._exchanged(worker, header, [present.serialized, present.seen], until)
            worker.state["key"] = present.key

    def _exchanged(self, worker: Worker, header: dict[str, Any], messages: list[bytes], due: float) -> list[bytes]:
        """What a worker answers; raises its error where the answer is no response that could hold it."""
        answer, messages = worker.ask(header, messages, due)
        if log := answer.get("log"):
            self.get_logger().error(f"internal error: {log}", throttle_duration_sec=1.0)
        if error := answer.get("error"):
            raise PoiseError(ErrorCode(error[0]), error[1])
        return messages

    def _commit(self, proposed: Proposal, worker: Worker, publish: bool = True, version: int = 0) -> int:
        """Make what a worker proposed the assembly that is set; its version, which may be given (0: the next one).

        Raises:
            InputError: BAD_INPUT when the assembly is no longer the one from which the proposal was computed.
        """
        with self._lock:
            if self._present.version != proposed.instead_of:
                raise changed_meanwhile(proposed.instead_of, self._present.version)
            version = version or proposed.instead_of + 1
            self._present = proposed.as_present(version)
            self._layers.clear()
            worker.state["key"] = proposed.key
            self._drawn = False
            if publish:
                stamp = self._present.message.header.stamp
                self._own_stamps.append((stamp.sec, stamp.nanosec))
                self._assemblies.publish(proposed.serialized)
            return version

    def _refuse(self, what: str, error: PoiseError, forget: bool = True, version: int = 0) -> None:
        """After a bad message there is no assembly; bad poses leave the one that is set."""
        with self._lock:
            if forget:
                self._present = PresentAssembly(
                    version or self._present.version + 1, self._present.frame, problem=error
                )
                self._layers.clear()
                self._drawn = False
            else:
                self._present = self._present._replace(problem=error)
        self.get_logger().error(f"{what}: {error.code.name}: {error.message}", throttle_duration_sec=1.0)

    def _draw(self, worker: Worker, with_map: bool = False) -> None:
        """Publish the markers; what another worker has drawn of this assembly stays.

        Args:
            worker: that draws what it has answered.
            with_map: it computes the map of the markers, too.
        """
        present = self._present
        markers: Sequence[Any] = ()
        if present.message is not None:
            due = time.monotonic() + self._longest
            worker.start(due)
            self._teach(worker, present)
            header = {"do": "draw", "key": present.key, "frame": present.frame, "map": with_map}
            (drawn,) = self._exchanged(worker, header, [], due)
            markers = deserialize_message(drawn, MarkerArray).markers
        with self._lock:
            if present.version != self._present.version:
                return
            for name in {marker.ns for marker in markers}:
                self._layers[name] = [marker for marker in markers if marker.ns == name]
            layers = [marker for layer in self._layers.values() for marker in layer]
        self._marker_arrays.publish(MarkerArray(markers=[cleared(present.frame), *layers]))


def _require(call: Call, present: PresentAssembly) -> None:
    """What a call presupposes about the assembly holds for this one."""
    if call.expected not in (0, present.version):
        raise changed_meanwhile(call.expected, present.version)
    if not call.uses_present:
        return
    if present.problem is not None and (present.message is None or call.kind != "set"):
        raise present.problem
    if present.message is None:
        raise InputError(ErrorCode.EMPTY, "no assembly has been set; call set_assembly, or send one along")
    if call.frame != present.frame:
        raise InputError(ErrorCode.BAD_INPUT, f"the frame of the assembly became {present.frame}; call again")


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    load_type_supports()
    template = WorkerTemplate(RobustnessWorker)
    run_with_jobs(lambda: RobustnessServer(template), args)


if __name__ == "__main__":
    main()
