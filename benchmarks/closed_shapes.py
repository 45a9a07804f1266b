"""Closed surfaces of exact volume and moments, from four worlds, and clouds of them with errors of five families.

- `tools`: the workshop tools. `pieces`: unions of the convex pieces of benchmarks/random_objects.py.
- `turned`: lathe work, extrusions, tubes and smooth blobs, which share no code with the pieces.
- `public`: the random objects that come with PyBullet (pybullet_data/random_urdfs).
"""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, OpType
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.random_objects import KINDS
from benchmarks.segmentation_truth import load_clouds, sample
from poise.shape import tetrahedron_moments
from poise.shape.carving import carve
from poise.shape.solid import Solid
from poise.shape.surface_graph import unit_normals
from poise.types import Array, Indices, Mask

FIRST_FINAL_SEED = 6200
"""Seeds from here on are answered once, after the last change."""
_PUBLIC_SCALE = 0.015
"""m per unit, as the URDF files of random_urdfs say."""
_TOUCHED = 16_000
"""Points whose carved solid says what can be seen of a tool."""


CLOSE = 0.03
"""m, radius of what a close view shows."""


@dataclass(frozen=True, eq=False)
class ClosedShape:
    """A closed surface: (V, 3) m, (T, 3) counter-clockwise from outside."""

    name: str
    vertices: Array
    triangles: Indices

    @cached_property
    def moments(self) -> Array:
        """(4, 4) pseudo-inertia at unit density, about the mesh's origin."""
        corners = np.insert(self.vertices[self.triangles], 0, 0.0, axis=1)
        return np.asarray(tetrahedron_moments(corners).sum(axis=0))

    @property
    def volume(self) -> float:
        """m3."""
        return float(self.moments[3, 3])

    def cloud(
        self,
        rng: np.random.Generator,
        count: int,
        family: str = "white",
        sigma: float = 0.0,
        denser: float = 1.0,
        close: bool = False,
    ) -> Array:
        """(count, 3) m: points on the surface with errors of one family (see `FAMILIES`), one sigma per axis, m.

        At one end of the longest axis there are `denser` times as many per area as at the other, as if seen from there;
        or, in a `close` view, in a ball of `CLOSE` m as elsewhere.
        """
        points = self.surface(rng, count)
        if denser > 1:
            many = self.surface(rng, 20 * count)
            if close:
                share = (np.linalg.norm(many - many[0], axis=1) > CLOSE).astype(np.float64)
            else:
                along = (many - many.mean(axis=0)) @ np.linalg.svd(many - many.mean(axis=0), full_matrices=False)[2][0]
                share = (along - along.min()) / np.ptp(along)
            weights = denser**-share
            points = many[rng.choice(len(many), count, replace=False, p=weights / weights.sum())]
        return FAMILIES[family](rng, points, sigma) if sigma > 0 else points

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 3) m, evenly on the surface."""
        return sample(self.vertices, self.triangles, rng, count)


# ---- errors of points: (rng, points (N, 3) m, sigma m) -> points ----


def _white(rng: np.random.Generator, points: Array, sigma: float) -> Array:
    return points + rng.normal(scale=sigma, size=points.shape)


def _smooth_field(rng: np.random.Generator, points: Array, length: float, waves: int = 40) -> Array:
    """(N,) a random field of unit variance that changes over `length` m."""
    ways = rng.normal(size=(waves, 3)) / length
    return np.asarray(np.sqrt(2 / waves) * np.cos(points @ ways.T + rng.uniform(0, 2 * np.pi, waves)).sum(axis=1))


def _uneven(rng: np.random.Generator, points: Array, sigma: float) -> Array:
    """Noise between nothing and 2.5 sigma from place to place, sigma over all."""
    size = np.exp(0.8 * _smooth_field(rng, points, 0.04))
    size *= sigma / np.sqrt(np.mean(size**2))
    return points + rng.normal(size=points.shape) * np.minimum(size, 2.5 * sigma)[:, None]


def _quantised(rng: np.random.Generator, points: Array, sigma: float) -> Array:
    """Coordinates on a grid that lies askew, whose rounding has half of the variance; the rest is white."""
    turn, step = Rotation.random(random_state=rng).as_matrix(), sigma * np.sqrt(6)
    noisy = (points + rng.normal(scale=sigma / np.sqrt(2), size=points.shape)) @ turn
    return np.asarray((np.round(noisy / step) * step) @ turn.T)


def _outliers(rng: np.random.Generator, points: Array, sigma: float) -> Array:
    """White noise, and one point in fifty up to 15 mm away."""
    noisy = _white(rng, points, sigma)
    stray = rng.random(len(points)) < 0.02
    return np.where(stray[:, None], points + rng.uniform(-0.0087, 0.0087, size=points.shape), noisy)


def _correlated(rng: np.random.Generator, points: Array, sigma: float) -> Array:
    """Neighbours within about 2 cm err alike, with half of the variance; the rest is white."""
    field = np.stack([_smooth_field(rng, points, 0.02) for _ in range(3)], axis=1)
    return _white(rng, points, sigma / np.sqrt(2)) + sigma / np.sqrt(2) * field


FAMILIES: dict[str, Callable[[np.random.Generator, Array, float], Array]] = {
    "white": _white, "uneven": _uneven, "quantised": _quantised, "outliers": _outliers, "correlated": _correlated,
}  # fmt: skip


# ---- worlds: seed -> shape ----


def of_manifold(name: str, body: Manifold) -> ClosedShape:
    """The surface of a union."""
    mesh = body.to_mesh()
    return ClosedShape(name, np.asarray(mesh.vert_properties[:, :3], np.float64), np.asarray(mesh.tri_verts, np.int64))


def pieces(seed: int) -> ClosedShape:
    """The outside of a random object of convex pieces."""
    kind = KINDS[seed % len(KINDS)]
    made = kind(np.random.default_rng([seed, 6]))
    body = Manifold.batch_boolean([Manifold.hull_points(piece.corners) for piece in made], OpType.Add)
    return of_manifold(f"{kind.__name__} {seed}", _largest(body))


def _largest(body: Manifold) -> Manifold:
    return max(body.decompose(), key=lambda one: one.volume())


@dataclass(frozen=True, eq=False)
class SeenShape(ClosedShape):
    """Several shells, between which no camera sees: points are where a ball touches them."""

    @cached_property
    def filled(self) -> Solid:
        """What the ball does not reach."""
        return carve(sample(self.vertices, self.triangles, np.random.default_rng(0), _TOUCHED))

    @cached_property
    def _outside(self) -> tuple[cKDTree, Mask]:
        return cKDTree(self.filled.vertices), unit_normals(self.filled)[1]

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 3) m on what can be seen."""
        tree, outer = self._outside
        points = sample(self.vertices, self.triangles, rng, 2 * count)
        return points[outer[tree.query(points)[1]]][:count]


def tools() -> list[ClosedShape]:
    """The workshop tools."""
    return [SeenShape(tool.name, tool.vertices, tool.triangles) for tool in load_clouds()]


def public(number: int) -> SeenShape:
    """One of the thousand random objects of PyBullet."""
    import trimesh

    found = importlib.util.find_spec("pybullet_data")
    if found is None or found.origin is None:
        raise SystemExit("pybullet_data is not installed: pip install pybullet")
    path = Path(found.origin).parent / "random_urdfs" / f"{number:03d}" / f"{number:03d}.obj"
    mesh = trimesh.load(path, force="mesh")
    return SeenShape(f"public {number}", _PUBLIC_SCALE * np.asarray(mesh.vertices), np.asarray(mesh.faces))


def seams(number: int) -> ClosedShape:
    """The same with points on all faces of its convex pieces, also inside, which a cloud from a CAD model may have."""
    seen = public(number)
    return ClosedShape(f"seams {number}", seen.vertices, seen.triangles)


def turned(seed: int) -> ClosedShape:
    """Things that are not made of convex pieces; kinds take turns."""
    rng = np.random.default_rng([seed, 77])
    kind = _TURNED[seed % len(_TURNED)]
    return of_manifold(f"{kind.__name__.strip('_')} {seed}", _largest(kind(rng)))


def _profile(rng: np.random.Generator, height: float, radius: float) -> Array:
    """(P, 2) m a smooth closed outline right of the axis."""
    z = np.linspace(0, 1, 40)
    waves = sum(rng.normal(scale=0.25 / k) * np.cos(np.pi * k * z + rng.uniform(0, 6)) for k in (1, 2, 3))
    r = radius * np.clip(0.7 + waves, 0.25, 1.3)
    return np.concatenate([[[0, 0]], np.column_stack([r, height * z]), [[0, height]]])


def _vase(rng: np.random.Generator) -> Manifold:
    """A body of revolution, sometimes hollow from above."""
    height, radius = rng.uniform(0.06, 0.18), rng.uniform(0.02, 0.04)
    outline = _profile(rng, height, radius)
    body = CrossSection([outline]).revolve(64)
    if rng.random() < 0.4:
        wall = rng.uniform(0.004, 0.008)
        inner = CrossSection([outline]).offset(-wall, circular_segments=16).revolve(64)
        cut = Manifold.cylinder(height, 0.5 * radius, 0.5 * radius, 48).translate((0, 0, height / 2))
        body = body - (inner + (cut ^ body.translate((0, 0, 0))))
    return body


def _mug(rng: np.random.Generator) -> Manifold:
    """A cup with a handle."""
    height, radius, wall = rng.uniform(0.07, 0.11), rng.uniform(0.03, 0.045), rng.uniform(0.003, 0.006)
    cup = Manifold.cylinder(height, radius, radius * rng.uniform(0.9, 1.15), 72)
    bar = rng.uniform(0.004, 0.007)
    ring = CrossSection.circle(bar, 20).translate((height * 0.32, 0)).revolve(48).rotate((90, 0, 0))
    handle = ring.translate((radius, 0, height / 2)) - cup
    hollow = Manifold.cylinder(height, radius - wall, radius * 0.95 - wall, 72).translate((0, 0, wall))
    return cup + _largest(handle) - hollow


def _bracket(rng: np.random.Generator) -> Manifold:
    """An angle of plate with holes and a rib."""
    a, b, wide, thick = *rng.uniform(0.05, 0.11, 2), rng.uniform(0.03, 0.05), rng.uniform(0.003, 0.008)
    body = Manifold.cube((a, wide, thick)) + Manifold.cube((thick, wide, b))
    for x in (0.45, 0.8):
        body -= Manifold.cylinder(0.05, wide * 0.15, wide * 0.15, 32, True).translate((a * x, wide / 2, 0))
    rib = CrossSection([[[0, 0], [a * 0.6, 0], [0, b * 0.6]]]).extrude(thick).rotate((90, 0, 0))
    return body + rib.translate((0, wide / 2 + thick / 2, 0))


def _spanner(rng: np.random.Generator) -> Manifold:
    """An outline with rounded corners, extruded: a ring, a bar and an open jaw."""
    length, wide, thick = rng.uniform(0.12, 0.24), rng.uniform(0.012, 0.02), rng.uniform(0.004, 0.009)
    ends = [CrossSection.circle(wide * 1.1, 48).translate((x, 0)) for x in (0, length)]
    flat = CrossSection.square((length, wide), True).translate((length / 2, 0)) + ends[0] + ends[1]
    flat = flat.offset(0.004, circular_segments=24).offset(-0.004, circular_segments=24)
    flat -= CrossSection.circle(wide * 0.6, 6)
    flat -= CrossSection.square((wide * 2, wide * 0.9), True).translate((length + wide, 0))
    return flat.extrude(thick)


def _blob(rng: np.random.Generator) -> Manifold:
    """Balls that melt into each other."""
    balls = rng.normal(scale=0.02, size=(6, 3))
    size = rng.uniform(0.008, 0.02, 6)

    def level(x: float, y: float, z: float) -> float:
        squares = ((np.array([x, y, z]) - balls) ** 2).sum(axis=1)
        return float(np.log(np.exp(-squares / size**2).sum() + 1e-30) + 0.7) * 0.005

    return Manifold.level_set(level, (-0.1, -0.1, -0.1, 0.1, 0.1, 0.1), 0.005)


def _knob(rng: np.random.Generator) -> Manifold:
    """A gear or a knob: an extruded wavy outline on a shaft."""
    teeth, radius = int(rng.integers(5, 14)), rng.uniform(0.02, 0.045)
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    away = radius * (1 + rng.uniform(0.05, 0.2) * np.cos(teeth * angle))
    wheel = CrossSection([np.column_stack([away * np.cos(angle), away * np.sin(angle)])]).extrude(
        rng.uniform(0.008, 0.03)
    )
    shaft = Manifold.cylinder(rng.uniform(0.05, 0.1), radius * 0.3, radius * rng.uniform(0.2, 0.3), 40)
    return wheel + shaft


def _tube(rng: np.random.Generator) -> Manifold:
    """A thick wire bent along a smooth path."""
    t = np.linspace(0, 1, 60)
    ways = rng.normal(size=(3, 3)) * 0.05
    path = sum(np.outer(np.sin((k + 1) * t * 2.2), ways[k]) / (k + 1) for k in range(3)) + np.outer(t, [0, 0, 0.1])
    radius = rng.uniform(0.005, 0.011)
    balls = [Manifold.sphere(radius, 20).translate(tuple(place)) for place in path]
    return Manifold.batch_boolean([Manifold.batch_hull(pair) for pair in pairwise(balls)], OpType.Add)


def _clip(rng: np.random.Generator) -> Manifold:
    """Two legs that stand apart, joined at one end: a peg, a locking plier's handles."""
    length, thick, wide = rng.uniform(0.09, 0.18), rng.uniform(0.007, 0.012), rng.uniform(0.012, 0.02)
    apart = thick + rng.uniform(0.006, 0.02)
    legs = [
        Manifold.cube((length, wide, thick), True)
        .rotate((0, side * rng.uniform(1, 5), 0))
        .translate((0, 0, side * apart / 2))
        for side in (-1, 1)
    ]
    joint = Manifold.cube((0.02, wide * 1.2, apart + thick), True).translate((-length / 2 + 0.015, 0, 0))
    return legs[0] + legs[1] + joint


_TURNED = (_vase, _mug, _bracket, _spanner, _blob, _knob, _tube, _clip)
WORLDS: dict[str, Callable[[int], ClosedShape]] = {
    "pieces": pieces, "turned": turned, "public": public, "seams": seams,
}  # fmt: skip
