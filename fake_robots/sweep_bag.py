"""A recorded sweep that never was: an arm with a depth camera on its hand circles a scene, written to a bag."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from poise.fake_robots.depth_noise import D435, StereoNoise, measured
from poise.fake_robots.rasteriser import Scene, render
from poise.recording import JointStream, PoseStream, RecordingWriter, encode_stream, encode_text, typestore
from poise.robot import Mounting, RobotModel, find_urdf, frame_poses
from poise.scanning import Camera, Frame, Ring, View, depth_in_metres, plan_sweep
from poise.simulation import WaypointTrajectory
from poise.types import Array

_OPTICAL = "camera_color_optical_frame"
_HAND_EYE = Mounting(
    np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.075, 0.0, 0.02]), "link_eef", _OPTICAL
)
"""On the xArm7's flange, beside the gripper and looking along it."""
VGA = Camera(640, 480, 615.0, 615.0, 319.5, 239.5)
"""A D435's colour camera; depth is aligned to it."""
CAMERA_TOPICS = {
    "depth": "camera/aligned_depth_to_color/image_raw",
    "info": "camera/aligned_depth_to_color/camera_info",
    "colour": "camera/color/image_raw",
}
"""What a RealSense driver calls them."""
_UPRIGHT = 0.9999
"""Cosine to the vertical from which on the longest axis of a body has no direction along the table."""
_JOINT_RATE = 50.0
_FRAME_PERIOD = 0.24
"""s; the thesis took 127 images in about 30 s."""


@dataclass(frozen=True, eq=False)
class FakeSweep:
    """What is scanned, and with what.

    Args:
        scene: of bodies on a table.
        point: (3,) m that the camera looks at.
        camera, noise: of the images.
        frames: how many.
        ring: the camera's way.
        seed: of the noise.
    """

    scene: Scene
    point: tuple[float, float, float] = (0.45, 0.0, 0.02)
    camera: Camera = VGA
    noise: StereoNoise = D435
    frames: int = 127
    ring: Ring = field(default_factory=lambda: Ring(distance=0.3, low=0.45, high=1.2, sways=3))
    seed: int = 0


def laid_down(vertices: Array, triangles: NDArray[np.int64], at: tuple[float, float], yaw: float) -> Array:
    """(V, 3) m: a closed mesh on the face of its hull on which it lies lowest, which is stable, on a table at z = 0."""
    corners = vertices[triangles]
    volumes = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    centre = (volumes[:, None] * corners.sum(axis=1)).sum(axis=0) / (4 * volumes.sum())
    faces = ConvexHull(vertices).equations
    down = faces[np.argmin(-(faces[:, :3] @ centre + faces[:, 3])), :3]
    axes = np.linalg.eigh(np.cov(vertices.T))[1]
    along = axes[:, 2] if abs(axes[:, 2] @ down) < _UPRIGHT else axes[:, 1]
    x = along - (along @ down) * down
    x /= np.linalg.norm(x)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    placed = vertices @ (turn @ np.stack([x, np.cross(-down, x), -down])).T
    low, high = placed.min(axis=0), placed.max(axis=0)
    return np.asarray(placed - [*(low + high)[:2] / 2, low[2]] + [*at, 0.0])


def fake_views(sweep: FakeSweep, rotation: Array, translation: Array) -> Iterator[tuple[View, NDArray[np.uint16]]]:
    """Render what the camera sees from each pose, with the depth as it is reported (mm)."""
    rng = np.random.default_rng(sweep.seed)
    for number, (turn, place) in enumerate(zip(rotation, translation, strict=True)):
        seen = render(sweep.scene, sweep.camera, turn, place)
        steps = measured(seen, sweep.camera.fx, sweep.noise, rng)
        depth = depth_in_metres(steps, "16UC1", unit=sweep.noise.step)
        frame = Frame(round(number * _FRAME_PERIOD * 1e9), _OPTICAL, sweep.camera, depth, seen.colours)
        yield View(frame, turn, place), steps


def _arm_path(sweep: FakeSweep, model: RobotModel) -> tuple[Array, WaypointTrajectory]:
    """Joint positions (V, J) at the frames, and the motion through them."""
    point = np.array(sweep.point)
    start = np.array([0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0])
    hand_eye = _HAND_EYE.rotation, _HAND_EYE.translation
    path = plan_sweep(model, _HAND_EYE.parent, hand_eye, point, sweep.ring.places(point, sweep.frames), start)
    times = _FRAME_PERIOD * np.arange(sweep.frames)
    return path, WaypointTrajectory(times, path, np.gradient(path, times, axis=0))


def _camera_at(model: RobotModel, path: Array) -> tuple[Array, Array]:
    rotation, translation = frame_poses(model, path, _HAND_EYE.parent)
    return rotation @ _HAND_EYE.rotation, rotation @ _HAND_EYE.translation + translation


def arm_motion(sweep: FakeSweep, model: RobotModel) -> Callable[[Array], tuple[Array, Array]]:
    """The camera's true poses, (N, 3, 3) and (N, 3) m, at times (N,), s from the first frame on."""
    moving = _arm_path(sweep, model)[1]
    return lambda times: _camera_at(model, moving.at(times).position)


def arm_sweep(
    sweep: FakeSweep, model: RobotModel, joint_noise: float, rng: np.random.Generator
) -> tuple[Array, Array, JointStream]:
    """The camera's true poses at the frames, (V, 3, 3) and (V, 3) m, and what the encoders say all the way."""
    path, moving = _arm_path(sweep, model)
    seconds = np.arange(0.0, _FRAME_PERIOD * (sweep.frames - 1) + 1.5 / _JOINT_RATE, 1 / _JOINT_RATE)
    position = moving.at(seconds).position
    position = position + rng.normal(scale=joint_noise, size=position.shape)
    unknown = np.full_like(position, np.nan)
    states = JointStream(np.round(seconds * 1e9).astype(np.int64), model.joint_names, position, unknown, unknown)
    return *_camera_at(model, path), states


def write_sweep(path: Path, sweep: FakeSweep, metadata: dict[str, dict[str, str]], joint_noise: float = 2e-5) -> None:
    """Sweep with an xArm7 and write the bag: images, camera info, joint states, robot description, tf_static."""
    model = RobotModel.from_file("xarm7", _HAND_EYE.parent)
    description = find_urdf("xarm7").read_text(encoding="utf-8")
    rotation, translation, states = arm_sweep(sweep, model, joint_noise, np.random.default_rng([sweep.seed, 1]))
    mounted = PoseStream(
        np.array([0]), _HAND_EYE.rotation[None], _HAND_EYE.translation[None], _HAND_EYE.parent, _OPTICAL
    )
    messages = [(0, "robot_description", encode_text(description))]
    messages += [(stamp, "tf_static", data) for stamp, data in encode_stream("tf_static", mounted)]
    messages += [(stamp, "joint_states", data) for stamp, data in encode_stream("joint_states", states)]
    for view, steps in fake_views(sweep, rotation, translation):
        stamp = view.frame.stamp
        messages.append((stamp, CAMERA_TOPICS["info"], info_bytes(stamp, _OPTICAL, sweep.camera)))
        messages.append((stamp, CAMERA_TOPICS["depth"], image_bytes(stamp, _OPTICAL, steps, "16UC1")))
        messages.append((stamp, CAMERA_TOPICS["colour"], image_bytes(stamp, _OPTICAL, view.frame.colours, "rgb8")))
    kinds = {"robot_description": "std_msgs/msg/String", "tf_static": "tf2_msgs/msg/TFMessage"}
    kinds |= {"joint_states": "sensor_msgs/msg/JointState", CAMERA_TOPICS["info"]: "sensor_msgs/msg/CameraInfo"}
    kinds |= {CAMERA_TOPICS[name]: "sensor_msgs/msg/Image" for name in ("depth", "colour")}
    with RecordingWriter(path, metadata=metadata) as writer:
        for topic, kind in kinds.items():
            writer.add_topic(topic, kind)
        for stamp, topic, data in sorted(messages, key=lambda message: message[0]):
            writer.write(topic, stamp, data)


def header_of_image(stamp: int, frame: str) -> Any:
    """std_msgs/Header at a stamp, ns."""
    make: Any = typestore().types
    seconds, rest = divmod(stamp, 10**9)
    return make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](seconds, rest), frame)


def image_bytes(stamp: int, frame: str, pixels: NDArray[Any], encoding: str) -> bytes:
    """CDR of sensor_msgs/Image: (H, W) or (H, W, 3) pixels, at a stamp, ns."""
    height, width = pixels.shape[:2]
    data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
    kind = "sensor_msgs/msg/Image"
    message = typestore().types[kind](
        header_of_image(stamp, frame), height, width, encoding, 0, len(data) // height, data
    )
    return bytes(typestore().serialize_cdr(message, kind))


def info_bytes(stamp: int, frame: str, camera: Camera) -> bytes:
    """CDR of sensor_msgs/CameraInfo."""
    kind = "sensor_msgs/msg/CameraInfo"
    k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1])
    p = np.array([camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0])
    whole = typestore().types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    message = typestore().types[kind](
        header_of_image(stamp, frame),
        camera.height,
        camera.width,
        "plumb_bob",
        np.array(camera.distortion or (0.0,) * 5),
        k,
        np.eye(3).ravel(),
        p,
        0,
        0,
        whole,
    )
    return bytes(typestore().serialize_cdr(message, kind))
