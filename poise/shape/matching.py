"""A surface moved to where clouds drawn from it, with the noise, would lie as the observed points do.

The outermost of noisy points make a carved surface, and even an average over the points of one side is biased where the
surface is curved, or where a plate is not much thicker than the noise. These biases depend on the shape, so they are
not corrected by a formula: points are drawn from the surface itself, with the noise, and the mean distance of the
observed points from each place of the surface is compared with that of the drawn ones (the method of simulated moments,
McFadden 1989). Where both agree the surface is unbiased, however it came about. The noise is found on the way, from
the distances of the points outside: those do not depend on what is on the other side.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from poise.geometry import cross, distinct_numbers, lengths
from poise.kernels import COMPILED, Drawn, matched_places
from poise.shape.solid import Solid
from poise.shape.surface_graph import surface_edges, unit_normals
from poise.types import Array, Indices

_ROUNDS, _THIN_ROUNDS = 8, 5
"""The latter where the noise is less than `_BESIDE`."""
_NOISE_ROUNDS = 6
"""Rounds in which the noise is still corrected."""
_LOOK_AROUND = (0, 2)
"""Rounds in which neighbours are looked for; later, places move by less than their distances."""
_DRAWN, _OBSERVED = 6000, 8000
"""Points drawn from the surface, and observed ones that are asked, at the most."""
_TOGETHER, _NEIGHBOURS = 30, 24
"""Observed points that a place averages over, and vertices that it may take them from."""
_BAND, _SPACINGS = 3.0, 0.2
"""Sigmas and spacings within which a point belongs to the surface; farther inside it shows something else."""
_SMOOTH, _KEEP_SMOOTH = 3, 0.2
"""Rounds of smoothing before, and share of smoothing in each round."""
_NOISE_STEP = (0.5, 1.6)
_GOOD, _THICK_GOOD, _HASTE = 0.4, 0.55, 1.5
"""Quantiles over the places, for noise much below the spacing and as large: where the surface does not fit, points are
farther away than the noise. Points beyond the band are not counted, so the ratio says too little, hence the power."""
_SPREAD_ALIKE = 1.12
"""How much wider observed points may spread about the surface than drawn ones: up to that in clouds with noise of five
families; 1.35 where a third of the points of a hammer lies in a layer under the surface."""
_FLATTER, _LAYERED, _BESIDE = 0.8, 0.75, 0.15
"""Kurtosis of the observed distances over that of the drawn ones below which there are two layers (0.84 and more with
noise of five families, 0.68 with a layer 4 mm inside); the misfit that follows, in sigmas; and the noise over the
spacing below which the surface follows the points, and their distances say nothing."""


_INWARDS = 2.5
"""Standard errors of the skewness from which on points are inside, where noise puts none: of inner faces or walls."""


@dataclass(frozen=True, eq=False)
class Matched:
    """A surface that explains its points.

    Args:
        solid: with its vertices moved.
        noise: m, one sigma of the points.
        statistical: m, one sigma of the mean place of the whole surface, from the number of points.
        misfit: m, by which the points spread about the surface, besides the noise.
        inwards: whether they spread farther inwards than outwards.
    """

    solid: Solid
    noise: float
    statistical: float
    misfit: float
    inwards: bool = False


def matched(
    solid: Solid,
    points: Array,
    noise: float,
    spacing: float,
    rng: np.random.Generator,
    known: bool = False,
    rough: float = 0.0,
) -> Matched:
    """Move the surface of a solid.

    Args:
        solid: with about the right surface.
        points: (N, 3) m, observed.
        noise: m, one sigma along each axis, a first guess.
        spacing: m between vertices.
        rng: draws the points.
        known: the noise is given, and stays.
        rough: m, by which the surface is off, where that is more than the noise.
    """
    observed = points if len(points) <= _OBSERVED else points[rng.permutation(len(points))[:_OBSERVED]]
    triangles, _ = solid.surface
    share = min(1.0, max(noise, rough) / (0.3 * spacing))
    places = solid.vertices
    smoother = _Smoother(solid)
    for _ in range(_SMOOTH):
        places = smoother(places, 0.5 * share)
    corners = places[triangles]
    areas = lengths(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    which = rng.choice(len(triangles), _DRAWN, p=areas / areas.sum())
    drawn = Drawn(which, rng.dirichlet(np.ones(3), _DRAWN), rng.normal(size=(_DRAWN, 3)))
    rounds = _ROUNDS if noise > _BESIDE * spacing else _THIN_ROUNDS
    wider = _SPACINGS + _BAND * max(rough - noise, 0.0) / spacing
    plan = _Plan(rounds, 0 if known else _NOISE_ROUNDS, noise, spacing, _KEEP_SMOOTH * share, wider)
    move = _moved_compiled if COMPILED else _moved
    places, noise, seen, made = move(replace(solid, vertices=places), observed, drawn, plan, smoother)
    misfit = noise * _misfit(seen, made, noise / spacing)
    inwards = misfit > 0 and _skew_inwards(seen, made) > 1.0
    return Matched(replace(solid, vertices=places), noise, noise / np.sqrt(len(points)), misfit, inwards)


@dataclass(frozen=True)
class _Plan:
    """Rounds, those in which the noise is corrected, noise and spacing in m, share of smoothing in each round, and
    spacings by which points may be off besides the noise."""

    rounds: int
    noise_rounds: int
    noise: float
    spacing: float
    smoothing: float
    wider: float


def _moved(
    solid: Solid, observed: Array, drawn: Drawn, plan: _Plan, smoother: "_Smoother"
) -> tuple[Array, float, Array, Array]:
    """Places, noise, and the distances of observed and drawn points that are near, m outwards."""
    triangles, _ = solid.surface
    used, places, noise = distinct_numbers(triangles), solid.vertices, plan.noise
    for number in range(plan.rounds):
        normals = unit_normals(replace(solid, vertices=places))[0][used]
        here = places[used]
        tree = cKDTree(here)
        if number in _LOOK_AROUND:
            near = tree.query(here, k=min(_NEIGHBOURS, len(here)))[1]
        made_of = np.einsum("mk,mki->mi", drawn.within, places[triangles[drawn.which]]) + noise * drawn.errors
        band = _BAND * noise + plan.wider * plan.spacing
        seen, made = (_distances(tree, here, normals, cloud, band) for cloud in (observed, made_of))
        around = _Neighbourhoods(near, normals, seen[0])
        if number < plan.noise_rounds:
            noise *= float(np.clip(_noise_ratio(around, seen, made, noise / plan.spacing), *_NOISE_STEP))
        shift = around.means(*seen) - around.means(*made)
        places = places.copy()
        places[used] += shift[:, None] * normals
        if number < plan.rounds - 1:
            places = smoother(places, plan.smoothing)
    return places, noise, seen[1], made[1]


def _moved_compiled(
    solid: Solid, observed: Array, drawn: Drawn, plan: _Plan, smoother: "_Smoother"
) -> tuple[Array, float, Array, Array]:
    """The same, compiled."""
    triangles, _ = solid.surface
    numbers = {
        **{"rounds": plan.rounds, "noise_rounds": plan.noise_rounds, "second_look": _LOOK_AROUND[1]},
        **{"neighbours": _NEIGHBOURS, "together": _TOGETHER, "noise": plan.noise, "spacing": plan.spacing},
        **{"smooth": plan.smoothing, "band_sigmas": _BAND, "band_spacings": plan.wider, "haste": _HASTE},
        **{"least_step": _NOISE_STEP[0], "most_step": _NOISE_STEP[1], "good": _GOOD, "thick_good": _THICK_GOOD},
    }
    return matched_places(solid.vertices, triangles, smoother.edges, drawn, observed, numbers)


def _misfit(seen: Array, made: Array, thickness: float) -> float:
    """How much wider, in sigmas, observed distances from the surface are than drawn ones, or lie in layers."""
    if not len(seen) or not len(made) or not seen.std() * made.std() > 0:
        return 0.0
    wider = float(np.sqrt(max(seen.var() / made.var() - _SPREAD_ALIKE**2, 0.0)))
    observed, drawn = (float(np.mean((of - of.mean()) ** 4) / of.var() ** 2) for of in (seen, made))
    if not thickness > _BESIDE:
        return wider
    layered = _LAYERED if observed < _FLATTER * drawn else 0.0
    return max(wider, layered, _inwards(seen, made))


def _inwards(seen: Array, made: Array) -> float:
    """By how much more the observed distances have a tail inwards than the drawn ones, in skewness; 0 by chance."""
    errors = _skew_inwards(seen, made)
    return errors * _skew_by_chance(seen, made) if errors > _INWARDS else 0.0


def _skew_inwards(seen: Array, made: Array) -> float:
    """The same in standard errors; negative where the observed ones have more of a tail outwards."""
    one, other = (float(np.mean((of - of.mean()) ** 3) / of.std() ** 3) for of in (made, seen))
    return (one - other) / _skew_by_chance(seen, made)


def _skew_by_chance(seen: Array, made: Array) -> float:
    """One standard error of the difference of skewness."""
    return float(np.sqrt(6 / len(seen) + 6 / len(made)))


class _Smoother:
    """Moves the vertices of a surface towards the middle of their neighbours."""

    def __init__(self, solid: Solid) -> None:
        edges = surface_edges(solid)
        self.edges = np.concatenate([edges, edges[:, ::-1]])
        self._degree = np.bincount(self.edges[:, 0], minlength=len(solid.vertices))

    def __call__(self, places: Array, share: float) -> Array:
        start, end = self.edges.T
        sums = np.stack([np.bincount(start, places[end, axis], len(places)) for axis in range(3)], axis=1)
        middles = sums / np.maximum(self._degree, 1)[:, None]
        return np.where(self._degree[:, None] > 0, places + share * (middles - places), places)


def _distances(tree: cKDTree, here: Array, normals: Array, cloud: Array, band: float) -> tuple[Indices, Array]:
    """Of the points near the surface: the nearest place of each, and m outwards from it."""
    nearest = tree.query(cloud)[1]
    out = np.einsum("ij,ij->i", cloud - here[nearest], normals[nearest])
    near = np.abs(out) < band
    return nearest[near], out[near]


class _Neighbourhoods:
    """Averages over the points of the same side around each place: the nearest that are enough together."""

    def __init__(self, near: Indices, normals: Array, observed: Indices) -> None:
        self._count, self._near = len(near), near
        alike = np.maximum(np.einsum("uki,ui->uk", normals[self._near], normals), 0) ** 2
        own = alike * np.bincount(observed, minlength=self._count)[self._near]
        self._weights = alike * (np.cumsum(own, axis=1) - own < _TOGETHER)

    def means(self, place: Indices, values: Array) -> Array:
        """(U,) of values (P,) at the nearest places (P,); 0 where there are none."""
        sums, numbers = np.bincount(place, values, self._count), np.bincount(place, minlength=self._count)
        total = (self._weights * numbers[self._near]).sum(axis=1)
        return np.asarray((self._weights * sums[self._near]).sum(axis=1) / np.maximum(total, 1e-9))


def _noise_ratio(
    around: _Neighbourhoods, seen: tuple[Indices, Array], made: tuple[Indices, Array], thickness: float
) -> float:
    """How much farther out the observed points lie than the drawn ones, of those outside, where the fit is good."""
    distances = []
    for place, out in (seen, made):
        outside = out > 0
        distances.append(around.means(place[outside], out[outside]))
    known = (distances[0] > 0) & (distances[1] > 0)
    if not np.any(known):
        return 1.0
    good = _GOOD + (_THICK_GOOD - _GOOD) * min(thickness, 1.0)
    return float(np.quantile(distances[0][known] / distances[1][known], good) ** _HASTE)
