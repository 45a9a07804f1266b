"""Sweeps of a stereo camera around objects of PyBullet, from a bag to a volume, as a user would do it.

python -m benchmarks.stereo_sweeps [--count N] [--first SEED] [--keep FOLDER]

Objects, their settling, images and errors of depth come from `stereo_world` and `stereo_camera`, which use no code of
Poise. Views, encodings and errors of poses take turns, so that each seed is another recording.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from benchmarks.stereo_camera import Shot, shoot
from benchmarks.stereo_world import CAMERA, World, draw_paint, draw_shape
from poise.cli import app
from poise.fake_robots.compressing import compressed_bytes, depth_png, depth_rvl, picture_bytes
from poise.fake_robots.sweep_bag import image_bytes, info_bytes
from poise.recording import COMPRESSED, IMAGE, INFO, PoseStream, RecordingWriter, encode_stream
from poise.types import Array

VIEWS = (12, 24, 8, 40, 16, 6)
"""Of a sweep; they take turns."""
ENCODINGS = ("16UC1", "32FC1", "png", "rvl", "tenths")
POSES = ((0.0, 0.0), (3e-4, 0.05), (8e-4, 0.15))
"""m and degrees, one sigma along each axis, by which the pose of each view is off."""
TABLE_TOP = 0.7
"""m over the world."""
_PERIOD = 200_000_000
"""ns between views."""
_NEAR = 0.15
_FRAME = "camera_depth_optical_frame"
console = Console(width=150)


@dataclass(frozen=True)
class Answer:
    """What became of one recording.

    Args:
        name: the seed, the object and the case.
        volume, std: over the true one; NaN where it was refused.
        hollow: the least volume if it is hollow, over the true one; NaN where none is stated.
        parts: how many.
        seconds: of the scan, and of the solid and the parts.
        notes: of both, or the refusal.
    """

    name: str
    volume: float
    std: float
    hollow: float
    parts: int
    seconds: tuple[float, float]
    notes: tuple[str, ...]

    @property
    def missed(self) -> bool:
        """The truth is beyond 2 sigma."""
        return abs(self.volume - 1) > 2 * self.std

    def __str__(self) -> str:
        hollow = f", {self.hollow:.2f} if hollow" if np.isfinite(self.hollow) else ""
        if not np.isfinite(self.volume):
            return f"{self.name}: {' '.join(self.notes)}"
        mark = " MISSED" if self.missed else " far" if abs(self.volume - 1) > _NEAR else ""
        said = "".join(f"\n    {note}" for note in self.notes)
        return (
            f"{self.name}: {self.volume:.3f} ± {self.std:.3f}{hollow}, {self.parts} parts,"
            f" {self.seconds[0]:.2f} + {self.seconds[1]:.2f} s{mark}{said}"
        )


def way(count: int, size: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """(V, 3, 3) and (V, 3) m of a camera that a hand carries around the object once, at one height or two.

    Args:
        count: of the views.
        size: m of the object.
        rng: draws the heights and how the hand trembles.
    """
    low, high = np.radians(rng.uniform(15, 35)), np.radians(rng.uniform(40, 65))
    if count <= 8:
        low = high = (low + high) / 2
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False) + rng.uniform(0, 2 * np.pi)
    height = np.where(np.arange(count) % 2 == 0, low, high) + rng.normal(scale=0.05, size=count)
    distance = rng.uniform(0.24, 0.34) + 0.7 * size + rng.normal(scale=0.01, size=count)
    angle += rng.normal(scale=0.05, size=count)
    flat = np.cos(height)
    place = distance[:, None] * np.column_stack([flat * np.cos(angle), flat * np.sin(angle), np.sin(height)])
    aim = np.array([0.0, 0.0, 0.3 * size]) + rng.normal(scale=0.01, size=(count, 3))
    z = (aim - place) / np.linalg.norm(aim - place, axis=1, keepdims=True)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    roll = Rotation.from_rotvec(rng.normal(scale=0.1, size=(count, 1)) * z)
    x = roll.apply(x)
    return np.stack([x, np.cross(z, x), z], axis=-1), place


def record(seed: int, path: Path) -> dict[str, Any]:
    """Write the bag of a seed, and return what is true of it."""
    rng = np.random.default_rng([seed, 435])
    made, paint = draw_shape(seed, rng), draw_paint(rng)
    count, how = VIEWS[seed % len(VIEWS)], ENCODINGS[seed % len(ENCODINGS)]
    off = POSES[seed // 2 % len(POSES)]
    world = World(made, paint, rng)
    size = float(np.ptp(world.vertices, axis=0).max())
    rotation, translation = way(count, size, rng)
    try:
        shots = [shoot(world, turn, place, rng) for turn, place in zip(rotation, translation, strict=True)]
    finally:
        world.close()
    tremble = Rotation.from_rotvec(rng.normal(scale=np.radians(off[1]), size=(count, 3)))
    said = (Rotation.from_matrix(rotation) * tremble).as_matrix()
    place = translation + np.array([0.0, 0.0, TABLE_TOP]) + rng.normal(scale=off[0], size=(count, 3))
    stamps = _PERIOD * np.arange(count, dtype=np.int64)
    _write(path, PoseStream(stamps, said, place, "world", _FRAME), shots, how, jpeg=seed % 2 == 1)
    case = f"{count} views, {how}, poses {1e3 * off[0]:.1f} mm {off[1]:.2f} deg, {100 * size:.0f} cm"
    kind = f"albedo {paint.albedo[0]:.2f} {paint.albedo[1]:.2f}, gloss {paint.gloss}"
    return {"name": f"{seed} {made.name} ({case}; {kind})", "volume": world.volume, "how": how}


def _write(path: Path, poses: PoseStream, shots: list[Shot], how: str, jpeg: bool) -> None:
    """The bag: tf, depth with its camera_info, and colours."""
    info, depth, colour = "camera/depth/camera_info", "camera/depth/image_rect_raw", "camera/infra/image_rect"
    messages = [(stamp, "tf", data) for stamp, data in encode_stream("tf", poses)]
    for stamp, shot in zip(poses.stamps.tolist(), shots, strict=True):
        if jpeg:
            data = compressed_bytes(stamp, _FRAME, "rgb8; jpeg compressed bgr8", picture_bytes(shot.colours, "JPEG"))
        else:
            data = image_bytes(stamp, _FRAME, shot.colours, "rgb8")
        messages.append((stamp, info, info_bytes(stamp, _FRAME, CAMERA)))
        messages.append((stamp, depth, _depth_bytes(stamp, shot.depth, how)))
        messages.append((stamp, colour, data))
    kinds = {"tf": "tf2_msgs/msg/TFMessage", info: INFO, colour: COMPRESSED if jpeg else IMAGE}
    kinds[depth] = COMPRESSED if how in ("png", "rvl") else IMAGE
    with RecordingWriter(path) as writer:
        for topic, kind in kinds.items():
            writer.add_topic(topic, kind)
        for stamp, topic, data in sorted(messages, key=lambda message: message[0]):
            writer.write(topic, stamp, data)


def _depth_bytes(stamp: int, depth: Array, how: str) -> bytes:
    steps = np.round(1e4 * depth if how == "tenths" else 1e3 * depth).astype(np.uint16)
    if how == "png":
        return compressed_bytes(stamp, _FRAME, "16UC1; compressedDepth png", depth_png(steps))
    if how == "rvl":
        return compressed_bytes(stamp, _FRAME, "16UC1; compressedDepth rvl", depth_rvl(steps))
    if how == "32FC1":
        return image_bytes(stamp, _FRAME, np.where(depth > 0, depth, np.nan).astype(np.float32), how)
    return image_bytes(stamp, _FRAME, steps, "16UC1")


def answer(path: Path, truth: dict[str, Any]) -> Answer:
    """Of `poise scan`."""
    where = path.with_suffix(".json")
    where.unlink(missing_ok=True)
    options = ["--depth-unit", "0.0001"] if truth["how"] == "tenths" else []
    start = time.process_time()
    result = CliRunner().invoke(app, ["scan", str(path), "--json", str(where), *options])
    if result.exit_code or not where.exists():
        lines = (f"refused: {result.exception or ' '.join(result.output.split())}",)
        return Answer(truth["name"], np.nan, np.nan, np.nan, 0, (time.process_time() - start, 0.0), lines)
    found = json.loads(where.read_text(encoding="utf-8"))
    volume, std, hollow = (found[key] for key in ("volume", "volume_std", "volume_if_hollow"))
    return Answer(
        truth["name"],
        volume / truth["volume"],
        std / truth["volume"],
        np.nan if hollow is None else hollow / truth["volume"],
        found["n_parts"],
        (found["scan_seconds"], found["seconds"] - found["scan_seconds"]),
        tuple(found["notes"]),
    )


def answers(seeds: range, folder: Path) -> Iterator[Answer]:
    """Of each seed; bags stay in the folder for the next time."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        path, about = folder / f"{seed}.mcap", folder / f"{seed}.truth.json"
        if not about.exists():
            about.write_text(json.dumps(record(seed, path)), encoding="utf-8")
        yield answer(path, json.loads(about.read_text(encoding="utf-8")))


def table(rows: list[Answer]) -> Table:
    """One row."""
    made = Table(title="objects of PyBullet, seen by a stereo camera; volume over the truth")
    good = [row for row in rows if np.isfinite(row.volume)]
    ratio = np.array([row.volume for row in good])
    cells = {
        "recordings": f"{len(rows)}",
        "refused": f"{len(rows) - len(good)}",
        "off, middle %": f"{100 * np.median(np.abs(ratio - 1)):.1f}",
        "bias %": f"{100 * (np.median(ratio) - 1):+.1f}",
        "within 15 %": f"{int((np.abs(ratio - 1) < _NEAR).sum())} of {len(rows)}",
        "stated +- %": f"{100 * np.median([row.std for row in good]):.1f}",
        "beyond 2 sigma": f"{sum(row.missed for row in good)} of {len(good)}",
        "nor in the range if hollow": f"{sum(row.missed and not row.hollow <= 1 for row in good)}",
        "one to three parts": f"{sum(row.parts <= 3 for row in good)}",
        "scan, s": f"{np.median([row.seconds[0] for row in good]):.2f}",
        "solid and parts, s": f"{np.median([row.seconds[1] for row in good]):.2f}",
    }
    for heading in cells:
        made.add_column(heading, justify="right")
    made.add_row(*cells.values())
    return made


def main() -> None:
    """Print each answer, and the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=24, help="recordings")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--keep", type=Path, default=Path("stereo_sweeps"), help="folder of the bags")
    options = parser.parse_args()
    rows = []
    for row in answers(range(options.first, options.first + options.count), options.keep):
        rows.append(row)
        console.print(str(row), soft_wrap=True, highlight=False)
    console.print(table(rows))


if __name__ == "__main__":
    main()
