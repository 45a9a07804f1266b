"""Facets of meshes that stand for a round side: the curvature that their neighbours show."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from poise.assembly.scene import Polyhedron
from poise.geometry import plane_axes, unit
from poise.types import Array

SMOOTH = np.radians(31.0)
"""Facets that meet at most at this angle may be of one round side: prisms of 12 sides and more."""
_ALIKE = 1.8
"""Ratio of radii that neighbouring facets of one round side may show."""
_OPPOSITE, _ALONG = -0.8, 0.8
"""Cosines between the axes about which the normal turns towards two neighbours: on either side of a facet, on one."""
_LEAST_FACETS = 12
_WIDER = 2.5
"""Times as wide as the next facets: a flat base, or a flat on a round bar."""


@dataclass(frozen=True, eq=False)
class FacetCurve:
    """The round side that a facet stands for, in the object frame.

    Args:
        middle: (3,) m, on the facet.
        normal: (3,) outwards.
        along: (3,) unit vector in which it is straight, as on cylinders and cones; None: it is round every way.
        radius: m, at the middle; the lesser one where it is not equally round every way.
        slope: by which the radius grows along it, m per m.
    """

    middle: Array
    normal: Array
    along: Array | None
    radius: float
    slope: float


@dataclass(frozen=True, eq=False)
class _Step:
    """From a facet over an edge to a neighbour, across which the surface turns a little, outwards.

    Args:
        facet: the neighbour.
        axis: (3,) unit vector about which the normal turns.
        angle: rad.
        edge: (3,) middle of the edge.
    """

    facet: int
    axis: Array
    angle: float
    edge: Array


@lru_cache(maxsize=4096)
def facet_curve(polyhedron: Polyhedron, facet: int) -> FacetCurve | None:
    """The round side that a facet stands for; None where it is a flat side.

    A facet is of a round side when it turns by a few degrees into the next facets on both sides, and these into the
    next again, all with the same radius, and when it is not much wider than these: a base, and a side beside a fillet,
    are flat. Polygons of fewer than 12 sides are flat.
    """
    if len(polyhedron.normals) < _LEAST_FACETS:
        return None
    steps, whole = _steps(polyhedron, facet)
    if whole and (radius := _ball_radius(polyhedron, facet, steps)) is not None:
        return FacetCurve(polyhedron.facet_centres[facet], polyhedron.normals[facet], None, radius, 0.0)
    for first, second in _opposite(polyhedron, steps):
        if (found := _belt(polyhedron, facet, first, second)) is not None:
            return found
    return None


def _opposite(polyhedron: Polyhedron, steps: list[_Step]) -> list[tuple[_Step, _Step]]:
    """Pairs of steps to either side of a facet that is not too wide for a belt between these neighbours.

    A base has hundreds of neighbours, and nearly all pairs of them differ by width alone.
    """
    axes, middles = np.array([step.axis for step in steps]), np.array([step.edge for step in steps])
    reach = np.array([_extent(polyhedron, step.facet) for step in steps])
    pairs = []
    for k, first in enumerate(steps[:-1]):
        rest = slice(k + 1, None)
        along = unit(first.axis - axes[rest])
        across = first.edge - middles[rest]
        across -= np.einsum("ij,ij->i", across, along)[:, None] * along
        wide = np.linalg.norm(across, axis=1) > _WIDER * np.minimum(reach[k], reach[rest])
        found = np.flatnonzero(~wide & (axes[rest] @ first.axis <= _OPPOSITE)) + k + 1
        pairs += [(first, steps[other]) for other in found.tolist()]
    return pairs


def _belt(polyhedron: Polyhedron, facet: int, first: _Step, second: _Step) -> FacetCurve | None:
    """The cylinder or cone around which facets follow each other on both sides of one, by steps to either side."""
    width, radius = _chord(first, second)
    for step in (first, second):
        back = _Step(facet, -step.axis, step.angle, step.edge)
        onward = [each for each in _steps(polyhedron, step.facet)[0] if each.axis @ step.axis > _ALONG]
        chords = [_chord(each, back) for each in onward]
        if not any(width <= _WIDER * w and _ratio(r, radius) <= _ALIKE for w, r in chords):
            return None
    across = first.edge - second.edge
    along = unit(first.axis - second.axis)
    across -= across @ along * along
    slope = float((first.axis + second.axis) @ unit(across)) / (2 * np.sin((first.angle + second.angle) / 4))
    return FacetCurve((first.edge + second.edge) / 2, polyhedron.normals[facet], along, radius, slope)


def _chord(first: _Step, second: _Step) -> tuple[float, float]:
    """m, width of a facet between two edges, and radius of the circle of which it is a chord."""
    along = unit(first.axis - second.axis)
    across = first.edge - second.edge
    width = float(np.linalg.norm(across - across @ along * along))
    return width, width / (2 * np.sin((first.angle + second.angle) / 4))


def _ball_radius(polyhedron: Polyhedron, facet: int, steps: list[_Step]) -> float | None:
    """m, of the ball or egg that a facet and its neighbours, on all sides, are of; None where they are not."""
    areas = polyhedron.facet_areas
    if areas[facet] > _WIDER**2 * np.median(areas[[step.facet for step in steps]]):
        return None
    runs = _runs_around(polyhedron, facet, steps)
    for step in steps:
        around, whole = _steps(polyhedron, step.facet)
        if not whole:
            return None
        runs += _runs_around(polyhedron, step.facet, around)
    radii = [radius for _, radius in runs]
    middle = float(np.median(radii))
    if max(_ratio(radius, middle) for radius in radii) <= _ALIKE:
        return middle
    return _egg_radius(polyhedron.normals[facet], np.array([run for run, _ in runs]), np.array(radii))


def _egg_radius(normal: Array, runs: Array, radii: Array) -> float | None:
    """m, the lesser radius of a side that is round, but not equally in all directions; None where it is not.

    Curvature in the direction d is d K d (Euler), with K of the facet and its neighbours. A body on such a side falls,
    rolls or rocks first in the direction of the lesser radius.
    """
    along = unit(runs @ plane_axes(normal).T)
    square = np.stack([along[:, 0] ** 2, 2 * along[:, 0] * along[:, 1], along[:, 1] ** 2], axis=1)
    (a, b, c), *_ = np.linalg.lstsq(square, 1 / radii, rcond=None)
    low, high = np.linalg.eigvalsh(np.array([[a, b], [b, c]]))
    if low <= 0:
        return None
    fitted = square @ [a, b, c] * radii
    return float(1 / high) if max(fitted.max(), 1 / fitted.min()) <= _ALIKE else None


def _runs_around(polyhedron: Polyhedron, facet: int, steps: list[_Step]) -> list[tuple[Array, float]]:
    """To each neighbour: from middle to middle, (3,) m, and the radius of the circle of which that is a chord."""
    runs = [polyhedron.facet_centres[step.facet] - polyhedron.facet_centres[facet] for step in steps]
    return [
        (run, float(np.linalg.norm(run)) / (2 * np.sin(step.angle / 2))) for run, step in zip(runs, steps, strict=True)
    ]


def _ratio(first: float, second: float) -> float:
    return max(first, second) / max(min(first, second), 1e-12)


def _extent(polyhedron: Polyhedron, facet: int) -> float:
    """m, diagonal of the bounds of a facet: no chord across it is longer."""
    return float(np.linalg.norm(np.ptp(polyhedron.vertices[polyhedron.facet_vertices[facet]], axis=0)))


@lru_cache(maxsize=65_536)
def _steps(polyhedron: Polyhedron, facet: int) -> tuple[list[_Step], bool]:
    """Over all edges at which a facet turns outwards by little, and whether these are all its edges."""
    rows = np.flatnonzero((polyhedron.edge_facets == facet).any(axis=1))
    others = polyhedron.edge_facets[rows].sum(axis=1) - facet
    normal, steps = polyhedron.normals[facet], []
    for other in np.unique(others).tolist():
        turn = np.cross(normal, polyhedron.normals[other])
        angle = float(np.arctan2(np.linalg.norm(turn), normal @ polyhedron.normals[other]))
        ends = polyhedron.vertices[polyhedron.edges[rows[others == other]]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        edge = lengths @ ends.mean(axis=1) / lengths.sum()
        outwards = (polyhedron.facet_centres[other] - edge) @ normal < 0
        if outwards and 0 < angle <= SMOOTH:
            steps.append(_Step(other, unit(turn), angle, edge))
    return steps, len(steps) == len(np.unique(others)) > 0
