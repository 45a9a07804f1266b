"""Sweeps that no code of Poise renders: spheres traced through signed distances, with a depth camera of its own errors.

python -m benchmarks.traced_sweeps [--objects NAME...] [--cases NAME...] [--views N] [--seed N]

Depth has axial noise that grows with distance and slant, speckle that is alike over some pixels, lateral jitter, flying
pixels and steps. Cases add half an object that is dark (most of its pixels have no depth), glossy places, and poses
that are wrong by themselves in each view.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import ndimage
from scipy.spatial.transform import Rotation

from poise.errors import PoiseError
from poise.scanning import Camera, Frame, View, scan
from poise.types import Array, Mask

CAMERA = Camera(424, 240, 305.0, 305.0, 211.3, 119.6)
_REACH, _STEPS, _HIT = 0.17, 70, 1e-4
"""m around the middle of an object, in which rays are followed; steps of a ray; and m at which it has arrived."""
_MIDDLE = np.array([0.0, 0.0, 0.05])
_TABLE = 0.5
"""m, half a side."""
_GRAZING = 0.12
"""Cosine between ray and normal below which there is no depth."""
Distance = Callable[[Array], Array]
console = Console(width=130)


def _length(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=-1))


def box(
    points: Array, middle: tuple[float, float, float], half: tuple[float, float, float], round_: float = 0
) -> Array:
    """Signed distance, m, from a box with rounded edges."""
    off = np.abs(points - middle) - (np.array(half) - round_)
    return np.asarray(_length(np.maximum(off, 0)) + np.minimum(off.max(axis=-1), 0) - round_)


def cylinder(points: Array, middle: tuple[float, float, float], radius: float, half: float) -> Array:
    """The same from a cylinder along z."""
    at = points - middle
    off = np.stack([_length(at[..., :2]) - radius, np.abs(at[..., 2]) - half], axis=-1)
    return np.asarray(_length(np.maximum(off, 0)) + np.minimum(off.max(axis=-1), 0))


def _least(*distances: Array) -> Array:
    return np.asarray(np.minimum.reduce(distances))


def _drill(points: Array) -> Array:
    body = cylinder(points[..., [1, 2, 0]], (0, 0.055, 0), 0.025, 0.08)
    handle = box(points, (-0.03, 0, 0.03), (0.02, 0.016, 0.03), 0.005)
    return _least(body, handle, box(points, (-0.03, 0, 0.008), (0.035, 0.025, 0.008), 0.003))


OBJECTS: dict[str, Distance] = {
    "brick": lambda at: box(at, (0, 0, 0.03), (0.06, 0.035, 0.03), 0.008),
    "drill": _drill,
    "angle": lambda at: _least(
        box(at, (0, 0, 0.004), (0.05, 0.025, 0.004)), box(at, (-0.046, 0, 0.04), (0.004, 0.025, 0.04))
    ),
    "cross": lambda at: _least(
        box(at, (0, 0, 0.012), (0.07, 0.012, 0.012)),
        box(at, (0, 0, 0.012), (0.012, 0.06, 0.012)),
        cylinder(at, (0, 0, 0.04), 0.01, 0.04),
    ),
    "plate": lambda at: np.maximum(
        box(at, (0, 0, 0.006), (0.07, 0.05, 0.006), 0.002), -cylinder(at, (0.03, 0, 0.006), 0.015, 0.05)
    ),
    "rod": lambda at: _least(
        box(at, (0, 0, 0.02), (0.078, 0.008, 0.008), 0.008),
        *(_length(at - np.array([x, 0, 0.02])) - 0.02 for x in (-0.075, 0.075)),
    ),
    "bottle": lambda at: _least(cylinder(at, (0, 0, 0.05), 0.03, 0.05), cylinder(at, (0, 0, 0.12), 0.012, 0.03)),
}


@dataclass(frozen=True)
class Case:
    """Errors: share of pixels without depth where the object is dark (x below -0.02), 1 - cosine of the slant at which
    it reflects, and m and rad by which each pose is off."""

    dark: float = 0.0
    gloss: float = 0.0
    shift: float = 0.0
    turn: float = 0.0


CASES = {
    "plain": Case(), "dark half": Case(dark=0.5), "darker": Case(dark=0.8, gloss=0.06), "black": Case(dark=0.93),
    "poses": Case(shift=1.5e-3, turn=2e-3),
}  # fmt: skip


def volume_of(distance: Distance, cell: float = 1e-3) -> float:
    """m3, by cells that the surface cuts in part."""
    flat, up = np.arange(-0.13, 0.13, cell) + cell / 2, np.arange(0, 0.17, cell) + cell / 2
    x, y = np.meshgrid(flat, flat, indexing="ij")
    layers = (distance(np.stack([x, y, np.full_like(x, z)], axis=-1)) for z in up)
    return float(sum(np.clip(0.5 - layer / cell, 0, 1).sum() for layer in layers)) * cell**3


def ring(count: int, heights: tuple[float, ...] = (22, 42, 62)) -> list[tuple[Array, Array]]:
    """Rotations and places, m, of cameras that look at the object from all sides, one turn at each height, deg."""
    made = []
    for number in range(count):
        around = 2 * np.pi * len(heights) * number / count
        up = np.deg2rad(heights[number * len(heights) // count])
        way = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
        place = 0.38 * (1 + 0.12 * np.sin(2.3 * number)) * way + [0, 0, 0.03]
        ahead = np.array([0, 0, 0.03]) - place
        ahead /= _length(ahead)
        side = np.cross(ahead, [0, 0, 1.0])
        side /= _length(side)
        level = np.column_stack([side, np.cross(ahead, side), ahead])
        made.append((level @ Rotation.from_euler("z", 0.2 * np.sin(number)).as_matrix(), place))
    return made


def traced(distance: Distance, rotation: Array, place: Array) -> tuple[Array, Mask, Array, Array]:
    """(H, W) m true depth along the axis, 0 beside the table; which pixels show the object; the cosine of their slant;
    and (H, W, 3) m what they show."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    long = _length(rays)
    ways = (rays / long[..., None]) @ rotation.T
    reach = np.where(ways[..., 2] < -1e-6, -place[2] / np.minimum(ways[..., 2], -1e-6), np.inf)
    met = place + ways * np.where(np.isfinite(reach), reach, 0)[..., None]
    reach = np.where(np.abs(met[..., :2]).max(axis=-1) < _TABLE, reach, np.inf)
    along = ways @ (_MIDDLE - place)
    near = _length(place + ways * along[..., None] - _MIDDLE) < _REACH
    gone, open_ = np.maximum(along[near] - _REACH, 0), np.arange(np.count_nonzero(near))
    arrived = np.zeros(len(gone), bool)
    for _ in range(_STEPS):
        step = distance(place + ways[near][open_] * gone[open_, None])
        gone[open_] += step
        arrived[open_[step < _HIT]] = True
        open_ = open_[(step >= _HIT) & (gone[open_] < along[near][open_] + _REACH)]
    shows = np.zeros(reach.shape, bool)
    shows[near] = arrived & (gone < reach[near])
    reach[near] = np.where(shows[near], gone, reach[near])
    seen = place + ways * np.where(np.isfinite(reach), reach, 0)[..., None]
    slant = np.abs(ways[..., 2])
    moves = 1e-4 * np.eye(3)
    normals = np.stack([distance(seen[shows] + way) - distance(seen[shows] - way) for way in moves], axis=-1)
    normals /= np.maximum(_length(normals), 1e-12)[:, None]
    slant[shows] = np.abs(np.einsum("ni,ni->n", normals, ways[shows]))
    return np.where(np.isfinite(reach), reach / long, 0), shows, slant, seen


def measured(
    true: Array, shows: Mask, slant: Array, seen: Array, case: Case, rng: np.random.Generator, step: float = 1e-3
) -> Array:
    """(H, W) m as the camera reports it; 0: nothing."""

    def field(width: float) -> Array:
        made = ndimage.gaussian_filter(rng.normal(size=true.shape), width)
        return np.asarray(made / made.std())

    row, column = np.indices(true.shape)
    row, column = (
        np.clip(np.round(at + 0.6 * field(0.7)), 0, size - 1).astype(int)
        for at, size in zip((row, column), true.shape, strict=True)
    )
    depth = true[row, column]
    high, low = ndimage.maximum_filter(depth, 3), ndimage.minimum_filter(np.where(depth > 0, depth, 9.0), 3)
    flying = (high - low > 0.008) & (low < 9) & (rng.random(true.shape) < 0.5)
    depth = np.where(flying, low + rng.random(true.shape) * (high - low), depth)
    axial = 8e-4 * (true / 0.4) ** 2 * rng.normal(size=true.shape) / np.sqrt(np.clip(slant, 0.15, 1))
    depth = np.where(depth > 0, depth + axial + 8e-4 * field(2.5), 0)
    depth[slant < _GRAZING] = 0
    depth[shows & (slant > 1 - case.gloss)] = 0
    depth[shows & (seen[..., 0] < -0.02) & (rng.random(true.shape) < case.dark)] = 0
    return np.asarray(np.where(depth > 0, np.round(depth / step) * step, 0))


def views_of(distance: Distance, count: int, case: Case, rng: np.random.Generator) -> list[View]:
    """What the camera reports from all sides, with the poses that are stated."""
    views = []
    for number, (rotation, place) in enumerate(ring(count)):
        depth = measured(*traced(distance, rotation, place), case, rng).astype(np.float32)
        turn = Rotation.from_rotvec(case.turn * rng.normal(size=3)).as_matrix()
        frame = Frame(number * 10**8, "camera", CAMERA, depth)
        views.append(View(frame, turn @ rotation, place + case.shift * rng.normal(size=3)))
    return views


def answer(views: list[View], volume: float) -> str:
    """Volume over the truth with its sigma; `!` beyond two of them."""
    try:
        solid = scan(views).segmented().solid
    except PoiseError as error:
        return f"refused ({error.code.name})"
    ratio, sigma = solid.volume / volume, solid.volume_std / volume
    return f"{ratio:.2f} ± {sigma:.2f}{' !' if abs(ratio - 1) > 2 * sigma else ''}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS), choices=list(OBJECTS))
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    chosen = parser.parse_args()
    table = Table(title=f"{chosen.views} traced views of 424 x 240 pixels, volume over the truth")
    for heading in ("object", *chosen.cases):
        table.add_column(heading, justify="left")
    for name in chosen.objects:
        volume, row = volume_of(OBJECTS[name]), [name]
        for case in chosen.cases:
            rng = np.random.default_rng([chosen.seed, *name.encode(), *case.encode()])
            row.append(answer(views_of(OBJECTS[name], chosen.views, CASES[case], rng), volume))
        console.print(" | ".join(row))
        table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    main()
