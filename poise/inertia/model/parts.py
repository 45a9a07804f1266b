"""The parts of an object: their volumes and their inertial parameters at 1 kg, from integrals over the shape."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from poise.errors import ErrorCode, InputError
from poise.inertia.model.parameters import frame_change, phi_of_pseudo_inertia, pseudo_inertia
from poise.types import Array

# Cells that a shape is cut into before each is given to a part.
_CELLS = 8000
# Parts whose colours differ by less than this (0..1 in three channels) are likely of one material: correlation of the
# logarithms of their densities.
_SAME_COLOUR, SAME_DENSITY = 0.15, 0.98
# Cut into cells, a closed surface keeps its volume within this share; an open one does not.
_VOLUME_TOLERANCE = 0.1


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of one object, each of homogeneous density (thesis assumption 1), in one frame.

    Args:
        unit_phi: (10, K) inertial parameters of each part at a mass of 1 kg (thesis eq. 3.24).
        volumes: (K,) m3.
        points: (P, 3) m, whose convex hull is the object's.
        likeness: (K, K) correlation that the logarithms of the densities are expected to have, positive definite; None:
            nothing is known.

    Raises:
        InputError: TYPE_MISMATCH when shapes do not belong together, NOT_FINITE for NaN or infinity,
            BAD_INPUT when a volume is not positive.
    """

    unit_phi: Array
    volumes: Array
    points: Array
    likeness: Array | None = None

    def __post_init__(self) -> None:
        n_parts = np.shape(self.volumes)[0] if np.ndim(self.volumes) else 0
        shapes = {"unit_phi": (10, n_parts), "volumes": (n_parts,), "points": (np.shape(self.points)[0], 3)}
        if self.likeness is not None:
            shapes["likeness"] = (n_parts, n_parts)
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape:
                raise InputError(ErrorCode.TYPE_MISMATCH, f"parts: {name} has shape {value.shape}, expected {shape}")
            if not np.all(np.isfinite(value)):
                raise InputError(ErrorCode.NOT_FINITE, f"parts: {name} holds NaN or infinity; repair the shape")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if not n_parts or np.any(self.volumes <= 0):
            raise InputError(ErrorCode.BAD_INPUT, "parts: every part needs a positive volume; drop empty ones")

    def __len__(self) -> int:
        return len(self.volumes)

    @property
    def inside(self) -> Array:
        """(P, 3) m, points spread over the inside: corners of each part's equivalent box, for what wants points."""
        corners = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1)
        places = []
        for phi in self.unit_phi.T:
            moments = pseudo_inertia(phi)
            centre = moments[:3, 3]
            squares, axes = np.linalg.eigh(moments[:3, :3] - np.outer(centre, centre))
            places.append(centre + (axes * np.sqrt(1.8 * squares.clip(min=0.0)) @ corners).T)
        return np.concatenate(places)

    @property
    def homogeneous_phi(self) -> Array:
        """(10,) of the whole at 1 kg, were all parts of one density."""
        return np.asarray(self.unit_phi @ (self.volumes / self.volumes.sum()))

    @property
    def whole(self) -> "Parts":
        """The same shape as a single part."""
        return Parts(self.homogeneous_phi[:, None], np.array([self.volumes.sum()]), self.points)

    def in_frame(self, rotation_new_old: ArrayLike, translation_new_old: ArrayLike) -> "Parts":
        """The same parts seen from another frame: x_new = rotation_new_old @ x_old + translation_new_old."""
        rotation, translation = np.asarray(rotation_new_old), np.asarray(translation_new_old)
        unit_phi = frame_change(rotation, translation) @ self.unit_phi
        return replace(self, unit_phi=unit_phi, points=self.points @ rotation.T + translation)

    @classmethod
    def from_moments(cls, moments: ArrayLike, labels: ArrayLike, points: ArrayLike) -> "Parts":
        """Add up pieces of shape by their part.

        Args:
            moments: (N, 4, 4) pseudo-inertia of each piece at unit density.
            labels: (N,) the part that each belongs to; any integers.
            points: (P, 3) m, whose convex hull is the object's.
        """
        pieces = np.asarray(moments, dtype=np.float64)
        part = np.unique(np.asarray(labels), return_inverse=True)[1]
        totals = np.zeros((part.max() + 1, 4, 4))
        np.add.at(totals, part, pieces)
        phi = np.array([phi_of_pseudo_inertia(total) for total in totals]).T
        return cls(phi / phi[0], phi[0], np.asarray(points))

    @classmethod
    def from_tetrahedra(cls, vertices: ArrayLike, tetrahedra: ArrayLike, labels: ArrayLike | None = None) -> "Parts":
        """Exact parts of a tetrahedral mesh: (V, 3) m, (T, 4) indices, (T,) part of each (one part when None)."""
        from poise.shape import tetrahedron_moments  # slow to import; few payloads come with a shape

        corners = np.asarray(vertices, dtype=np.float64)[np.asarray(tetrahedra)]
        moments = tetrahedron_moments(corners)
        moments *= np.sign(moments[:, 3, 3])[:, None, None]  # either winding is welcome
        return cls.from_moments(moments, np.zeros(len(corners)) if labels is None else labels, vertices)

    @classmethod
    def from_surface(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        labelled_points: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        cells: int = _CELLS,
    ) -> "Parts":
        """Parts of a closed triangle mesh; each place belongs to the part of the nearest labelled point.

        The whole is exact. Between the parts, columns of the shape are cut into cells (see `cells_of`), and the cells
        are then stretched by the one affine map that gives their sum the exact volume, centroid and second moments.

        Args:
            vertices, faces: (V, 3) m and (F, 3) indices, normals outwards.
            labelled_points, labels: (N, 3) m and (N,) integers; None for a single part.
            cells: how finely to cut.

        Raises:
            InputError: MESH_INVALID when the surface is not closed or its normals point inwards.
        """
        corners = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)]
        exact = surface_moments(corners)
        if not np.all(np.linalg.eigvalsh(exact) > 0):
            raise InputError(
                ErrorCode.MESH_INVALID, "shape: the surface encloses no volume; close its holes, turn normals outwards"
            )
        if labelled_points is None or labels is None or len(np.unique(labels)) == 1:
            return cls.from_moments(exact[None], [0], vertices)
        centres, moments = cells_of(corners, (exact[3, 3] / cells) ** (1 / 3))
        share = moments[:, 3, 3].sum() / exact[3, 3]
        if abs(share - 1) > _VOLUME_TOLERANCE:
            raise InputError(
                ErrorCode.MESH_INVALID, f"shape: cut into cells it has {share:.0%} of its volume; close its holes"
            )
        stretch = upper_factor(exact) @ np.linalg.inv(upper_factor(moments.sum(axis=0)))
        nearest = scipy.spatial.cKDTree(np.asarray(labelled_points)).query(centres)[1]
        return cls.from_moments(stretch @ moments @ stretch.T, np.asarray(labels)[nearest], vertices)


def likeness_of_colours(colours: ArrayLike) -> Array | None:
    """(K, K) correlation of the log densities of parts, from their colours (K, 3) 0..1; see `Parts.likeness`.

    None when all are of one colour: if such an object is of several materials it was painted, and its colour says
    nothing about where they are.
    """
    shades = np.asarray(colours, dtype=np.float64)
    apart = np.linalg.norm(shades[:, None] - shades, axis=2)
    if not np.all(np.isfinite(shades)) or apart.max(initial=0.0) < _SAME_COLOUR:
        return None
    alike = SAME_DENSITY * np.exp(-((apart / _SAME_COLOUR) ** 2) / 2)
    return np.asarray(alike + (1 - SAME_DENSITY) * np.eye(len(shades)))


def surface_moments(corners: ArrayLike) -> Array:
    """(4, 4) pseudo-inertia at unit density inside closed triangles (F, 3, 3) m: signed tetrahedra to one point."""
    from poise.shape import tetrahedron_moments  # slow to import; few payloads come with a shape

    triangles = np.asarray(corners, dtype=np.float64)
    apex = np.broadcast_to(triangles.mean(axis=(0, 1)), (len(triangles), 1, 3))
    return np.asarray(tetrahedron_moments(np.concatenate([apex, triangles], axis=1)).sum(axis=0))


def box_moments(centres: ArrayLike, sides: ArrayLike) -> Array:
    """(N, 4, 4) pseudo-inertia at unit density of boxes along the axes: (N, 3) centres, (N, 3) sides, m."""
    centre, side = np.asarray(centres, dtype=np.float64), np.asarray(sides, dtype=np.float64)
    homogeneous = np.concatenate([centre, np.ones((len(centre), 1))], axis=1)
    moments = homogeneous[:, :, None] * homogeneous[:, None, :]
    moments[:, range(3), range(3)] += side**2 / 12
    return np.asarray(side.prod(axis=1)[:, None, None] * moments)


def upper_factor(moments: Array) -> Array:
    """(4, 4) upper triangular U with U U^T = moments, so that U maps homogeneous points affinely (times a scale)."""
    return np.asarray(np.linalg.cholesky(moments[::-1, ::-1])[::-1, ::-1])


def cells_of(corners: Array, size: float) -> tuple[Array, Array]:
    """Cut what closed triangles (F, 3, 3) enclose into boxes of about `size`: (N, 3) centres, (N, 4, 4) moments.

    Columns run along the thinnest direction, where their ends are exact; what lies inside follows from the winding
    number, so that surfaces which overlap themselves do no harm.
    """
    thinnest = int(np.argmin(np.ptp(corners.reshape(-1, 3), axis=0)))
    axes = np.roll(np.arange(3), 2 - thinnest)  # the thinnest last; a rotation, so that normals stay outwards
    column, height, turn, origin, pitch, n_across = _crossings(corners[:, :, axes], size)
    order = np.lexsort((height, column))
    column, height, turn = column[order], height[order], turn[order]
    # Every column of a closed surface ends at winding number zero, so one running sum serves them all.
    inside = (np.cumsum(turn)[:-1] > 0) & (column[1:] == column[:-1])
    bottom, length, column = height[:-1][inside], np.diff(height)[inside], column[:-1][inside]
    pieces = np.maximum(np.rint(length / size).astype(int), 1)
    row = np.repeat(np.arange(len(length)), pieces)
    step = (length / pieces)[row]
    nth = np.arange(len(row)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    centres, sides = np.empty((len(row), 3)), np.empty((len(row), 3))
    across = np.stack([column // n_across, column % n_across], axis=1)[row]
    centres[:, axes[:2]] = origin + pitch * (across + 0.5)
    centres[:, axes[2]] = bottom[row] + step * (nth + 0.5)
    sides[:, axes[:2]] = pitch
    sides[:, axes[2]] = step
    return centres, box_moments(centres, sides)


def _crossings(corners: Array, size: float) -> tuple[NDArray[np.int64], Array, NDArray[np.int64], Array, Array, int]:
    """Where vertical lines on a grid cross triangles: column, height, +1 going in or -1 going out; then the grid."""
    flat = corners[:, :, :2]
    lower, upper = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    counts = np.maximum(np.ceil((upper - lower) / size).astype(int), 1)
    pitch = (upper - lower) / counts
    # A line through an edge would count twice or not at all: leave the middle of the cell by a hair.
    line = lower + pitch * np.array([1.3e-6, 1.7e-6])
    first = np.ceil((flat.min(axis=1) - line) / pitch - 0.5).astype(int).clip(0, counts)
    past = (np.floor((flat.max(axis=1) - line) / pitch - 0.5).astype(int) + 1).clip(0, counts)
    spans = (past - first).clip(min=0)
    candidates = spans.prod(axis=1)
    triangle = np.repeat(np.arange(len(corners)), candidates)
    nth = np.arange(len(triangle)) - np.repeat(np.cumsum(candidates) - candidates, candidates)
    cell = first[triangle] + np.stack(np.divmod(nth, spans[triangle, 1]), axis=1)
    a, b, c = flat[triangle].swapaxes(0, 1)
    offset = line + pitch * (cell + 0.5) - a
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles on edge have no area, and no crossing
        beta, gamma = _cross(offset, c - a) / area, _cross(b - a, offset) / area
        hit = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
    heights = corners[triangle[hit], :, 2]
    weights = np.stack([1 - beta[hit] - gamma[hit], beta[hit], gamma[hit]], axis=1)
    column = cell[hit, 0] * counts[1] + cell[hit, 1]
    turn = -np.sign(area[hit]).astype(np.int64)
    return column, (heights * weights).sum(axis=1), turn, lower, pitch, int(counts[1])


def _cross(first: Array, second: Array) -> Array:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
