"""Random things on a table, and what two depth cameras make of them: one as the tool models a D435, and a worse one."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from manifold3d import Manifold, Mesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, minimum_filter

from benchmarks.closed_shapes import ClosedShape, of_manifold, pieces, turned
from benchmarks.segmentation_truth import load_clouds
from poise.fake_robots.depth_noise import D435, measured
from poise.fake_robots.rasteriser import Body, Rendering, Scene, render
from poise.fake_robots.sweep_bag import VGA, FakeSweep, arm_sweep, laid_down
from poise.robot import RobotModel
from poise.scanning import Frame, View, depth_in_metres
from poise.types import Array

FIRST_FINAL_SEED = 1000
"""Seeds from here on are answered once, by a state that is committed; the next ones are in docs/scan_results.md."""
CAMERAS = ("d435", "worse")
SPOT = (0.45, 0.0)
_LONGEST = 0.2
"""m: what is longer is scaled down, so that the sweep sees it whole."""
PERIOD = 240_000_000
"""ns between frames."""
_COLOURS = np.array(
    [[0.55, 0.55, 0.58], [0.80, 0.65, 0.25], [0.60, 0.40, 0.20], [0.80, 0.12, 0.10], [0.10, 0.20, 0.75]]
)


@dataclass(frozen=True, eq=False)
class Thing:
    """A closed body on the table.

    Args:
        name: its kind and seed.
        corners: (T, 3, 3) m, in the world.
        colours: (T, 3) 0..1.
        volume: m3.
        glossy: (G, 4) x y z and radius, m, of balls in which the surface is glossy.
    """

    name: str
    corners: Array
    colours: Array
    volume: float
    glossy: Array


# ---- kinds: a closed body, and whether it stands as it was made ----


def composite(rng: np.random.Generator) -> Manifold:
    """Two to four boxes, cylinders and spheres that overlap."""
    body = Manifold()
    for _ in range(int(rng.integers(2, 5))):
        a, b, c = rng.uniform(0.018, 0.06, 3).tolist()
        kind = rng.integers(3)
        one = (
            Manifold.cube((a, b, c), True)
            if kind == 0
            else Manifold.cylinder(1.4 * a, b / 2, b / 2 * rng.uniform(0.5, 1.0), 48, True)
            if kind == 1
            else Manifold.sphere(a / 2, 48)
        )
        one = one.rotate(tuple(rng.uniform(0, 360, 3).tolist()))
        if not body.is_empty():
            low, high = np.reshape(body.bounding_box(), (2, 3))
            middle = low + rng.uniform(0.2, 0.8, 3) * (high - low)
            surface = np.asarray(body.to_mesh().vert_properties[:, :3])
            one = one.translate(tuple(surface[np.argmin(np.linalg.norm(surface - middle, axis=1))].tolist()))
        body = body + one
    return max(body.decompose(), key=lambda piece: piece.volume())


def l_shape(rng: np.random.Generator) -> Manifold:
    """Two bars at a right angle."""
    a, b = rng.uniform(0.05, 0.12, 2)
    wide, thick = rng.uniform(0.015, 0.05), rng.uniform(0.008, 0.025)
    return Manifold.cube((a, wide, thick)) + Manifold.cube((thick, wide, b))


def hollow(rng: np.random.Generator) -> Manifold:
    """A box or bowl that is open above."""
    wall, height = rng.uniform(0.003, 0.007), rng.uniform(0.03, 0.08)
    if rng.random() < 0.5:
        a, b = rng.uniform(0.05, 0.1, 2)
        inner = Manifold.cube((a - 2 * wall, b - 2 * wall, height)).translate((wall, wall, wall))
        return Manifold.cube((a, b, height)) - inner
    low, high = rng.uniform(0.02, 0.035), rng.uniform(0.035, 0.055)
    inner = Manifold.cylinder(height, low - wall, high - wall, 72).translate((0, 0, wall))
    return Manifold.cylinder(height, low, high, 72) - inner


def thin(rng: np.random.Generator) -> Manifold:
    """A plate of 1.5 to 5 mm, with a hole or an arm, or a rod."""
    length, wide = rng.uniform(0.07, 0.16), rng.uniform(0.02, 0.06)
    if rng.random() < 0.3:
        return Manifold.cylinder(length, *rng.uniform(0.003, 0.005, 2), 32).rotate((0, 90, 0))
    thick = rng.uniform(0.0015, 0.005)
    plate = Manifold.cube((length, wide, thick), True)
    if rng.random() < 0.5:
        return plate - Manifold.cylinder(0.05, wide / 4, wide / 4, 32, True).translate((length / 4, 0, 0))
    return plate + Manifold.cube((wide / 2, 2.5 * wide, thick), True).translate((length / 2, 0, 0))


def _mug(rng: np.random.Generator) -> Manifold:
    return _body(turned(8 * int(rng.integers(1 << 20)) + 1))  # the second of its kinds


def _put_together(rng: np.random.Generator) -> Manifold:
    return _body(pieces(int(rng.integers(1 << 20))))


def _turned(rng: np.random.Generator) -> Manifold:
    return _body(turned(8 * int(rng.integers(1 << 20)) + int(rng.choice([0, 2, 3, 4, 5, 6, 7]))))


def _body(shape: ClosedShape) -> Manifold:
    return Manifold(Mesh(shape.vertices.astype(np.float32), shape.triangles.astype(np.uint32)))


_KINDS: tuple[tuple[str, Callable[[np.random.Generator], Manifold] | None, bool], ...] = (
    ("composite", composite, False),
    ("L-shape", l_shape, False),
    ("mug", _mug, True),
    ("tool", None, False),
    ("thin", thin, False),
    ("pieces", _put_together, False),
    ("hollow", hollow, True),
    ("composite", composite, False),
    ("tool", None, False),
    ("turned", _turned, False),
)


def thing(seed: int) -> Thing:
    """The object of a seed, as it lies on the table; kinds take turns."""
    rng = np.random.default_rng([seed, 18])
    name, make, stands = _KINDS[seed % len(_KINDS)]
    if make is None:
        tools = sorted(load_clouds(), key=lambda tool: tool.name)
        tool = tools[int(rng.integers(len(tools)))]
        name, vertices, triangles, volume = f"tool {tool.name}", tool.vertices, tool.triangles, tool.volume
    else:
        shape = of_manifold(name, make(rng))
        while not len(shape.triangles):  # a blob may be empty
            shape = of_manifold(name, make(rng))
        vertices, triangles, volume = shape.vertices, shape.triangles, shape.volume
    scale = min(1.0, _LONGEST / float(np.ptp(vertices, axis=0).max()))
    vertices, yaw = scale * vertices, float(rng.uniform(0, 2 * np.pi))
    if stands and rng.random() < 2 / 3:
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        placed = vertices @ turn.T
        low, high = placed.min(axis=0), placed.max(axis=0)
        placed = placed - [*(low + high)[:2] / 2, low[2]] + [*SPOT, 0.0]
    elif stands:  # on its side, open towards where the camera looks from
        placed = laid_down(vertices @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]).T, triangles, SPOT, yaw)
    else:
        placed = laid_down(vertices, triangles, SPOT, yaw)
    corners = placed[triangles]
    middle = corners.mean(axis=1)
    shades = _COLOURS[rng.choice(len(_COLOURS), 2, replace=False)]
    other = (middle[:, 0] > np.median(middle[:, 0])) & (rng.random() < 0.4)
    glossy = np.column_stack([middle[rng.integers(len(middle), size=2)], rng.uniform(0.015, 0.035, 2)])
    return Thing(f"{name} {seed}", corners, shades[other.astype(int)], scale**3 * volume, glossy)


# ---- cameras ----


def _worse(seen: Rendering, at: Array, glossy: Array, bias: float, rng: np.random.Generator) -> NDArray[np.uint16]:
    """(H, W) mm: what `depth_noise` does not model, added to what it does.

    Foreground grows over its edges by 1 to 2 pixels (the window of block matching), disparity errors are alike over
    several pixels and come in steps of 1/16 pixel, depth is off by a share, and glossy places give none where they
    mirror the projector, and in spots elsewhere.

    Args:
        seen: the exact image.
        at: (H, W, 3) m, in the world, of what its pixels show.
        glossy: as of `Thing`.
        bias: share by which depth is too large.
        rng: draws the rest.
    """
    shape = seen.depth.shape
    far = np.where(seen.depth > 0, seen.depth, np.inf)
    wide = gaussian_filter(rng.normal(size=shape), 12.0) > 0
    near = np.where(wide, minimum_filter(far, 5), minimum_filter(far, 3))
    with np.errstate(invalid="ignore"):  # of nothing beside nothing
        depth = np.where(far - near > D435.edge, near, far)
    blurred = replace(seen, depth=np.where(np.isfinite(depth), depth, 0.0))
    scale = VGA.fx * D435.baseline
    smooth = gaussian_filter(rng.normal(size=shape), 2.5)
    disparity = np.divide(scale, blurred.depth, out=np.zeros(shape), where=blurred.depth > 0)
    disparity = np.round((disparity + 0.08 * smooth / smooth.std()) * 16) / 16
    off = np.divide(scale, disparity, out=np.zeros(shape), where=disparity > 0)
    shiny = np.zeros(shape, bool)
    for x, y, z, radius in glossy:
        shiny |= np.linalg.norm(at - [x, y, z], axis=2) < radius
    spots = gaussian_filter(rng.normal(size=shape), 4.0)
    blind = shiny & ((seen.facing > 0.9) | (spots > 0.7 * spots.std()))
    return measured(replace(blurred, depth=(1 + bias) * off), VGA.fx, replace(D435, flying=0.4), rng, blind)


@cache
def _poses(frames: int) -> tuple[Array, Array]:
    """(V, 3, 3) and (V, 3) m: the camera's, on an xArm7."""
    sweep = FakeSweep(Scene((), middle=SPOT), frames=frames)
    model = RobotModel.from_file("xarm7", "link_eef")
    return arm_sweep(sweep, model, 0.0, np.random.default_rng(0))[:2]


def swept(
    made: Thing, seed: int, frames: int, cameras: tuple[str, ...], poses: tuple[Array, Array] | None = None
) -> dict[str, list[View]]:
    """What is seen with each camera; the poses are exact, and the images of both show the same.

    Args:
        made: on the table.
        seed: of the noise.
        frames: how many.
        cameras: of `CAMERAS`.
        poses: (V, 3, 3) and (V, 3) m of the camera; None: those of an xArm7.
    """
    scene = Scene((Body(made.corners, made.colours),), middle=SPOT)
    rotation, translation = poses or _poses(frames)
    world = np.random.default_rng([seed, 19])
    bias = float(world.uniform(0.005, 0.01) * world.choice([-1, 1]))
    glossy = made.glossy if world.random() < 0.5 else made.glossy[:0]
    draws = {camera: np.random.default_rng([seed, 20, number]) for number, camera in enumerate(CAMERAS)}
    views: dict[str, list[View]] = {camera: [] for camera in cameras}
    rays = np.concatenate([np.moveaxis(VGA.rays, 0, -1), np.ones((VGA.height, VGA.width, 1))], axis=-1)
    for number, (turn, place) in enumerate(zip(rotation, translation, strict=True)):
        seen = render(scene, VGA, turn, place)
        for camera in cameras:
            if camera == "d435":
                steps = measured(seen, VGA.fx, D435, draws[camera])
            else:
                at = (seen.depth[..., None] * rays) @ turn.T + place
                steps = _worse(seen, at, glossy, bias, draws[camera])
            depth = depth_in_metres(steps, "16UC1")
            views[camera].append(View(Frame(number * PERIOD, "camera", VGA, depth, seen.colours), turn, place))
    return views
