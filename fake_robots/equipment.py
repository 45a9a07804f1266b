"""What a simulated arm has besides its joints and its sensor, from parameters: gripper, base, world, camera."""

from typing import TYPE_CHECKING, Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.fake_robots.arm import Equipment
from poise.fake_robots.drive import BASE_JOINTS, Drive
from poise.fake_robots.gripper import FingerTravel, SimulatedGripper
from poise.fake_robots.link_frames import LinkFrames
from poise.files import package_file
from poise.geometry import Pose, rotation_about
from poise.nodes.parameters import WORDS, Parameter
from poise.robot import RobotModel

if TYPE_CHECKING:  # imported where they are used: few arms have a world or a camera
    from poise.fake_robots.camera import RenderedCamera
    from poise.fake_robots.handling import Handling
    from poise.fake_robots.world import World

_OPTICAL = "camera_color_optical_frame"

EQUIPMENT_PARAMETERS = (
    Parameter("gripper_joint", "", "arm: name of the joint that gripper_trajectory commands; empty: no gripper"),
    Parameter("gripper_speed", 1.0, "arm: rad/s or m/s of that joint", (1e-3, 100.0)),
    Parameter("gripper_open", 0.0, "arm: its position with the fingers gripper_stroke apart", (-10.0, 10.0)),
    Parameter("gripper_closed", 0.8, "arm: its position with the fingers together", (-10.0, 10.0)),
    Parameter("gripper_stroke", 0.085, "arm: m, the widest opening", (1e-3, 1.0)),
    Parameter("gripper_force", 100.0, "arm: N of the fingers on a body", (0.1, 1e4)),
    Parameter("gripper_action", "gripper_controller/gripper_cmd", "arm: name of the action GripperCommand"),
    Parameter("allow_stalling", True, "arm: fingers that a body stops have reached the goal of the action"),
    Parameter("tf_rate", 50.0, "arm: Hz of tf; 0: no tf, tf_static", (0.0, 1e3)),
    Parameter("base", False, "arm: mount it on a base that drives (a robot with base joints has one)"),
    Parameter("base_height", 0.4, "arm: m of its root link over the floor on that base", (0.01, 10.0)),
    Parameter("base_acceleration", [1.0, 2.0], "arm: largest acceleration of the base, m/s2 and rad/s2"),
    Parameter("cmd_vel_timeout", 0.5, "arm: s without cmd_vel after which the base stops", (0.01, 100.0)),
    Parameter("cmd_vel_stamped", False, "arm: cmd_vel is a TwistStamped, as nav2 of Jazzy may send, not a Twist"),
    Parameter("world", "", "arm: scene file (YAML) of objects around it; needs gripper_joint"),
    Parameter("world_engine", "quasistatic", "arm: what moves its objects", ("quasistatic", "mujoco")),
    Parameter("world_frame", "world", "arm: frame of that scene"),
    Parameter("robot_pose", [0.0] * 4, "arm: where its root link stands in the scene, x y z m and yaw rad"),
    Parameter("riding", WORDS, "arm: ids of fixed objects of the scene that the base carries"),
    Parameter("tool_frame", "tcp", "arm: frame between the finger tips, z out of the hand, y along their motion"),
    Parameter("pad_friction", 0.5, "arm: friction of the finger pads", (0.0, 5.0)),
    Parameter("camera", False, "arm: a depth and colour camera on the hand sees the world"),
    Parameter("camera_rate", 5.0, "arm: Hz of its images", (0.01, 100.0)),
    Parameter("camera_width", 640, "arm: pixels; the height is three quarters of it", (16, 1920)),
    Parameter("camera_parent", "", "arm: link that carries it; empty: that of the sensor frame"),
    Parameter(
        "camera_pose",
        [0.075, 0.0, -0.0175, 0.0, 0.0, 0.5**0.5, 0.5**0.5],
        "arm: its optical frame in that link, x y z m and quaternion x y z w",
    ),
)


def make_equipment(values: dict[str, Any], model: RobotModel, description: str) -> Equipment:
    """What the parameters describe.

    Raises:
        InputError: BAD_INPUT for parameters that do not fit each other; FRAME_UNKNOWN; as `load_scene`.
    """
    gripper = _gripper(values)
    root = _numbers(values, "robot_pose", 4)
    standing = Pose(rotation_about(np.array([0.0, 0.0, 1.0]), root[3]), root[:3])
    drive = None
    if set(BASE_JOINTS) <= set(model.joint_names):
        forward, turning = _numbers(values, "base_acceleration", 2)
        if forward <= 0 or turning <= 0:
            raise InputError(ErrorCode.BAD_INPUT, "parameter base_acceleration must be two positive numbers")
        drive = Drive((forward, turning), values["cmd_vel_timeout"])
    handling: Handling | None = None
    camera: RenderedCamera | None = None
    more: list[tuple[str, str, Pose]] = []
    if values["camera"] and not values["world"]:
        raise InputError(ErrorCode.BAD_INPUT, "parameter camera: there is nothing to see; give the parameter world")
    if values["world"]:
        handling = _handling(values, model, description, gripper, standing)
        more.append((values["world_frame"], model.base_frame, standing))
    if values["camera"]:
        camera = _camera(values, model)
        more.append((camera.mounted.parent, _OPTICAL, camera.mounted.pose))
    return Equipment(gripper, drive, handling, camera, values["tf_rate"], tuple(more))


def _gripper(values: dict[str, Any]) -> SimulatedGripper | None:
    if not values["gripper_joint"]:
        return None
    opened, closed = values["gripper_open"], values["gripper_closed"]
    if opened == closed:
        raise InputError(ErrorCode.BAD_INPUT, "parameters gripper_open and gripper_closed must differ")
    travel = FingerTravel(opened, closed, values["gripper_stroke"], values["gripper_force"])
    return SimulatedGripper(values["gripper_joint"], values["gripper_speed"], travel)


def _handling(
    values: dict[str, Any], model: RobotModel, description: str, gripper: SimulatedGripper | None, standing: Pose
) -> "Handling":
    from poise.assembly import load_scene
    from poise.fake_robots.grip import Pads
    from poise.fake_robots.handling import Handling
    from poise.fake_robots.mujoco_world import MujocoWorld
    from poise.fake_robots.world import QuasistaticWorld

    if gripper is None:
        raise InputError(ErrorCode.BAD_INPUT, "parameter world: nothing grasps without a gripper; give gripper_joint")
    model.frame_id(values["tool_frame"])
    engine = MujocoWorld if values["world_engine"] == "mujoco" else QuasistaticWorld
    scene, pads = load_scene(package_file(values["world"])), Pads(friction=values["pad_friction"])
    if scene.friction is None:
        raise InputError(
            ErrorCode.BAD_INPUT, "parameter world: the scene gives no friction; what falls may meet any body"
        )
    if movable := [item.id for item in scene.objects if item.id in values["riding"] and not item.fixed]:
        raise InputError(ErrorCode.BAD_INPUT, f"parameter riding: {', '.join(movable)} is not fixed in the scene")
    world: World = engine(scene, pads, tuple(values["riding"]))
    return Handling(world, model, LinkFrames(description, model), gripper, values["tool_frame"], standing)


def _camera(values: dict[str, Any], model: RobotModel) -> "RenderedCamera":
    from poise.fake_robots.camera import Mounted, RenderedCamera
    from poise.fake_robots.sweep_bag import VGA
    from poise.scanning import Camera

    parent = values["camera_parent"] or values["sensor_frame"]
    model.frame_id(parent)
    scale = values["camera_width"] / VGA.width
    height = round(VGA.height * scale)
    lens = (VGA.fx * scale, VGA.fy * scale, (VGA.cx + 0.5) * scale - 0.5, (VGA.cy + 0.5) * scale - 0.5)
    camera = Camera(values["camera_width"], height, *lens)
    pose = _numbers(values, "camera_pose", 7)
    if not pose[3:].any():
        raise InputError(ErrorCode.BAD_INPUT, "parameter camera_pose: its quaternion is zero")
    mounted = Mounted(parent, _OPTICAL, Pose.from_vector(pose), camera, values["camera_rate"])
    return RenderedCamera(mounted, values["seed"])


def _numbers(values: dict[str, Any], name: str, count: int) -> Any:
    numbers = np.asarray(values[name], dtype=np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise InputError(ErrorCode.BAD_INPUT, f"parameter {name} must be {count} finite numbers")
    return numbers
