"""What is true of objects that are segmented: labelled clouds, surfaces, and how near a mesh of a cloud can come."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from poise.shape.carving import carve
from poise.shape.metrics import scaled_distances, scaled_hausdorff
from poise.shape.solid import FACES, Solid
from poise.types import Array, Indices, Mask

SHIPPED = Path(__file__).resolve().parent / "data" / "workshop_clouds.npz"
NOISE = 3e-4  # m, of the resampled clouds
SAMPLES, SEEN = 100_000, 20_000
PROBES = 12  # per tetrahedron, to test whether it is inside


class Subject(Protocol):
    """An object to segment.

    Args:
        points, colours, labels: (N, 3) m, (N, 3) 0..1 and (N,) true parts.
        volume: m3.
    """

    name: str
    points: Array
    colours: Array
    labels: Indices

    @property
    def volume(self) -> float: ...

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 3) m of its surface."""


@dataclass(frozen=True, eq=False)
class ToolCloud:
    """A tool of tools/convert_workshop_clouds.py, which says what the arrays are."""

    name: str
    points: Array
    colours: Array
    labels: Indices
    vertices: Array
    triangles: Indices
    volume: float

    def surface(self, rng: np.random.Generator, count: int) -> Array:
        return sample(self.vertices, self.triangles, rng, count)


class Reference:
    """The true surface of one object, sampled once.

    Args:
        everything: (`SAMPLES`, 3) m of all of it, with gaps between parts and hollows that no camera sees.
        outer: (`SAMPLES`, 3) m of what a ball can touch from outside: the solid carved from `SEEN` of its points.
    """

    def __init__(self, subject: Subject) -> None:
        rng = np.random.default_rng(0)
        self.everything = subject.surface(rng, SAMPLES)
        self._seen = carve(subject.surface(rng, SEEN))
        self.outer = sample(self._seen.vertices, self._seen.surface[0], rng, SAMPLES)

    @cached_property
    def _cells(self) -> tuple[Delaunay, Mask]:
        """All tetrahedra of the seen points, and which of them are inside; outside of them all is the last."""
        delaunay = Delaunay(self._seen.vertices - self._seen.vertices.mean(axis=0))
        inside = {tuple(sorted(cell)) for cell in self._seen.tetrahedra.tolist()}
        return delaunay, np.array([tuple(sorted(cell)) in inside for cell in delaunay.simplices.tolist()] + [False])

    def floor(self, points: Array) -> float:
        """Hausdorff distance, in diagonals, of the solid of Delaunay tetrahedra of (N, 3) points that knows the truth.

        A tetrahedron is kept when more than half of it is inside. No way of carving these points decides better.
        """
        cells, inside = self._cells
        delaunay = Delaunay(points)
        weights = np.random.default_rng(1).dirichlet(np.ones(4), PROBES)
        probes = np.einsum("sk,tkj->tsj", weights, points[delaunay.simplices]) - self._seen.vertices.mean(axis=0)
        share = inside[cells.find_simplex(probes.reshape(-1, 3))].reshape(-1, PROBES).mean(axis=1)
        kept = np.append(share > 0.5, False)
        owner, corner = np.nonzero(kept[:-1, None] & ~kept[delaunay.neighbors])
        triangles = np.take_along_axis(delaunay.simplices[owner], FACES[corner], axis=1)
        rebuilt = sample(points, triangles.astype(np.int64), np.random.default_rng(2), SAMPLES)
        return scaled_hausdorff(rebuilt, self.outer)

    def compare(self, solid: Solid) -> tuple[float, float, float]:
        """Hausdorff distance and mean distance to what is seen, Hausdorff distance to everything, in diagonals."""
        rebuilt = sample(solid.vertices, solid.surface[0], np.random.default_rng(2), SAMPLES)
        return *scaled_distances(rebuilt, self.outer), scaled_hausdorff(rebuilt, self.everything)


def load_clouds(source: Path = SHIPPED) -> list[ToolCloud]:
    """The tools of an .npz, by name."""
    with np.load(source, allow_pickle=False) as file:
        names = sorted({key.split("/")[0] for key in file.files})
        return [
            ToolCloud(
                name,
                file[f"{name}/points"].astype(np.float64),
                file[f"{name}/colours"] / 255.0,
                file[f"{name}/labels"].astype(np.int64),
                file[f"{name}/vertices"].astype(np.float64),
                file[f"{name}/triangles"].astype(np.int64),
                float(file[f"{name}/volume"]),
            )
            for name in names
        ]


def sample(vertices: Array, triangles: Indices, rng: np.random.Generator, count: int) -> Array:
    """(count, 3) points on triangles, as many per area everywhere."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]


def resampled(tool: ToolCloud, seed: int) -> ToolCloud:
    """Another cloud of the same tool: other points, with noise; colours and labels of the nearest point."""
    rng = np.random.default_rng([seed, *tool.name.encode()])
    clean = tool.surface(rng, len(tool.points))
    nearest = cKDTree(tool.points).query(clean)[1]
    noisy = clean + rng.normal(scale=NOISE, size=clean.shape)
    return replace(tool, points=noisy, colours=tool.colours[nearest], labels=tool.labels[nearest])
