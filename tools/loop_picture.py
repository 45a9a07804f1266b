"""A strip of frames of a loop, from its bag: `poise loop --out DIR`, then `python tools/loop_picture.py DIR`."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import coal
import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from poise.assembly import Box, Cylinder, Mesh, RigidObject, load_scene
from poise.fake_robots.rasteriser import NOTHING, Body, Scene, look_at, render
from poise.fake_robots.tables import TOP
from poise.geometry import Pose
from poise.manipulation import Arm
from poise.nodes.transforms import pose_of_transform
from poise.recording import open_recording
from poise.recording.streams import stamp_of
from poise.scanning import Camera
from poise.types import Array

TARGET = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "loop.png"
CAMERA = Camera(480, 400, 560.0, 560.0, 240.0, 200.0)
LOOKS_FROM, LOOKS_AT = np.array([1.75, -1.25, 1.35]), np.array([0.3, -0.12, 0.6])
"""m, in the frame of the base, which the camera follows."""
FRAMES = (
    ("scan", 0, 0.6),
    ("pick", 0, 0.8),
    ("weigh", 0, 0.5),
    ("place", 1, 0.97),
    ("place", -1, 0.97),
    ("carry", 0, 0.5),
)
"""Step, which of its kind, and the share of its time."""
STEEL, PLATE, DARK = (0.78, 0.8, 0.83), (0.62, 0.56, 0.48), (0.25, 0.26, 0.3)
COLOURS = (0.85, 0.35, 0.25), (0.25, 0.55, 0.8), (0.95, 0.72, 0.25), (0.4, 0.68, 0.4), (0.6, 0.45, 0.75)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="--out of poise loop")
    parser.add_argument("--output", type=Path, default=TARGET)
    options = parser.parse_args()
    folder: Path = options.folder
    steps = json.loads((folder / "loop.json").read_text())["steps"]
    bag = folder / "loop.mcap"
    joints, truth = open_recording(bag).joint_states(), true_poses(bag)
    ends = np.cumsum([step["seconds"] for step in steps])
    names = [step["step"] for step in steps]
    arm, objects = Arm.load("fr3"), load_scene(folder / "truth.yaml").objects
    figure, axes = plt.subplots(1, len(FRAMES), figsize=(15, 2.75))
    for axis, (name, which, share) in zip(axes, FRAMES, strict=True):
        number = [index for index, each in enumerate(names) if each == name][which]
        seconds = float(ends[number] - (1 - share) * steps[number]["seconds"])
        row = int(np.searchsorted(joints.stamps, joints.stamps[0] + seconds * 1e9))
        poses = next((each for stamp, each in truth if stamp >= joints.stamps[row]), truth[-1][1])
        position = dict(zip(joints.names, joints.position[row].tolist(), strict=True))
        axis.imshow(picture(arm, objects, position, poses))
        axis.set_title(f"{name}, {seconds:.0f} s", fontsize=11)
        axis.axis("off")
    figure.subplots_adjust(0.0, 0.0, 1.0, 0.9, 0.01)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output, dpi=100, metadata={"Software": None}, pil_kwargs={"optimize": True})
    print(f"{options.output}: {options.output.stat().st_size // 1024} KiB")


def true_poses(bag: Path) -> list[tuple[int, dict[str, Pose]]]:
    """Stamps, ns, and the poses of the true objects."""
    with bag.open("rb") as stream:
        raw = [message.data for _, _, message in make_reader(stream).iter_messages(["/world_truth"])]
    found = [deserialize_message(data, TFMessage).transforms for data in raw]
    return [
        (stamp_of(items[0]), {each.child_frame_id: pose_of_transform(each.transform) for each in items})
        for items in found
    ]


def picture(arm: Arm, objects: Sequence[RigidObject], known: dict[str, float], poses: dict[str, Pose]) -> Array:
    """(H, W, 3) uint8: the arm at joint positions, the table, the tray and the objects."""
    driven = np.array([known.get("base_x", 0.0), known.get("base_y", 0.0), 0.0])
    arm = replace(arm, base=pin.SE3(np.eye(3), np.array([driven[0], driven[1], TOP])))
    q = np.array([known[name] for name in arm.model.names[1:]])
    opening = 0.085 * (1.0 - known.get("finger_joint", 0.0) / 0.8)
    shapes = arm.shapes(q, opening)
    bodies = [_body(_shape(shape), place, DARK if k > 8 else STEEL) for k, (shape, place) in enumerate(shapes)]
    loose = 0
    for item in objects:
        pose = poses.get(item.id, item.pose)
        colour = PLATE if item.fixed else COLOURS[loose % len(COLOURS)]
        loose += not item.fixed
        bodies.append(_body(item.shape, pin.SE3(pose.rotation, pose.translation), colour))
    scene = Scene(tuple(bodies), 0.0, tuple(driven[:2]), (1.2, 1.2), (0.93, 0.93, 0.92))
    seen = render(scene, CAMERA, look_at(LOOKS_FROM, LOOKS_AT), LOOKS_FROM + driven)
    return np.where((seen.shown == NOTHING)[..., None], np.uint8(250), seen.colours)


def _shape(geometry: coal.CollisionGeometry) -> Box | Cylinder:
    if isinstance(geometry, coal.Box):
        return Box(tuple(2.0 * geometry.halfSide))
    return Cylinder(geometry.radius, 2.0 * geometry.halfLength)


def _body(shape: Box | Cylinder | Mesh, place: pin.SE3, colour: tuple[float, float, float]) -> Body:
    vertices = shape.polyhedron.vertices @ place.rotation.T + place.translation
    triangles = vertices[shape.polyhedron.triangles]
    return Body(triangles, np.tile(colour, (len(triangles), 1)))


if __name__ == "__main__":
    main()
