"""The nodes as the loop uses them: clients of their actions and services, and what they publish."""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.node import Node
from sensor_msgs.msg import JointState

from poise.assembly import Assembly as AssembledScene
from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_of, pose_message
from poise.nodes.clock import node_seconds
from poise.nodes.loop_scan import LoopScan
from poise.nodes.loop_sequence import Carried, NodeEndedError, WeighedObject
from poise.nodes.loop_truth import LoopTruth
from poise.nodes.runtime import LATCHED, EventsExecutor
from poise.nodes.transforms import heard_frames, pose_of
from poise_msgs.action import CarryObject, IdentifyPayload, PickObject, PlaceObject, ScanObject
from poise_msgs.msg import Assembly, AssemblyObject, WorldObject, WorldState
from poise_msgs.srv import SetAssembly

_STEP = 0.02
_LOOK = 0.2
"""s between looks at the processes."""
_LOOKS = 3
"""Looks after which a node that was killed is seen to have ended."""
_NEWS = 15.0
"""s in which the world has to show what an action did."""
_SOLIDS = 40.0
"""s in which the world has to make solids of scans: about a second of computing each."""
_ACCEPTED = 30.0
_STOPPING = 15.0
"""s that a cancelled goal may take to stop the robot."""
_STILL = 1e-3
"""rad or m that joints may move in a second at rest."""
_GOAL = 600.0
"""s that a goal may take."""

ACTIONS: dict[str, tuple[str, Any]] = {
    "scan_object": ("object_scanner", ScanObject),
    "pick_object": ("object_picker", PickObject),
    "identify_payload": ("inertial_estimator", IdentifyPayload),
    "place_object": ("placement_planner", PlaceObject),
    "carry_object": ("object_carrier", CarryObject),
}
"""The node that serves each action, and its type."""


class NodesRobot:
    """A `LoopRobot` of nodes. Callbacks run inside its waits alone.

    Args:
        node: of the loop.
        values: parameters of the loop.
        check: looks after the processes; the names of the nodes that had ended since it was asked last.
        stopped: the loop is to end.
        progress: called with the words of a goal's feedback, and its share.
    """

    def __init__(
        self,
        node: Node,
        values: dict[str, Any],
        check: Callable[[], list[str]] = list,
        stopped: Callable[[], bool] = lambda: False,
        progress: Callable[[str, float], None] = lambda words, share: None,
    ) -> None:
        self._node, self._values, self._check, self._stopped, self._progress = node, values, check, stopped, progress
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        self._frames = heard_frames(node)
        self._world: WorldState | None = None
        self._assembly: Assembly | None = None
        self._odom: PoseStamped | None = None
        self._goal: PoseStamped | None = None
        self._joints: tuple[float, np.ndarray] = (0.0, np.zeros(0))
        self._heard = 0.0
        self._before: dict[str, np.ndarray] = {}
        self._looked, self._looks = 0.0, 0
        self.planning = 0.0
        """s that nodes planned and computed, by their results."""
        self._truth = LoopTruth(node, values["world"], self._frames) if values["world"] else None
        self._scan = LoopScan(node, values["world"]) if values["shapes"] == "given" else None
        used = {name: kind for name, (_, kind) in ACTIONS.items() if name != "scan_object" or self._scan is None}
        self._clients = {name: ActionClient(node, kind, name) for name, kind in used.items()}
        self._set = node.create_client(SetAssembly, "set_assembly")
        node.create_subscription(WorldState, "world", self._on_world, LATCHED)
        node.create_subscription(Assembly, "assembly", self._on_assembly, LATCHED)
        node.create_subscription(JointState, "joint_states", self._on_joints, 10)
        node.create_subscription(Odometry, "odom", self._on_odom, 10)

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()

    @property
    def assembly(self) -> AssembledScene | None:
        """What stands, as the world says."""
        return None if self._assembly is None else assembly_of(self._assembly, ())

    # -- what is heard ----------------------------------------------------------------------------------------------

    def _on_world(self, message: WorldState) -> None:
        self._world = message

    def _on_assembly(self, message: Assembly) -> None:
        self._assembly = message

    def _on_odom(self, message: Odometry) -> None:
        self._odom = PoseStamped(header=message.header, pose=message.pose.pose)

    def _on_joints(self, message: JointState) -> None:
        """Keep since when the joints have not moved."""
        position = np.array(message.position)
        before, self._heard = self._joints[1], node_seconds()
        if len(position) != len(before) or np.abs(position - before).max(initial=0.0) > _STILL:
            self._joints = node_seconds(), position

    # -- waiting ----------------------------------------------------------------------------------------------------

    def wait(self, condition: Callable[[], Any], seconds: float, what: str, node: str = "", heed: bool = True) -> Any:
        """Run callbacks until a condition holds; its value.

        Args:
            condition: asked again and again.
            seconds: that it may take, of the nodes' time and of the machine's: the clock goes on while a node computes.
            what: is waited for, in words.
            node: the one that works at it.
            heed: end when the loop is to end, and look after the processes.

        Raises:
            NodeEndedError: that node has ended.
            NoAnswerError: DEADLINE; CANCELLED when the loop is to end; as `check`.
        """
        until, until_on_machine = node_seconds() + seconds, time.monotonic() + seconds
        while not (value := condition()):
            if heed and self._stopped():
                raise NoAnswerError(ErrorCode.CANCELLED, f"the loop was stopped while it waited for {what}")
            now = node_seconds()
            if now > until and time.monotonic() > until_on_machine:
                raise NoAnswerError(ErrorCode.DEADLINE, f"there was no {what} within {seconds:.0f} s")
            if time.monotonic() > self._looked + _LOOK:  # the simulated clock stands still for a node that has ended
                self._looked, self._looks = time.monotonic(), self._looks + 1
                if heed and node in self._check():
                    raise NodeEndedError(node)
            self._executor.spin_once(timeout_sec=_STEP)
        return value

    def ready(self, seconds: float) -> None:
        """Wait for all nodes.

        Raises:
            NoAnswerError: DEADLINE, naming the first that does not come.
        """
        until = node_seconds() + seconds

        def left() -> float:
            return max(until - node_seconds(), 1.0)

        for name, client in self._clients.items():
            self.wait(client.server_is_ready, left(), f"action {name} of {ACTIONS[name][0]}")
        self.wait(self._set.service_is_ready, left(), "service set_assembly of world_model")
        self.wait(lambda: self._world and self._assembly and self._odom, left(), "topics world, assembly and odom")
        self.wait(lambda: self._joints[1].size, left(), "topic joint_states")

    def recover(self) -> None:
        """Wait until the robot rests and all nodes are there."""
        self.ready(self._values["ready_timeout"])
        begun = node_seconds()
        self.wait(lambda: self._heard > max(self._joints[0], begun) + 1.0, _STOPPING, "rest of the arm")

    def _do(self, name: str, seconds: float = _GOAL, **fields: Any) -> Any:
        """The result of a goal.

        Raises:
            PoiseError: of the result, or as `wait`; a goal that is left is cancelled first.
        """
        node, kind = ACTIONS[name]
        client = self._clients[name]
        self.wait(client.server_is_ready, self._values["ready_timeout"], f"action {name}", node)
        future = client.send_goal_async(kind.Goal(**fields), feedback_callback=self._on_feedback)
        try:
            handle = self.wait(lambda: future.done() and future.result(), _ACCEPTED, f"answer of {node}", node)
            if not handle.accepted:
                raise NoAnswerError(ErrorCode.BUSY, f"{node} does not take the goal {name}: it is not active")
            answer = handle.get_result_async()
            self.wait(answer.done, seconds, f"result of {name}", node)
        except NodeEndedError:
            raise
        except PoiseError:
            self._cancel(future, name)
            raise
        status, result = answer.result().status, answer.result().result
        if result.error.code == ErrorCode.INTERNAL:
            # The watchdog of a node that was killed answers for it, before its process is seen to have ended.
            enough = self._looks + _LOOKS
            self.wait(lambda: self._looks >= enough, _ACCEPTED, f"end of {node}", node)
        if result.error.code != ErrorCode.OK:
            raise NoAnswerError(ErrorCode(result.error.code), f"{name}: {result.error.message}")
        if status != GoalStatus.STATUS_SUCCEEDED:  # a result that its node did not fill in has the code OK, too
            raise NoAnswerError(ErrorCode.TOPIC_MISSING, f"{node} ended {name} with status {status} and no result")
        self.planning += getattr(result, "seconds", 0.0) if name != "carry_object" else 0.0
        return result

    def _cancel(self, sent: Any, name: str) -> None:
        """Cancel a goal and wait until it has ended, also one that is not accepted yet."""
        with suppress(NoAnswerError):
            handle = self.wait(lambda: sent.done() and sent.result(), _STOPPING, f"answer to {name}", heed=False)
            if handle.accepted:
                handle.cancel_goal_async()
                answer = handle.get_result_async()
                self.wait(answer.done, _STOPPING, f"end of {name}", heed=False)

    def _on_feedback(self, message: Any) -> None:
        said = message.feedback
        words = getattr(said, "stage", getattr(said, "phase", ""))
        self._progress(words, float(getattr(said, "progress", float("nan"))))

    # -- the steps --------------------------------------------------------------------------------------------------

    def scan(self, count: int) -> list[str]:
        """See `LoopRobot`. The largest objects come first: they carry the others."""
        if self._scan is not None:
            for name in self._scan.names[:count]:
                self._scan.publish(name)
                self.wait(partial(self.standing, name), _NEWS, f"{name} in the world: {self._why}")
        else:
            self._do("scan_object")
            self.wait(lambda: self._on_table, _SOLIDS, f"scanned objects in the world: {self._why}")
            with suppress(NoAnswerError):
                self.wait(lambda: len(self._on_table) >= count, _SOLIDS, "all objects")
        found = sorted(self._on_table, key=lambda known: -known.object.inertia.m)[:count]
        if self._truth is not None:
            for known in found:
                self._truth.match(known.object.id, pose_of(known.object.pose), known.frame_id)
        return [known.object.id for known in found]

    def pick(self, name: str, seed: int) -> None:
        """See `LoopRobot`."""
        self._do("pick_object", id=name, seed=seed, deadline=self._values["planning"])
        self.wait(lambda: self.held() == name, _NEWS, f"{name} in the hand: {self._why}")

    def weigh(self, attempt: int) -> WeighedObject:
        """See `LoopRobot`."""
        goal = IdentifyPayload.Goal
        motion = goal.MOTION_EXCITATION if attempt % 2 else goal.MOTION_STOP_AND_GO
        estimate = self._do("identify_payload", motion=motion).estimate
        name = self.held()
        self.wait(
            lambda: self._reached(name, WorldObject.HELD, WorldObject.WEIGHED),
            _NEWS,
            f"weight in the world: {self._why}",
        )
        inertia, frame = estimate.inertia, estimate.header.frame_id
        com = np.array([inertia.com.x, inertia.com.y, inertia.com.z])
        covariance = np.array(estimate.covariance).reshape(10, 10)[:4, :4]
        true = None if self._truth is None else self._truth.weight(name, frame)
        return WeighedObject(inertia.m, com, covariance, *(true or (None, None)))

    def place(self, seed: int) -> float:
        """See `LoopRobot`."""
        name = self.held()
        placed = self._do("place_object", held=True, execute=True, seed=seed, deadline=self._values["planning"])
        self.wait(lambda: self.standing(name), _NEWS, f"{name} on the tray: {self._why}")
        return float(placed.robustness)

    def held(self) -> str:
        """See `LoopRobot`."""
        objects = [] if self._world is None else self._world.objects
        return next((each.object.id for each in objects if each.state == WorldObject.HELD), "")

    def standing(self, name: str) -> bool:
        """See `LoopRobot`."""
        return self._reached(name, WorldObject.STANDING)

    def carry(self, distance: float, left_behind: list[str]) -> Carried:
        """See `LoopRobot`."""
        self._leave_behind(left_behind)
        if self._goal is None and self._odom is not None:
            there = pose_of(self._odom.pose)
            ahead = there.translation + distance * there.rotation[:, 0]
            self._goal = PoseStamped(header=self._odom.header, pose=pose_message(Pose(there.rotation, ahead)))
        frame = "" if self._assembly is None else self._assembly.header.frame_id
        if self._truth is not None and not self._before:  # a second attempt goes on from where the first stopped
            self._before = self._truth.places(frame, left_behind)
        found = self._do("carry_object", path=[self._goal], speed=self._values["speed"])
        moved = None
        if self._truth is not None and self._before:
            ended = node_seconds()
            self.wait(lambda: node_seconds() > ended + 1.0, _NEWS, "poses after the way")
            after = self._truth.places(frame, left_behind)
            moved = max(float(np.linalg.norm(after[name] - place)) for name, place in self._before.items())
        return Carried(found.distance, found.seconds, found.used, found.limit, moved)

    def _leave_behind(self, names: list[str]) -> None:
        """Take what does not ride out of the assembly.

        Raises:
            NoAnswerError: what set_assembly says.
        """
        known = [] if self._assembly is None else self._assembly.objects
        stay = [each.id for each in known if (each.fixed and each.id not in self._values["riding"]) or each.id in names]
        if not stay:
            return
        request = SetAssembly.Request(operation=SetAssembly.Request.REMOVE)
        request.assembly.objects = [AssemblyObject(id=name) for name in stay]
        future = self._set.call_async(request)
        answer = self.wait(lambda: future.done() and future.result(), _ACCEPTED, "answer of world_model", "world_model")
        if answer.error.code != ErrorCode.OK:
            raise NoAnswerError(ErrorCode(answer.error.code), f"set_assembly: {answer.error.message}")

    def _known(self, name: str) -> WorldObject | None:
        objects = [] if self._world is None else self._world.objects
        return next((each for each in objects if each.object.id == name), None)

    def _reached(self, name: str, state: int, source: int | None = None) -> bool:
        known = self._known(name)
        return known is not None and known.state == state and source in (None, known.source)

    @property
    def _on_table(self) -> list[WorldObject]:
        """Objects that were scanned and not touched."""
        objects = [] if self._world is None else self._world.objects
        fresh = WorldObject.STANDING, WorldObject.ASSUMED
        return [each for each in objects if (each.state, each.source) == fresh]

    @property
    def _why(self) -> str:
        """Why the world did not change, as it says."""
        return "" if self._world is None else self._world.error.message
