"""How well `poise calibrate` finds a camera on a hand, in two worlds, beside OpenCV's calibrateHandEye.

`python -m benchmarks.calibration [--quick]`. Points: corners are projected, with noise, distortion, outliers, late
images, a board that slips or has another size. Rendered: the software camera of fake_robots sees a ChArUco board, and
OpenCV finds it. OpenCV (4.x for its calibrateHandEye) is needed for the rivals and for the rendered world.
"""

import argparse
import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from poise.calibration import Board, LinkKinematics, Sighting, calibrate
from poise.calibration.sightings import board_pose
from poise.errors import PoiseError
from poise.fake_robots.rasteriser import Body, Scene, render
from poise.geometry import Pose
from poise.robot import RobotModel
from poise.scanning import Camera
from poise.simulation import home
from poise.types import Array

LINK = "ft_sensor"
BOARD = Board()
_TRIES = 3000
"""Random places of the arm, most of which do not show the board."""
_RIVALS = ("TSAI", "PARK", "DANIILIDIS")


@dataclass(frozen=True)
class World:
    """What is wrong in a world.

    Args:
        views: of the board. noise: pixels of a corner. encoder: rad, one sigma of each joint in each view.
        offset: rad, one sigma of the joints' zeros. delay: s. speed: rad/s, one sigma, of the joints at the images.
        slip: m, of the board after half of the views. outliers: share of the corners that are somewhere else.
        size: of the board through the stated one. distortion: of the lens. late: number of images 0.3 s late.
        turn: rad that joints go to either side.
    """

    views: int = 25
    noise: float = 0.2
    encoder: float = 1e-4
    offset: float = 0.0
    delay: float = 0.0
    speed: float = 0.0
    slip: float = 0.0
    outliers: float = 0.0
    size: float = 1.0
    distortion: tuple[float, ...] = (0.08, -0.15, 0.001, -0.001)
    late: int = 0
    turn: float = 0.35


WORLDS = {
    "plain": World(),
    "12 views": World(views=12),
    "encoders 0.3 mrad": World(encoder=3e-4),
    "joint zeros 4 mrad": World(offset=4e-3),
    "images 30 ms late": World(delay=0.03, speed=0.15),
    "2 images 0.3 s late": World(late=2, speed=0.3),
    "8 % outliers": World(outliers=0.08),
    "board slips 1 mm": World(slip=1e-3),
    "board 2 % larger": World(size=1.02),
    "hand only moves along": World(turn=0.02),
}


@dataclass(frozen=True, eq=False)
class Views:
    """A world as the camera saw it; `eye` is the truth in the convention of the answer, `offsets` are the joints'."""

    kinematics: LinkKinematics
    camera: Camera
    sightings: list[Sighting]
    eye: Pose
    offsets: Array


def corners_of(board: Board) -> Array:
    """(N, 2) m, as OpenCV numbers them."""
    grid = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
    return np.stack(grid, axis=-1).reshape(-1, 2) * board.square


def views_of(world: World, seed: int, look: Callable[[Camera, Pose, Array], Array | None] | None = None) -> Views:
    """Random places of the camera before a board, as corners.

    Args:
        world: what is wrong.
        seed: of all that is random.
        look: pixels (N, 2) of corners (NaN: not seen) of a board at a pose in the camera; None: they are projected.
    """
    rng = np.random.default_rng(seed)
    model = RobotModel.from_file("fr3", LINK)
    kinematics, joints = LinkKinematics(model, LINK), len(model.joint_names)
    camera = Camera(640, 480, 615.0, 615.0, 320.0, 240.0, world.distortion if look is None else ())
    turn = Rotation.from_rotvec(np.array([0, 0, np.pi / 2]) + rng.normal(0, 0.1, 3)).as_matrix()
    eye = Pose(turn, np.array([0.075, 0, -0.0175]) + rng.normal(0, 0.02, 3))
    offsets = rng.normal(0, world.offset, joints)
    start, corners = np.array(home(model)), corners_of(BOARD)
    flat = np.column_stack([corners - corners.mean(axis=0), np.zeros(len(corners))]) * world.size
    tilt = Rotation.from_rotvec(rng.normal(0, 0.15, 3))
    before = Pose(tilt.as_matrix(), np.array([0, 0, 0.4]) + rng.normal(0, 0.02, 3))
    board = _link(kinematics, start + offsets) @ eye @ before
    sightings: list[Sighting] = []
    for _ in range(_TRIES):
        if len(sightings) == world.views:
            break
        q, speed = start + rng.uniform(-world.turn, world.turn, joints), rng.normal(0, world.speed, joints)
        slipped = world.slip if len(sightings) >= world.views // 2 else 0.0
        now = Pose(board.rotation, board.translation + slipped * board.rotation[:, 0])
        seen = (_link(kinematics, q + offsets) @ eye).inverse @ now
        if abs(seen.rotation[2, 2]) < 0.6 or not 0.2 < seen.translation[2] < 0.7:
            continue
        pixels = np.stack(camera.project(seen.apply(flat)), axis=1)
        if pixels.min() < 5 or np.any(pixels > [635, 475]):
            continue
        if look is not None:
            found = look(camera, seen, flat)
            if found is None:
                continue
            pixels = found
        else:
            pixels = pixels + rng.normal(0, world.noise, pixels.shape)
            wild = rng.random(len(pixels)) < world.outliers
            pixels[wild] += rng.normal(0, 20, (int(wild.sum()), 2))
        kept = (rng.random(len(pixels)) > 0.1) & np.isfinite(pixels).all(axis=1)
        late = world.delay + (0.3 if len(sightings) % 7 == 3 and len(sightings) < 7 * world.late else 0.0)
        measured = q + rng.normal(0, world.encoder, joints) + speed * late
        sightings.append(Sighting(len(sightings) * 10**9, measured, speed, corners[kept], pixels[kept]))
    zero, last = np.zeros(joints), np.zeros(joints)
    last[-1] = offsets[-1]  # the offset of the last joint is part of the hand-eye transform
    moved = _link(kinematics, zero).inverse @ _link(kinematics, last) @ eye
    return Views(kinematics, camera, sightings, moved, offsets)


def _link(kinematics: LinkKinematics, q: Array) -> Pose:
    found = kinematics.poses(q[None])
    return Pose(found.rotation[0], found.translation[0])


def errors_of(truth: Pose, found: Pose) -> Array:
    """(6,) rad and m."""
    turn = Rotation.from_matrix(found.rotation @ truth.rotation.T).as_rotvec()
    return np.concatenate([turn, found.translation - truth.translation])


def rival(views: Views, method: str) -> Pose:
    """OpenCV's closed form, from the pose of the board in each view."""
    cv2: Any = importlib.import_module("cv2")
    links = views.kinematics.poses(np.array([each.position for each in views.sightings]))
    boards = [board_pose(each, views.camera)[0] for each in views.sightings]
    rotation, translation = cv2.calibrateHandEye(
        list(links.rotation),
        list(links.translation),
        [each.rotation for each in boards],
        [each.translation for each in boards],
        method=getattr(cv2, f"CALIB_HAND_EYE_{method}"),
    )
    return Pose(rotation, translation.ravel())


def rendered(board: Board) -> Callable[[Camera, Pose, Array], Array | None]:
    """Looks at a board with the software camera, and finds it with OpenCV."""
    cv2: Any = importlib.import_module("cv2")
    cells = 40
    _, drawn = board._board()
    image = drawn.generateImage((cells * board.columns, cells * board.rows)) < 128
    size, middle = board.square / cells, np.array([board.columns, board.rows]) * board.square / 2
    rows = [_run(image[y], x, y) for y in range(len(image)) for x in range(image.shape[1]) if _begins(image[y], x)]
    quads = np.array(rows, dtype=np.float64) * size - np.tile(middle, 4).reshape(4, 2)
    detect = board.detector()

    def look(camera: Camera, pose: Pose, flat: Array) -> Array | None:
        fine = Camera(1280, 960, 2 * camera.fx, 2 * camera.fy, 2 * camera.cx + 0.5, 2 * camera.cy + 0.5)
        paper = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (middle + 0.01)
        shapes = [(paper[None], 0.0, 0.95), (quads, 2e-5, 0.05)]
        bodies = [_body(corners, -height, shade, pose) for corners, height, shade in shapes]
        shown = render(Scene(tuple(bodies), table=None), fine, np.eye(3), np.zeros(3)).colours.astype(np.float64)
        small = shown.reshape(480, 2, 640, 2, 3).mean(axis=(1, 3)).round().astype(np.uint8)
        corners, pixels = detect(small)
        if len(corners) < 12:
            return None
        out = np.full((len(flat), 2), np.nan)
        places = corners_of(board)
        for corner, pixel in zip(corners, pixels, strict=True):
            out[int(np.argmin(np.linalg.norm(places - corner, axis=1)))] = pixel
        return out

    del cv2
    return look


def _begins(row: Array, x: int) -> bool:
    return bool(row[x] and (x == 0 or not row[x - 1]))


def _run(row: Array, x: int, y: int) -> list[list[float]]:
    """Corners of a run of black pixels."""
    end = x + int(np.argmin(np.append(row[x:], False)))
    return [[x, y], [end, y], [end, y + 1], [x, y + 1]]


def _body(quads: Array, height: float, shade: float, pose: Pose) -> Body:
    flat = np.concatenate([quads, np.full((*quads.shape[:2], 1), height)], axis=2)
    corners = pose.apply(flat.reshape(-1, 3)).reshape(flat.shape)
    triangles = np.concatenate([corners[:, [0, 2, 1]], corners[:, [0, 3, 2]]])
    return Body(triangles, np.full((len(triangles), 3), shade))


def report(name: str, worlds: list[Views], seeds: int, methods: tuple[str, ...]) -> str:
    """One row of the table."""
    off, z, codes, zeros, seconds = list[Array](), list[Array](), dict[str, int](), list[Array](), list[float]()
    for views in worlds:
        begun = time.process_time()
        try:
            found = calibrate(views.kinematics, LINK, views.camera, views.sightings)
        except PoiseError as error:
            codes[error.code.name] = codes.get(error.code.name, 0) + 1
            continue
        seconds.append(time.process_time() - begun)
        error = errors_of(views.eye, found.parameters.eye)
        off.append(error)
        z.append(error / found.eye_sigma)
        sigma = np.sqrt(np.diag(found.covariance))[12 : 12 + len(views.offsets)]
        zeros.append(
            ((found.parameters.offsets - views.offsets) / np.where(sigma > 0, sigma, np.nan))[found.identified]
        )
    cells = [name, _size(off), *(_size([errors_of(v.eye, rival(v, each)) for v in worlds]) for each in methods)]
    inside = f"{np.mean(np.abs(z) < 1.96):.3f}" if z else "-"
    beyond = f"{int(np.sum(np.abs(z) > 3))} of {np.size(z)}" if z else "-"
    joints = np.concatenate(zeros) if zeros else np.zeros(0)
    inner = f"{np.mean(np.abs(joints) < 1.96):.3f}" if len(joints) else "-"
    refused = ", ".join(f"{count} {code}" for code, count in codes.items()) or "none"
    cells += [inside, beyond, inner, f"{refused} of {seeds}", f"{np.median(seconds):.2f}" if seconds else "-"]
    return "| " + " | ".join(cells) + " |"


def _size(errors: list[Array]) -> str:
    if not errors:
        return "-"
    place = 1e3 * np.median([np.linalg.norm(each[3:]) for each in errors])
    turn = np.degrees(np.median([np.linalg.norm(each[:3]) for each in errors]))
    return f"{place:.2f}, {turn:.3f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two seeds, and three worlds")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000, help="the first seed")
    options = parser.parse_args()
    count = 2 if options.quick else options.seeds
    seeds = range(options.first, options.first + count)
    try:
        methods = _RIVALS if hasattr(importlib.import_module("cv2"), "calibrateHandEye") else ()
        vision = True
    except ImportError:
        methods, vision = (), False
    titles = ["world", "poise: mm, deg", *(f"{each.title()}: mm, deg" for each in methods)]
    titles += ["in 1.96 sigma", "beyond 3 sigma", "offsets in 1.96 sigma", "refused", "CPU, s"]
    print("| " + " | ".join(titles) + " |\n" + "| --- " * len(titles) + "|")
    for name, world in list(WORLDS.items())[: 3 if options.quick else None]:
        print(report(name, [views_of(world, seed) for seed in seeds], count, methods), flush=True)
    if vision:
        look, few = rendered(BOARD), max(count // 4, 1)
        print(report("rendered", [views_of(World(views=20), seed, look) for seed in seeds[:few]], few, methods))


if __name__ == "__main__":
    main()
