"""The nodes that handle objects, for the same faults: world_model, object_picker, object_carrier, gripper_driver."""

import tempfile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from control_msgs.action import GripperCommand
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from benchmarks.chaos.observer import LATCHED, Observer
from benchmarks.chaos.subjects import CUBE_ON_FLOOR, Subject, box, cube_message
from poise.assembly import Assembly, Box, RigidObject
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.gripping import FakeGripper
from poise.nodes.assembly_message import assembly_message
from poise_msgs.action import CarryObject, PickObject
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import SetAssembly

_PATIENT = {"stop_unattended": 60.0, "stop_silence": 5.0, "motion_lead": 0.5, "ready_timeout": 20.0}
_CAN = np.array([0.4, -0.42, 0.05])


class World(Subject):
    """world_model, which keeps its state in a file."""

    node = "world_model"

    def parameters(self) -> dict[str, Any]:
        folder = Path(self.open.enter_context(tempfile.TemporaryDirectory()))
        return {"state_file": str(folder / "world.json")}

    def connect(self, observer: Observer) -> None:
        self._newest: AssemblyMessage | None = None
        observer.hear(AssemblyMessage, "assembly", self._see, latched=True)

    def _see(self, message: AssemblyMessage) -> None:
        self._newest = message

    def ask(self, observer: Observer, timeout: float) -> None:
        lid = box("lid", (1.0, 1.0, 0.1 + 0.1 * (self.right % 7)), 1.05 + 0.05 * (self.right % 7))
        there = assembly_message(Assembly((*CUBE_ON_FLOOR.objects, lid)), "tray")
        response = observer.call(SetAssembly, "set_assembly", SetAssembly.Request(assembly=there), timeout)
        if response.error.code not in (ErrorCode.OK, ErrorCode.FILE_UNWRITABLE):  # the latter after the change
            observer.rest(0.1)
            return

        def says() -> bool:
            return self._newest is not None and [each.pose for each in self._newest.objects] == [
                each.pose for each in there.objects
            ]

        observer.until(says, "the assembly", timeout)
        self.judge("" if response.stable or response.error.code else "a stack that stands is said to fall")

    def begin(self, observer: Observer) -> None:
        client = observer.node.create_client(SetAssembly, "set_assembly")
        observer.until(client.service_is_ready, "the service")
        for _ in range(20):
            client.call_async(SetAssembly.Request(assembly=cube_message()))
        observer.rest(0.05)


class Gripper(Subject):
    """gripper_driver with a gripper in software."""

    node, stream = "gripper_driver", True
    _ACTION = "gripper_controller/gripper_cmd"

    def parameters(self) -> dict[str, Any]:
        return {"address": self.open.enter_context(FakeGripper(active=True)).port, "speed": 0.15}

    def connect(self, observer: Observer) -> None:
        observer.hear(JointState, "joint_states", self._judge)

    def _judge(self, message: JointState) -> None:
        position = message.position[0]
        self.judge("" if -0.01 <= position <= 0.81 else f"position {position}")

    def begin(self, observer: Observer) -> None:
        client = observer.actor(GripperCommand, self._ACTION)
        observer.until(client.server_is_ready, "action gripper_cmd")
        goal = GripperCommand.Goal()
        goal.command.position = 0.4 * (1 + self.right % 2)
        observer.begin(client, goal)


class Picker(Subject):
    """The action pick_object of an arm beside a can; planned where an answer is asked for."""

    node, arm = "object_picker", True
    companions: ClassVar[dict[str, dict[str, Any]]] = {
        "fake_robot": {"mode": "arm", "robot": "fr3", "joint_rate": 60.0, "joint_noise": 0.0, "sensor": "low"}
        | {"gripper_joint": "finger_joint", "sensor_rate": 50.0}
    }

    def parameters(self) -> dict[str, Any]:
        return _PATIENT | {"gripper_joint": "finger_joint"}

    def connect(self, observer: Observer) -> None:
        super().connect(observer)
        self._assemblies = observer.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
        self.heal(observer)

    def heal(self, observer: Observer) -> None:
        """A hostile assembly may have taken the place of ours."""
        can = RigidObject("can", Box((0.05, 0.05, 0.1)), Pose(np.eye(3), _CAN), mass=0.3)
        floor = box("floor", (4.0, 4.0, 0.1), -0.05, fixed=True)
        self._assemblies.publish(assembly_message(Assembly((floor, can)), "base_link"))

    def ask(self, observer: Observer, timeout: float) -> None:
        goal = PickObject.Goal(id="can", seed=1, deadline=20.0, plan_only=True)
        result = observer.act(PickObject, "pick_object", goal, max(timeout, 25.0))
        if result is None or result.error.code:
            observer.rest(0.1)
            self.heal(observer)
            return
        at = result.grasp.pose.position
        off = np.abs(np.array([at.x, at.y, at.z]) - _CAN)
        self.judge("" if off.max() < 0.06 and result.trajectories else f"a grasp {off.max():.3f} m off the can")

    def begin(self, observer: Observer) -> None:
        client = observer.actor(PickObject, "pick_object")
        observer.until(client.server_is_ready, "action pick_object")
        self.hear_arm()
        observer.until(lambda: self._moving is not None, "joint states")
        self.start_moving(observer, client, PickObject.Goal(id="can", seed=1, deadline=20.0))


class Carrier(Subject):
    """The action carry_object of a base with a cube on it."""

    node, arm = "object_carrier", True
    companions: ClassVar[dict[str, dict[str, Any]]] = {
        "fake_robot": {"mode": "arm", "robot": "fr3", "base": True, "sensor": "none", "cmd_vel_timeout": 0.5},
        "acceleration_limits": {"azimuths": 8},
    }

    def parameters(self) -> dict[str, Any]:
        return {"path_tolerance": 2.0, "ready_timeout": 20.0}

    def connect(self, observer: Observer) -> None:
        self._odom: Odometry | None = None
        self._assemblies = observer.node.create_publisher(AssemblyMessage, "assembly", LATCHED)
        observer.hear(Odometry, "odom", self._see_base)
        self.heal(observer)

    def heal(self, observer: Observer) -> None:
        """A hostile assembly may have taken the place of ours."""
        message = assembly_message(CUBE_ON_FLOOR, "base_footprint")
        message.header.stamp = observer.node.get_clock().now().to_msg()
        self._assemblies.publish(message)

    def _see_base(self, message: Odometry) -> None:
        self._odom = message

    @property
    def arm_is_at_rest(self) -> bool:
        """The base is: its last odometry has no velocity."""
        return self._odom is not None and abs(self._odom.twist.twist.linear.x) < 1e-3

    def hear_arm(self) -> None:
        """Forget the last odometry."""
        self._odom = None

    def _goal(self, observer: Observer, distance: float) -> CarryObject.Goal:
        self._odom = None
        observer.until(lambda: self._odom is not None, "odometry")
        target = PoseStamped()
        if self._odom is not None:
            target.header.frame_id = self._odom.header.frame_id
            target.pose.orientation = self._odom.pose.pose.orientation
            target.pose.position.x = self._odom.pose.pose.position.x + distance
        return CarryObject.Goal(path=[target])

    def ask(self, observer: Observer, timeout: float) -> None:
        goal = self._goal(observer, 0.1 * (-1) ** self.right)
        result = observer.act(CarryObject, "carry_object", goal, max(timeout, 15.0))
        if result is None or result.error.code:
            observer.rest(0.1)
            self.heal(observer)
            return
        off = abs(result.pose.pose.position.x - goal.path[0].pose.position.x)
        self.judge("" if off < 0.05 else f"the base is {off:.3f} m off its goal")

    def begin(self, observer: Observer) -> None:
        client = observer.actor(CarryObject, "carry_object")
        observer.until(client.server_is_ready, "action carry_object")
        self.start_moving(observer, client, self._goal(observer, 3.0))


HANDLING: dict[str, type[Subject]] = {
    "world_model": World,
    "object_picker": Picker,
    "object_carrier": Carrier,
    "gripper_driver": Gripper,
}
