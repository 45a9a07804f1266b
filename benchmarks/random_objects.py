"""Random objects of known parts: convex pieces put together like tools, with colours, prints and gaps.

Seeds below `FIRST_TEST_SEED` are for choosing constants; those from it on are for figures, and nothing else.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from benchmarks.identification.objects import BenchmarkObject, load_tools
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.parts import Parts
from poise.types import Array, Indices, Mask

FIRST_TEST_SEED = 1000
POINTS, DENSE, INNER = 2000, 100_000, 2000
SKIN = 1e-7  # m, to step off a face
COLOUR_NOISE = 0.03
PLAIN, PRINTED = 0.2, 0.25  # shares of objects that are of one colour all over, and with a print on one of their parts
GRIP = np.array([0.0, 0.0, 0.12])  # m, where the sensor holds the object's middle
# kg/m3 and colour
MATERIALS = {
    "steel": (7850.0, (0.55, 0.55, 0.58)),
    "aluminium": (2700.0, (0.78, 0.79, 0.80)),
    "brass": (8500.0, (0.80, 0.65, 0.25)),
    "wood": (700.0, (0.60, 0.40, 0.20)),
    "red plastic": (1100.0, (0.80, 0.12, 0.10)),
    "blue plastic": (1050.0, (0.10, 0.20, 0.75)),
    "rubber": (1200.0, (0.10, 0.10, 0.10)),
}


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex body.

    Args:
        part: that it belongs to.
        corners: (C, 3) m.
        triangles: (T, 3, 3) m, around it.
        faces: (F, 4) outward unit normals n and offsets d: inside where n . x + d < 0.
    """

    part: int
    corners: Array
    triangles: Array
    faces: Array

    @classmethod
    def around(cls, part: int, corners: Array) -> "Piece":
        """The convex hull of (C, 3) m."""
        hull = ConvexHull(corners)
        return cls(part, corners[hull.vertices], corners[hull.simplices], np.unique(hull.equations.round(12), axis=0))

    def holds(self, points: Array) -> Mask:
        """Whether (N, 3) points are inside."""
        inside = np.all((points >= self.corners.min(axis=0)) & (points <= self.corners.max(axis=0)), axis=1)
        some = points[inside]
        inside[inside] = np.max(some @ self.faces[:, :3].T + self.faces[:, 3], axis=1, initial=-np.inf) < 0
        return np.asarray(inside)

    def moved(self, turn: Array, shift: Array) -> "Piece":
        return Piece.around(self.part, self.corners @ turn.T + shift)

    def scaled(self, factor: float) -> "Piece":
        """Of another size."""
        return Piece.around(self.part, factor * self.corners)

    @property
    def triangles_outwards(self) -> Array:
        """(T, 3, 3) m, with normals that point outwards."""
        middle = self.corners.mean(axis=0)
        inwards = np.linalg.det(self.triangles - middle) < 0
        return np.where(inwards[:, None, None], self.triangles[:, ::-1], self.triangles)


@dataclass(frozen=True, eq=False)
class Composite:
    """An object whose parts are known; where pieces overlap, the earlier one owns the place.

    Args:
        name: says the seed.
        points, colours, labels: (N, 3) m, (N, 3) 0..1 and (N,), on its surface.
        dense: (`DENSE`, 3) m, exact points on its surface.
        parts: of it, exact up to sampling.
        densities: (K,) kg/m3.
    """

    name: str
    points: Array
    colours: Array
    labels: Indices
    dense: Array
    parts: Parts
    densities: Array
    pieces: tuple[Piece, ...]

    @property
    def volume(self) -> float:
        """m3."""
        return float(self.parts.volumes.sum())

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 3) m of its surface, at most all there are."""
        return np.asarray(rng.permutation(self.dense)[:count])


# ---- shapes: lists of corners, each the hull of one piece ----


def box(x: float, y: float, z: float, taper: float = 1.0) -> list[Array]:
    """About the origin; `taper` narrows z towards +x, for wedges and blades."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    corners = signs * [x, y, z]
    corners[signs[:, 0] > 0, 2] *= taper
    return [corners]


def cone(length: float, first: float, last: float, sides: int = 24) -> list[Array]:
    """Along x, between two radii."""
    ring = _ring(sides)
    return [np.concatenate([np.insert(r * ring, 0, x, axis=1) for x, r in ((-length / 2, first), (length / 2, last))])]


def arc(radius: float, angle: float, section: Array, steps: int = 18) -> list[Array]:
    """A section (S, 2) of (outwards, along z) swept about z; a whole turn makes a ring."""
    around = np.linspace(-angle / 2, angle / 2, steps + 1)
    rings = [
        np.column_stack([(radius + section[:, 0]) * np.cos(a), (radius + section[:, 0]) * np.sin(a), section[:, 1]])
        for a in around
    ]
    return [np.concatenate(pair) for pair in pairwise(rings)]


def _ring(sides: int) -> Array:
    angles = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _rectangle(width: float, height: float) -> Array:
    return np.array([[-width, -height], [-width, height], [width, height], [width, -height]]) / 2


def _put(shape: list[Array], part: int, shift: Sequence[float], turn: Sequence[float] = (0, 0, 0)) -> list[Piece]:
    """A shape of one part, turned by angles about x, y, z in degrees and then shifted, m."""
    matrix = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    return [Piece.around(part, corners @ matrix.T + np.array(shift)) for corners in shape]


# ---- kinds of objects: pieces, the owners of overlaps first ----


def _bar(rng: np.random.Generator, length: float, width: float) -> list[Array]:
    """A handle: round, tapered, or flat."""
    kind = rng.integers(3)
    if kind == 0:
        return cone(length, width / 2, width / 2 * rng.uniform(0.6, 1.0))
    return box(length, width, width * rng.uniform(0.4, 1.0), rng.uniform(0.6, 1.0))


def hammer(rng: np.random.Generator) -> list[Piece]:
    """A head across the end of a handle, sometimes with a cap on one side."""
    length, width = rng.uniform(0.18, 0.34), rng.uniform(0.018, 0.035)
    wide, high = rng.uniform(0.07, 0.13), rng.uniform(0.025, 0.05)
    head = cone(wide, high / 2, high / 2) if rng.random() < 0.5 else box(wide, high, high)
    pieces = _put(head, 0, (length / 2, 0, 0), (0, 0, 90)) + _put(_bar(rng, length, width), 1, (0, 0, 0))
    if rng.random() < 0.5:
        cap = cone(rng.uniform(0.02, 0.04), high / 2 * 1.15, high / 2 * 1.15)
        pieces = _put(cap, 2, (length / 2, wide / 2, 0), (0, 0, 90)) + pieces
    return pieces


def blade(rng: np.random.Generator) -> list[Piece]:
    """A thin plate in a handle, sometimes with a collar."""
    length, width = rng.uniform(0.12, 0.25), rng.uniform(0.02, 0.05)
    thick = rng.uniform(0.0012, 0.005)
    grip = rng.uniform(0.08, 0.13)
    pieces = _put(_bar(rng, grip, rng.uniform(0.022, 0.035)), 1, (-grip / 2, 0, 0))
    pieces += _put(box(length, width, thick, rng.uniform(0.3, 1.0)), 0, (length / 2 - 0.01, 0, 0))
    if rng.random() < 0.5:
        pieces = _put(cone(0.012, 0.021, 0.019), 2, (0, 0, 0)) + pieces
    return pieces


def screwdriver(rng: np.random.Generator) -> list[Piece]:
    """A rod in a grip, sometimes with a tip or a nut."""
    rod, grip = rng.uniform(0.08, 0.18), rng.uniform(0.08, 0.12)
    thin, thick = rng.uniform(0.003, 0.006), rng.uniform(0.011, 0.018)
    pieces = _put(cone(grip, thick, thick * rng.uniform(0.7, 1.0), int(rng.choice([6, 24]))), 0, (-grip / 2, 0, 0))
    pieces += _put(cone(rod, thin, thin), 1, (rod / 2 - 0.01, 0, 0))
    if rng.random() < 0.5:
        pieces = _put(cone(0.015, thin * 2, thin * 2, 6), 1, (rod - 0.01, 0, 0)) + pieces
    return pieces


def clamp(rng: np.random.Generator) -> list[Piece]:
    """A bow with a screw through one of its ends, a pad and a bar; the pad stays off the other end."""
    radius, wide, high = rng.uniform(0.04, 0.08), rng.uniform(0.010, 0.018), rng.uniform(0.012, 0.02)
    pieces = _put(arc(radius, np.radians(rng.uniform(190, 250)), _rectangle(wide, high)), 0, (0, 0, 0), (0, 0, -90))
    screw = radius * rng.uniform(1.2, 1.6)
    thin = rng.uniform(0.004, 0.006)
    pieces += _put(cone(screw, thin, thin), 1, (radius * 0.95 - screw / 2 + radius * 0.6, 0, 0))
    end = radius * 0.95 - screw + radius * 0.6
    pieces = _put(cone(0.006, thin * 2.2, thin * 2.2), 2, (end, 0, 0)) + pieces
    pieces += _put(cone(radius, thin * 0.7, thin * 0.7), 3, (radius * 1.55, 0, 0), (0, 0, 90))
    return pieces


def pliers(rng: np.random.Generator) -> list[Piece]:
    """Two bars that cross at a pivot and leave narrow gaps on both sides, with grips."""
    length, width, thick = rng.uniform(0.15, 0.22), rng.uniform(0.012, 0.018), rng.uniform(0.007, 0.012)
    open_ = rng.uniform(3.0, 9.0)
    pieces = _put(cone(thick * 2.3, width * 0.5, width * 0.5), 0, (length * 0.2, 0, 0), (0, 90, 0))
    for part, side in ((1, 1), (2, -1)):
        shift = (0.0, side * width * 0.15, side * thick / 2)
        turned = (length * 0.2 * (1 - np.cos(np.radians(open_))), -side * length * 0.2 * np.sin(np.radians(open_)), 0)
        place, turn = np.add(shift, turned), (0, 0, side * open_)
        pieces += _put(box(length, width, thick), part, place, turn)
        grip = place + np.array([-length * 0.32, 0, 0]) @ Rotation.from_euler("xyz", turn, degrees=True).as_matrix().T
        pieces = _put(box(length * 0.4, width * 1.4, thick * 1.5), 3, grip, turn) + pieces
    return pieces


def wrench(rng: np.random.Generator) -> list[Piece]:
    """Rings or open jaws at the ends of a flat bar: one material, or a socket in one ring."""
    length, width, thick = rng.uniform(0.14, 0.28), rng.uniform(0.012, 0.02), rng.uniform(0.005, 0.009)
    radius = width * rng.uniform(0.7, 1.0)
    ring = arc(radius, 2 * np.pi, _rectangle(width * 0.5, thick * 1.6))
    jaw = arc(radius, np.radians(rng.uniform(220, 290)), _rectangle(width * 0.5, thick * 1.3))
    pieces = _put(ring, 0, (length / 2 + radius, 0, 0))
    pieces += _put(jaw if rng.random() < 0.5 else ring, 0, (-length / 2 - radius, 0, 0))
    pieces += _put(box(length, width, thick), 0, (0, 0, 0))
    if rng.random() < 0.4:
        inner = radius - width * 0.24
        pieces += _put(cone(thick * 4, inner, inner), 1, (length / 2 + radius, 0, 0), (0, 90, 0))
    return pieces


def case(rng: np.random.Generator) -> list[Piece]:
    """A block with a knob, a strap and a slot."""
    x, y, z = rng.uniform(0.06, 0.11), rng.uniform(0.05, 0.09), rng.uniform(0.025, 0.045)
    slot = rng.uniform(0.004, 0.012)
    depth = x * rng.uniform(0.15, 0.35)
    side = (y - slot) / 2
    pieces = _put(box(x - depth, y, z), 0, (-depth / 2, 0, 0))
    for way in (1, -1):
        pieces += _put(box(depth, side, z), 0, (x / 2 - depth / 2, way * (slot + side) / 2, 0))
    pieces += _put(cone(rng.uniform(0.008, 0.02), y * 0.22, y * 0.2), 1, (-depth / 2, 0, z / 2), (0, 90, 0))
    if rng.random() < 0.6:
        pieces += _put(arc(x * 0.4, np.pi, _rectangle(0.003, z * 0.5), 12), 2, (-depth / 2, -y / 2, 0), (0, 0, -90))
    return pieces


def chain(rng: np.random.Generator) -> list[Piece]:
    """Boxes, cones, plates and rings, each stuck into one before it."""
    pieces: list[Piece] = []
    for part in range(int(rng.integers(2, 6))):
        size = rng.uniform(0.02, 0.09, 3)
        kind = rng.integers(4)
        if kind == 0:
            shape = box(*size.tolist())
        elif kind == 1:
            shape = cone(size[0] * 1.5, size[1] / 2, size[1] / 2 * rng.uniform(0.3, 1.0))
        elif kind == 2:
            shape = box(size[0] * 1.5, size[1], rng.uniform(0.002, 0.006))
        else:
            shape = arc(size[0] / 1.5, 2 * np.pi, size[1] / 6 * _ring(8))
        new = _put(shape, part, (0.0, 0.0, 0.0), tuple(rng.uniform(0, 360, 3).tolist()))
        if pieces:
            reach = new[rng.integers(len(new))].corners.mean(axis=0)
            way = rng.normal(size=3)
            way /= np.linalg.norm(way)
            old = pieces[rng.integers(len(pieces))]
            end = old.corners[np.argmax(old.corners @ way)] * 0.9 + old.corners.mean(axis=0) * 0.1
            own = max(float(np.max((piece.corners - reach) @ -way)) for piece in new)
            new = [piece.moved(np.eye(3), end - reach + 0.8 * own * way) for piece in new]
        pieces += new
    return pieces


KINDS: tuple[Callable[[np.random.Generator], list[Piece]], ...] = (
    hammer, blade, screwdriver, clamp, pliers, wrench, case, chain,
)  # fmt: skip


# ---- from pieces to clouds and truths ----


def make_composite(seed: int, noise: float = 0.0, inner: int = INNER) -> Composite:
    """The object of a seed; kinds take turns.

    Args:
        seed: of everything.
        noise: m, of each point along each axis.
        inner: points in each piece that its moments are integrated with.
    """
    rng = np.random.default_rng([seed, 6])
    kind = KINDS[seed % len(KINDS)]
    pieces = kind(rng)
    turn = Rotation.random(random_state=rng).as_matrix()
    pieces = [piece.moved(turn, np.zeros(3)) for piece in pieces]
    names = list(MATERIALS)
    n_parts = max(piece.part for piece in pieces) + 1
    materials = [names[i] for i in rng.choice(len(names), n_parts)]
    parts = _parts(pieces, rng, inner)
    points, labels = _sampled(pieces, rng, POINTS)
    shades = np.array([MATERIALS[name][1] for name in materials])
    if rng.random() < PLAIN:
        shades[:] = shades[0]
    colours = shades[labels]
    if rng.random() < PRINTED:
        printed = rng.integers(n_parts)
        middle = points[rng.choice(np.flatnonzero(labels == printed))]
        near = np.linalg.norm(points - middle, axis=1) < rng.uniform(0.01, 0.03)
        colours[(labels == printed) & near] = rng.random(3)
    colours = np.clip(colours + rng.normal(scale=COLOUR_NOISE, size=colours.shape), 0, 1)
    return Composite(
        f"{kind.__name__} {seed}",
        points + rng.normal(scale=noise, size=points.shape),
        colours,
        labels,
        _sampled(pieces, rng, DENSE)[0],
        parts,
        np.array([MATERIALS[name][0] for name in materials]),
        tuple(pieces),
    )


def as_benchmark_object(composite: Composite) -> BenchmarkObject:
    """The object in a sensor's grip, moved as one of the workshop tools is."""
    tools = load_tools()
    held = composite.parts.in_frame(np.eye(3), GRIP)
    masses = composite.densities * held.volumes
    return BenchmarkObject(
        composite.name,
        InertialParameters.from_phi(held.unit_phi @ masses),
        np.ptp(held.points, axis=0),
        held.points,
        held.unit_phi,
        held.volumes,
        held.inside,
        tools[len(composite.name) % len(tools)].stop_and_go,
    )


def _sampled(pieces: list[Piece], rng: np.random.Generator, count: int) -> tuple[Array, Indices]:
    """(count, 3) points on the outside, as many per area everywhere, and (count,) their parts."""
    triangles = np.concatenate([piece.triangles for piece in pieces])
    owner = np.repeat(np.arange(len(pieces)), [len(piece.triangles) for piece in pieces])
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-30)[:, None]
    middles = np.array([piece.corners.mean(axis=0) for piece in pieces])[owner]
    normals *= np.sign(np.einsum("ij,ij->i", normals, triangles[:, 0] - middles))[:, None]
    found: list[Array] = []
    parts: list[Indices] = []
    while sum(map(len, parts)) < count:
        chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
        u = np.sort(rng.random((count, 2)), axis=1)
        points = triangles[chosen, 0] + u[:, :1] * edges[chosen, 0] + np.diff(u) * edges[chosen, 1]
        outside = ~np.any([piece.holds(points + SKIN * normals[chosen]) for piece in pieces], axis=0)
        found.append(points[outside])
        parts.append(np.array([piece.part for piece in pieces])[owner[chosen][outside]])
    return np.concatenate(found)[:count], np.concatenate(parts)[:count]


def _parts(pieces: list[Piece], rng: np.random.Generator, inner: int = INNER) -> Parts:
    """The parts' moments from points inside, those of a place that several pieces hold only once."""
    moments, labels = [], []
    for k, piece in enumerate(pieces):
        middle = piece.corners.mean(axis=0)
        volumes = np.abs(np.linalg.det(piece.triangles - middle)) / 6
        chosen = rng.choice(len(volumes), inner, p=volumes / volumes.sum())
        weights = rng.dirichlet(np.ones(4), inner)
        corners = np.insert(piece.triangles[chosen], 0, middle, axis=1)
        points = np.einsum("nk,nkj->nj", weights, corners)
        mine = ~np.any([other.holds(points) for other in pieces[:k]] + [np.zeros(inner, bool)], axis=0)
        homogeneous = np.insert(points[mine], 3, 1.0, axis=1)
        moments.append(volumes.sum() / inner * homogeneous.T @ homogeneous)
        labels.append(piece.part)
    present = [k for k, moment in enumerate(moments) if moment[3, 3] > 0]
    corners = np.concatenate([piece.corners for piece in pieces])
    return Parts.from_moments([moments[k] for k in present], [labels[k] for k in present], corners)
