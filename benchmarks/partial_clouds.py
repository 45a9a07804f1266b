"""Clouds that do not show the whole surface, or show more than there is: refused, uncertain, or wrong without a word?

python -m benchmarks.partial_clouds [--worlds ...] [--noise MM ...] [--points N] [--first SEED] [--objects N] [--each]
"""

import argparse
import itertools
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.closed_shapes import WORLDS, ClosedShape, SeenShape
from benchmarks.solids import Record
from poise.errors import PoiseError
from poise.shape import segment
from poise.shape.surface_graph import unit_normals
from poise.types import Array, Mask

console = Console(width=150)
_DENSE, _PIXEL, _BEHIND = 100_000, 1e-3, 2e-3
"""Points that a view is computed with, its pixels in m, and how far behind the nearest a point is hidden, m."""
_GRAZING = 0.1
"""Cosine to the view below which a surface is not seen."""
_SAME = 0.1
_BOTTOM, _RIM = 0.6, 0.5
"""Cosine of what faces down, and share of the height in which it is the bottom."""

Seen = Callable[["Surface", np.random.Generator], Mask]


class Surface:
    """Points (N, 3) m on a shape, with outward normals (N, 3)."""

    def __init__(self, shape: ClosedShape, rng: np.random.Generator) -> None:
        self.points, self.normals = _drawn(shape, rng)

    def seen_from(self, way: Array) -> Mask:
        """(N,) what is seen from far away in a direction (3,)."""
        across = Rotation.align_vectors([[0, 0, 1]], [way])[0].apply(self.points)
        pixel = np.floor((across[:, :2] - across[:, :2].min(axis=0)) / _PIXEL).astype(np.int64)
        number = pixel[:, 0] * (pixel[:, 1].max() + 1) + pixel[:, 1]
        nearest = np.full(number.max() + 1, -np.inf)
        np.maximum.at(nearest, number, across[:, 2])
        return (across[:, 2] > nearest[number] - _BEHIND) & (self.normals @ way > _GRAZING)


def _drawn(shape: ClosedShape, rng: np.random.Generator) -> tuple[Array, Array]:
    """(N, 3) m on a shape, and (N, 3) outward unit normals there."""
    if isinstance(shape, SeenShape):
        points = shape.surface(rng, _DENSE)
        normals, outer = unit_normals(shape.filled)
        at = np.flatnonzero(outer)
        return points, normals[at[cKDTree(shape.filled.vertices[at]).query(points)[1]]]
    corners = shape.vertices[shape.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    own = rng.choice(len(areas), _DENSE, p=areas / areas.sum())
    points = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), _DENSE), corners[own])
    return points, across[own] / areas[own, None]


def _filled(shape: SeenShape) -> bool:
    """Whether what its outside encloses is its volume: some are shells, open by cracks."""
    return abs(shape.filled.volume / shape.volume - 1) < _SAME


def _way(rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def whole(surface: Surface, rng: np.random.Generator) -> Mask:
    """All of the surface."""
    return np.ones(len(surface.points), bool)


def one_view(surface: Surface, rng: np.random.Generator) -> Mask:
    """What one camera sees."""
    return surface.seen_from(_way(rng))


def two_views(surface: Surface, rng: np.random.Generator) -> Mask:
    """What two cameras see, 60 to 120 degrees apart: about two thirds."""
    first = _way(rng)
    side = np.cross(first, _way(rng))
    turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(60, 120)) * side / np.linalg.norm(side))
    return surface.seen_from(first) | surface.seen_from(turn.apply(first))


def ring_of_views(surface: Surface, rng: np.random.Generator) -> Mask:
    """What 12 cameras around a table see, from 45 degrees above: no bottom."""
    turn = Rotation.random(random_state=rng)
    ways = [turn.apply([np.cos(a), np.sin(a), 1.0]) / np.sqrt(2) for a in np.arange(12) * np.pi / 6]
    return np.asarray(np.any([surface.seen_from(way) for way in ways], axis=0))


def no_bottom(surface: Surface, rng: np.random.Generator) -> Mask:
    """All but what faces one way on that side."""
    way = _way(rng)
    height = surface.points @ way
    low = height < np.quantile(height, 0) + _RIM * np.ptp(height)
    return ~(low & (surface.normals @ way < -_BOTTOM))


def half(surface: Surface, rng: np.random.Generator) -> Mask:
    """One side of a plane."""
    along = surface.points @ _way(rng)
    return along > np.median(along)


def three_quarters(surface: Surface, rng: np.random.Generator) -> Mask:
    """Three quarters of the surface, cut off by a plane."""
    along = surface.points @ _way(rng)
    return along > np.quantile(along, 0.25)


def no_end(surface: Surface, rng: np.random.Generator) -> Mask:
    """All but what faces along the longest or the second longest axis: narrow sides."""
    axis = np.linalg.svd(surface.points[::50] - surface.points.mean(axis=0), full_matrices=False)[2][rng.integers(2)]
    return ~((surface.normals @ axis > 0.8) & (surface.points @ axis > np.quantile(surface.points @ axis, 0.7)))


CASES: dict[str, Seen] = {
    case.__name__: case for case in (whole, one_view, two_views, ring_of_views, no_bottom, half, three_quarters, no_end)
}


def mirrored(surface: Surface, rng: np.random.Generator, count: int) -> Array:
    """(count, 3) m: as a ring of cameras sees it, with its mirror image in the table, a third as dense."""
    way = _way(rng)
    height = surface.points @ way
    table = height.min()
    real = ring_like(surface, way)
    image = surface.points - 2 * np.outer(height - table, way)
    shown = rng.choice(np.flatnonzero(real), 3 * count // 4, replace=False)
    doubled = rng.choice(np.flatnonzero(real), count // 4, replace=False)
    return np.concatenate([surface.points[shown], image[doubled]])


def ring_like(surface: Surface, way: Array) -> Mask:
    """(N,) all but what lies flat on the table."""
    return ~((surface.normals @ way < -0.95) & (surface.points @ way < (surface.points @ way).min() + 1e-3))


def cloud(shape: ClosedShape, case: str, noise: float, count: int, seed: int) -> Array:
    """(count, 3) m of what is seen, or fewer."""
    rng = np.random.default_rng([seed, len(case), round(1e6 * noise), *shape.name.encode()])
    surface = Surface(shape, rng)
    if case == "mirror":
        points = mirrored(surface, rng, count)
    else:
        seen = np.flatnonzero(CASES[case](surface, rng))
        points = surface.points[rng.choice(seen, min(count, len(seen)), replace=False)]
    return np.asarray(points + noise * rng.normal(size=points.shape))


def measure(points: Array, shape: ClosedShape, world: str, case: str, noise: float) -> Record:
    """Reconstruct a cloud (N, 3) m."""
    known = world, shape.name, case, noise, len(points)
    start = time.process_time()
    try:
        found = segment(points)
    except PoiseError as error:
        return Record(*known, *[np.nan] * 4, 0, time.process_time() - start, error.message)
    ratio, std = found.solid.volume / shape.volume, found.solid.volume_std / shape.volume
    seconds = time.process_time() - start
    return Record(*known, ratio, std, np.nan, np.nan, found.n_parts, seconds, " | ".join(found.notes))


def table(records: list[Record]) -> Table:
    """A row for each case."""
    made = Table(title="clouds that are not the whole surface", title_justify="left")
    headings = "refused", "within 15 %", "beyond 2 sigma", "of these without a note", "volume, middle", "sigma, middle"
    for heading in ("case", "noise, mm", "clouds", *headings):
        made.add_column(heading, justify="right")
    for case, noise in dict.fromkeys((one.family, one.noise) for one in records):
        rows = [one for one in records if (one.family, one.noise) == (case, noise)]
        good = [one for one in rows if np.isfinite(one.volume)]
        wrong = [one for one in good if abs(one.score) > 2]
        silent = [one for one in wrong if not one.message]
        middles = [f"{np.median(of):.2f}" if of else "-" for of in ([g.volume for g in good], [g.std for g in good])]
        near = sum(abs(one.volume - 1) < 0.15 for one in good)
        made.add_row(
            case,
            f"{1e3 * noise:.1f}",
            *map(str, (len(rows), len(rows) - len(good), near, len(wrong), len(silent))),
            *middles,
        )
    return made


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", default=["pieces", "turned", "public"], choices=list(WORLDS))
    parser.add_argument("--cases", nargs="+", default=[*CASES, "mirror"], choices=[*CASES, "mirror"])
    parser.add_argument("--noise", nargs="+", type=float, default=[0, 1], help="mm")
    parser.add_argument("--points", type=int, default=3000)
    parser.add_argument("--first", type=int, default=20, help="seed of the first object")
    parser.add_argument("--objects", type=int, default=8, help="per world")
    parser.add_argument("--each", action="store_true", help="print every cloud")
    chosen = parser.parse_args()
    records = []
    for world in chosen.worlds:
        for seed in range(chosen.first, chosen.first + chosen.objects):
            shape = WORLDS[world](seed)
            if not len(shape.triangles) or (isinstance(shape, SeenShape) and not _filled(shape)):
                continue
            for case, noise in itertools.product(chosen.cases, chosen.noise):
                points = cloud(shape, case, 1e-3 * noise, chosen.points, seed)
                one = measure(points, shape, world, case, 1e-3 * noise)
                records.append(one)
                if chosen.each:
                    stated = f"{one.volume:.3f} ± {one.std:.3f} z {one.score:+.1f}"
                    print(f"{shape.name:20} {case:15} {noise:.0f} mm {stated}  {one.message[:300]}", flush=True)
    console.print(table(sorted(records, key=lambda one: one.noise)))


if __name__ == "__main__":
    main()
