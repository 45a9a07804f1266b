"""The planar patches of a scanned surface: which of its points lie in one plane, up to their noise."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from poise.types import Array, Indices, Mask

_SEEDS = 160
"""Points at which planes are tried."""
_AROUND = 0.008
"""m around a seed to which its first plane is fitted."""
_ALIKE = 0.6
"""Cosine between the normal of a point and that of its patch, at least."""
_ROUNDS, _TRIED = 6, 4
_NEIGHBOURS = 14
"""Points that give the normal of one, and those to which it is linked."""
_JOINED = 0.004
"""m between neighbours of one patch, at most."""


class SurfaceSamples(NamedTuple):
    """Points on a closed surface.

    Args:
        points: (N, 3) m.
        normals: (N, 3) outwards, unit vectors.
        areas: (N,) m2 of the surface that each stands for.
        noise: (N,) m that each may be off the surface.
        links: (N, N) which points are neighbours.
    """

    points: Array
    normals: Array
    areas: Array
    noise: Array
    links: coo_array

    @classmethod
    def of(cls, points: Array, outwards: Array, noise: Array) -> "SurfaceSamples":
        """Of points (N, 3) m with noise (N,) m, and directions (N, 3) that point about outwards."""
        count = min(_NEIGHBOURS, len(points))
        distance, near = cKDTree(points).query(points, k=count)
        apart = points[near] - points[near].mean(axis=1, keepdims=True)
        normals = np.linalg.eigh(np.einsum("nki,nkj->nij", apart, apart))[1][:, :, 0]
        normals *= np.where(np.einsum("ni,ni->n", normals, outwards) < 0, -1.0, 1.0)[:, None]
        areas = np.pi * distance[:, -1] ** 2 / count
        linked = distance < _JOINED
        rows = np.repeat(np.arange(len(points)), count).reshape(near.shape)[linked]
        links = coo_array((np.ones(len(rows)), (rows, near[linked])), shape=(len(points), len(points)))
        return cls(points, normals, areas, noise, links)

    def near(self, normals: Array, offsets: Array) -> Mask:
        """(P, N) which points lie in planes with normals (P, 3) and offsets (P,) m, and face as they do."""
        apart = np.abs(normals @ self.points.T - offsets[:, None]) < self.noise
        return np.asarray(apart & (normals @ self.normals.T > _ALIKE))

    def plane(self, rows: Indices, outwards: Array) -> tuple[Array, float]:
        """Normal (3,) and offset, m, of the plane of least squares through points; they count by area and noise."""
        weights = self.areas[rows] / self.noise[rows] ** 2
        weights /= weights.sum()
        middle = weights @ self.points[rows]
        apart = self.points[rows] - middle
        normal = np.linalg.eigh((apart * weights[:, None]).T @ apart)[1][:, 0] if len(rows) >= 3 else outwards
        normal = normal if normal @ outwards > 0 else -normal
        return normal, float(normal @ middle)

    def largest(self, chosen: Mask) -> Indices:
        """The connected piece of the chosen points that has the largest area."""
        rows = np.flatnonzero(chosen)
        number = np.full(len(chosen), -1)
        number[rows] = np.arange(len(rows))
        first, second = number[self.links.coords[0]], number[self.links.coords[1]]
        both = (first >= 0) & (second >= 0)
        graph = coo_array((np.ones(both.sum()), (first[both], second[both])), shape=(len(rows), len(rows)))
        count, labels = connected_components(graph, directed=False)
        if not count:
            return rows
        return np.asarray(rows[labels == np.argmax(np.bincount(labels, self.areas[rows]))])


class Patch(NamedTuple):
    """Points near one plane, normal . x = offset.

    Args:
        normal: (3,) outwards.
        offset: m.
        rows: (n,) their numbers.
    """

    normal: Array
    offset: float
    rows: Indices


def planar_patches(samples: SurfaceSamples, least: float, seed: int = 0) -> list[Patch]:
    """The patches, the largest first.

    Planes are fitted around random seeds; the one with the largest connected patch is taken, again and again (after
    Schnabel, Wahl and Klein 2007). Then each point goes to the plane that suits it best (Cohen-Steiner, Alliez and
    Desbrun 2004). A curved surface becomes patches from which it departs by the noise.

    Args:
        samples: the surface.
        least: m2 of a patch.
        seed: of the places at which planes are tried.
    """
    normals, offsets = _first_planes(samples, np.random.default_rng(seed))
    near = samples.near(normals, offsets)
    free = samples.areas > 0
    planes: list[tuple[Array, float]] = []
    while True:
        scores = near @ np.where(free, samples.areas, 0.0)
        tried = np.argsort(scores)[::-1][:_TRIED]
        found = [_grown(samples, normals[k], float(offsets[k]), free) for k in tried if scores[k] > least]
        best = max(found, key=lambda patch: float(samples.areas[patch.rows].sum()), default=None)
        if best is None or samples.areas[best.rows].sum() < least:
            break
        planes.append((best.normal, best.offset))
        free[best.rows] = False
    patches = [patch for patch in _shared_out(samples, planes) if samples.areas[patch.rows].sum() >= least]
    return sorted(patches, key=lambda patch: -float(samples.areas[patch.rows].sum()))


def _first_planes(samples: SurfaceSamples, rng: np.random.Generator) -> tuple[Array, Array]:
    """Normals (S, 3) and offsets (S,) m of planes around points that are drawn by area."""
    count = min(_SEEDS, len(samples.areas))
    seeds = rng.choice(len(samples.areas), count, replace=False, p=samples.areas / samples.areas.sum())
    around = cKDTree(samples.points).query_ball_point(samples.points[seeds], _AROUND)
    planes = []
    for number, near in zip(seeds.tolist(), around, strict=True):
        rows = np.array(near)
        rows = rows[samples.normals[rows] @ samples.normals[number] > _ALIKE]
        planes.append(samples.plane(rows, samples.normals[number]))
    return np.array([normal for normal, _ in planes]), np.array([offset for _, offset in planes])


def _grown(samples: SurfaceSamples, normal: Array, offset: float, free: Mask) -> Patch:
    """The largest connected patch along a plane, which is fitted to it until the patch does not change."""
    rows: Indices = np.zeros(0, dtype=np.int64)
    for _ in range(_ROUNDS):
        new = samples.largest(samples.near(normal[None], np.array([offset]))[0] & free)
        if not len(new) or np.array_equal(new, rows):
            break
        rows = new
        normal, offset = samples.plane(rows, normal)
    return Patch(normal, offset, rows)


def _shared_out(samples: SurfaceSamples, planes: list[tuple[Array, float]]) -> list[Patch]:
    """Each point in the patch whose plane is nearest in place and direction; then the planes fitted to these."""
    patches: list[Patch] = []
    for _ in range(2):
        normals = np.array([normal for normal, _ in planes]).reshape(-1, 3)
        offsets = np.array([offset for _, offset in planes])
        apart = np.abs(normals @ samples.points.T - offsets[:, None]) / samples.noise
        cost = apart + (1 - normals @ samples.normals.T) / (1 - _ALIKE)
        cost = np.where(samples.near(normals, offsets), cost, np.inf)
        patches = []
        for number, (normal, offset) in enumerate(planes):
            own = np.isfinite(cost[number]) & (cost[number] <= cost.min(axis=0))
            rows = samples.largest(own)
            patches.append(Patch(*(samples.plane(rows, normal) if len(rows) >= 3 else (normal, offset)), rows))
        planes = [(patch.normal, patch.offset) for patch in patches]
    return patches
