"""Facets of meshes that stand for a round side: the curvature that their neighbours show."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from poise.assembly.contact.placed import triangle_areas
from poise.assembly.scene import Polyhedron
from poise.geometry import unit
from poise.types import Array

_SMOOTH = np.radians(31.0)
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
        radius: m, at the middle.
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
        return FacetCurve(_centre(polyhedron, facet), polyhedron.normals[facet], None, radius, 0.0)
    for first, second in combinations(steps, 2):
        if (found := _belt(polyhedron, facet, first, second)) is not None:
            return found
    return None


def _belt(polyhedron: Polyhedron, facet: int, first: _Step, second: _Step) -> FacetCurve | None:
    """The cylinder or cone around which facets follow each other on both sides of one."""
    if first.axis @ second.axis > _OPPOSITE:
        return None
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
    """m, of the ball that a facet and its neighbours, on all sides, are of; None where they are not."""
    radii = _radii_around(polyhedron, facet, steps)
    if _area(polyhedron, facet) > _WIDER**2 * np.median([_area(polyhedron, step.facet) for step in steps]):
        return None
    for step in steps:
        around, whole = _steps(polyhedron, step.facet)
        if not whole:
            return None
        radii += _radii_around(polyhedron, step.facet, around)
    middle = float(np.median(radii))
    return middle if max(_ratio(radius, middle) for radius in radii) <= _ALIKE else None


def _radii_around(polyhedron: Polyhedron, facet: int, steps: list[_Step]) -> list[float]:
    centre = _centre(polyhedron, facet)
    runs = [float(np.linalg.norm(_centre(polyhedron, step.facet) - centre)) for step in steps]
    return [run / (2 * np.sin(step.angle / 2)) for run, step in zip(runs, steps, strict=True)]


def _ratio(first: float, second: float) -> float:
    return max(first, second) / max(min(first, second), 1e-12)


def _centre(polyhedron: Polyhedron, facet: int) -> Array:
    """(3,) m, centroid of a facet."""
    corners = polyhedron.vertices[polyhedron.facet_triangles[facet]]
    areas = triangle_areas(corners)
    return np.asarray(areas @ corners.mean(axis=1) / areas.sum())


def _area(polyhedron: Polyhedron, facet: int) -> float:
    """m2."""
    return float(triangle_areas(polyhedron.vertices[polyhedron.facet_triangles[facet]]).sum())


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
        outwards = (_centre(polyhedron, other) - edge) @ normal < 0
        if outwards and 0 < angle <= _SMOOTH:
            steps.append(_Step(other, unit(turn), angle, edge))
    return steps, len(steps) == len(np.unique(others)) > 0
