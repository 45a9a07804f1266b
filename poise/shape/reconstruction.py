"""From a noisy cloud to a closed solid: carved, smoothed by its own points, and matched to them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from poise.geometry import unique_rows
from poise.shape.carving import Stone, carve
from poise.shape.gaps import without_gaps
from poise.shape.local_noise import local_noise_limit
from poise.shape.matching import matched
from poise.shape.missing import Missing, bare_share, missing_of
from poise.shape.pockets import BURIED, DEEP, depths_below
from poise.shape.solid import Solid, part_moments
from poise.shape.spacing import Spacing, spacing_of
from poise.shape.surface_fit import fitted_heights, local_noise, side_normals
from poise.shape.surface_graph import unit_normals
from poise.shape.thinning import evened, thin
from poise.types import Array, Indices, Mask

_CLOUD, _MOST_POINTS = 12_000, 100_000
"""Points that are fitted, and points that are looked at, at the most."""
_THICK = 0.15
"""Noise over spacing from which on a cloud is a layer: points are picked at random, and averaged."""
_REACH = 2.5
"""Sigmas that a local fit reaches."""
_FEWEST, _MOST = 10, 80
_ROUNDS = 2
_SEEN_POCKETS = 0.4
"""Noise over spacing up to which pockets are looked for before the points are averaged."""
_LEAST_NOISE = 0.02
"""Of the spacing: what a cloud without noise is taken to have."""
_SHOWN, _OVER = 0.1, 1.25
"""Noise over spacing from which on it is compared with what neighbours show; and over the latter, from which on the
surface is wrong, and not the points."""
_FEW, _BLURRED = 1500, 0.4
"""Points below which, and noise over spacing above which, a hollow with thin walls looks like noise: a vase of 500."""
_AGREE = 0.9
"""Share of the points whose given normals point out of the solid, from which on they are used."""
HIDDEN_OFF = 2e-3
"""m that surface is off which a scan completed: 1.0 to 2.7 on the tools of benchmarks/scanning.py."""
_FLOOR, _BY_NOISE, _BY_SPACING, _BY_BALL = 0.012, 0.25, 0.015, 0.7
"""Of `_spread`: fitted so that one in twenty development clouds of benchmarks/solids.py is more than 2 sigma off."""
_BY_INSIDE, _INSIDE = 2.0, 0.03
"""Of `_spread`, too: what points inside add, and the share of them that solid objects may have."""
_BY_MISFIT, _BY_INNER = 0.2, 0.8
"""Of it, too: share of what the points spread about the surface, besides the noise, by which all of it may be off: a
surface that is coarser than the object has points outside of it, and its volume is right; points inside are of inner
faces or walls."""
_BY_HIDDEN, _MOST_HIDDEN = 4.0, 0.5
"""Of `_widened`, chosen on the random things of benchmarks/sweep_objects.py: the factor of the share, and the most."""
_LEAST_KEPT = 0.03
"""Share of its volume and second moments that every part keeps, or its vertices move less."""
_HALVINGS = 6
_FLAT = 1e14
"""Condition of a pseudo-inertia above which it is singular."""
_TINY = 1e-9
_NOTHING_MISSING = Missing()


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A solid, and its draft.

    Args:
        solid: whose surface explains the points; tetrahedra may be inside out.
        carved: the same tetrahedra before the last motion of their vertices, none inside out.
        rows: (V,) the point of the cloud that each vertex was.
        noise: m, one sigma of the points along each axis.
        spacing: m between vertices.
        inside: share of the points that lie deep inside: of the walls of a hollow that no ball enters.
        misfit: m, by which the points spread about the surface, besides the noise: they may lie in layers.
        missing: surface that the points do not show; only `bare` where a scan says what it completed.
        blur: m, noise that the points are too few to distinguish from thin walls; 0 where they are not.
        scanned: whether it says what was seen.
    """

    solid: Solid
    carved: Solid
    rows: Indices
    noise: float
    spacing: float
    inside: float = 0.0
    misfit: float = 0.0
    missing: Missing = _NOTHING_MISSING
    blur: float = 0.0
    scanned: bool = False

    @property
    def layers(self) -> float:
        """How much the points spread about the surface besides the noise, over the noise; 0 for a scan.

        Whether the views of a scan agree was judged when it was made.
        """
        return 0.0 if self.scanned else self.misfit / max(self.noise, _TINY)


def reconstruct(
    points: Array,
    wanted: int,
    noise: float | None = None,
    normals: Array | None = None,
    seen: Mask | None = None,
    doubt: Array | None = None,
    air: Array | None = None,
) -> Reconstruction:
    """The solid whose surface the points show.

    Args:
        points: (N, 3) m, on the whole surface.
        wanted: vertices, about, when there are more points.
        noise: m, one sigma of the points along each axis; None: estimated.
        normals: (N, 3) outward unit normals, where they were measured; they are not used when many point inwards.
        seen: (N,) False where a scan completed the surface.
        doubt: (N,) m, one sigma of where completed surface is, and by which all that was seen may be off in the same
            direction; None: `HIDDEN_OFF`, and 0.
        air: (K, 3) m, places that a scan saw through, on a grid.

    Raises:
        InputError: as `carve`.
    """
    rows = _distinct(points)
    if len(rows) == len(points):
        return _reconstructed(points, wanted, noise, normals, seen, doubt, air)
    normals = None if normals is None else normals[rows]
    seen, doubt = None if seen is None else seen[rows], None if doubt is None else doubt[rows]
    made = _reconstructed(points[rows], wanted, noise, normals, seen, doubt, air)
    return replace(made, rows=rows[made.rows])


def _distinct(points: Array) -> Indices:
    """Rows of points (N, 3), increasing: any `_MOST_POINTS` of a dense cloud, and each place once.

    A point that stands twice is no denser surface, and has nothing behind it.
    """
    rows = np.arange(len(points))
    if len(points) > _MOST_POINTS:
        rows = np.sort(np.random.default_rng(0).choice(len(points), _MOST_POINTS, replace=False))
    return rows[np.sort(unique_rows(points[rows])[0])]


def _reconstructed(
    points: Array,
    wanted: int,
    noise: float | None,
    normals: Array | None,
    seen: Mask | None,
    doubt: Array | None,
    air: Array | None,
) -> Reconstruction:
    """As `reconstruct`, of distinct points."""
    rng = np.random.default_rng(0)
    draft = _drafted(points, thin(points, wanted), noise, normals, rng)
    if draft.noise > _THICK * draft.spacing.usual and len(points) > wanted:
        draft = _drafted(points, np.sort(rng.permutation(len(points))[:wanted]), noise, normals, rng)
    draft = _averaged(draft, points, rng)
    bare = bare_share(draft.carved)
    if air is not None:
        draft = replace(draft, carved=without_gaps(draft.carved, air))
    spacing = draft.spacing.usual
    least = _LEAST_NOISE * spacing
    found = matched(draft.carved, points, max(draft.noise, least), spacing, rng, noise is not None)
    if noise is None and found.noise > _SHOWN * spacing:
        most = max(local_noise_limit(points, np.random.default_rng(0)), least)
        if found.noise > _OVER * most:
            other = matched(draft.carved, points, most, spacing, rng, known=True, rough=found.noise)
            found = replace(found, noise=other.noise, misfit=other.misfit, inwards=other.inwards)
    inside = _inside(draft.carved, DEEP * spacing + BURIED * found.noise)
    if seen is None:
        missing = missing_of(draft.carved, found.solid, found.noise, points, draft.spacing, draft.taken)
    else:
        missing = Missing(bare)
    hidden = 0.0 if seen is None else _hidden(found.solid, draft.rows, seen, doubt)
    hidden = _widened(hidden, max(found.solid.volume, _LEAST_KEPT * draft.carved.volume))
    layers = (_BY_INNER if found.inwards else _BY_MISFIT) * found.misfit * float(found.solid.areas.sum())
    unseen = missing.share * found.solid.volume
    poses = 0.0 if seen is None or doubt is None else _doubtful(found.solid, draft.rows, seen, doubt)
    spread = float(np.linalg.norm([_spread(found.solid, draft, found.noise, inside), hidden, layers, unseen, poses]))
    solid = replace(found.solid, volume_std=spread)
    few = noise is None and seen is None and len(points) < _FEW
    blur = found.noise if few and found.noise > _BLURRED * spacing else 0.0
    known = spacing, inside, found.misfit, missing, blur, seen is not None
    return Reconstruction(solid, draft.carved, draft.rows, found.noise, *known)


def _inside(carved: Solid, depth: float) -> float:
    """Share of the points that the solid contains, farther than a depth, m, from those on its surface."""
    return float(np.mean(depths_below(carved.vertices, carved.tetrahedra, carved.surface[0]) > depth))


@dataclass(frozen=True, eq=False)
class _Draft:
    """A first solid: its points, which way they face, what is known of the noise."""

    carved: Solid
    rows: Indices
    normals: Array
    noise: float
    spacing: Spacing
    taken: int
    """Points that were taken of the cloud, before it was evened."""


def _drafted(
    points: Array, rows: Indices, noise: float | None, given: Array | None, rng: np.random.Generator
) -> _Draft:
    kept, around = evened(points[rows])
    taken, rows = len(rows), rows[kept]
    vertices, spacing = points[rows], around.usual
    stone = Stone(vertices, around)
    carved = stone.carve()
    leaks = carved.between is not None
    measured = None if given is None else _trusted(given[rows], stone.closed() if leaks else carved)
    if leaks and measured is not None:
        carved = stone.carve(normals=measured)
    normals = side_normals(carved, 2 * spacing)
    guess = local_noise(vertices, normals, rng) if noise is None else noise
    if guess < _SEEN_POCKETS * spacing:
        carved = stone.carve(guess, measured)
        normals = side_normals(carved, 2 * spacing)
    return _Draft(carved, rows, normals if measured is None else measured, guess, around, taken)


def _trusted(normals: Array, carved: Solid) -> Array | None:
    """Normals that a file gives, if they are those of the surface, and outward."""
    shown, on_surface = unit_normals(carved)
    agree = np.einsum("ij,ij->i", normals[on_surface], shown[on_surface]) > 0
    return normals if np.mean(agree) > _AGREE else None


def _averaged(draft: _Draft, points: Array, rng: np.random.Generator) -> _Draft:
    """The draft with its vertices on smooth surfaces through all points near them, if there are enough."""
    density = min(len(points), _CLOUD) / len(draft.rows)
    count = np.pi * (_REACH * draft.noise / draft.spacing.usual) ** 2 * density
    if count < _FEWEST / 2 or draft.noise < _THICK * draft.spacing.usual:
        return draft
    vertices = draft.carved.vertices
    cloud = points if len(points) <= _CLOUD else points[rng.permutation(len(points))[:_CLOUD]]
    sides = draft.normals[cKDTree(vertices).query(cloud)[1]]
    asked = int(np.clip(count, _FEWEST, _MOST))
    for _ in range(_ROUNDS):
        heights = fitted_heights((cloud, sides), (vertices, draft.normals), asked)[0]
        vertices = vertices + heights[:, None] * draft.normals
    spacing = spacing_of(vertices)
    carved = carve(vertices, spacing, draft.noise / np.sqrt(asked))
    return replace(draft, carved=carved, spacing=spacing)


def _hidden(solid: Solid, rows: Indices, seen: Mask, doubt: Array | None) -> float:
    """m3, one sigma of the volume, from what a scan completed: all of it may be off in the same direction."""
    return _doubtful(solid, rows, ~seen, np.full(len(seen), HIDDEN_OFF) if doubt is None else doubt)


def _doubtful(solid: Solid, rows: Indices, chosen: Mask, doubt: Array) -> float:
    """m3 that some of the surface's points (N,) may add, which may be off by `doubt` (N,), m, in the same direction."""
    corners = rows[solid.surface[0]]
    most = np.count_nonzero(chosen[corners], axis=1) > 1
    corners, there = corners[most], chosen[corners[most]]
    return float((doubt[corners] * there).sum(axis=1) / np.count_nonzero(there, axis=1) @ solid.areas[most])


def _widened(hidden: float, volume: float) -> float:
    """m3, one sigma from completed surface that adds up to `hidden`.

    Where much is hidden, it is more often a hollow, such as the inside of a mug on its side or the jaws of a clamp,
    and that goes deeper than its edges show.
    """
    return max(hidden, min(hidden * (1 + _BY_HIDDEN * hidden / volume), _MOST_HIDDEN * volume))


def _spread(solid: Solid, draft: _Draft, noise: float, inside: float) -> float:
    """m3, one sigma of the volume: what random clouds of known shapes with noise of five families were off.

    The error grows with the square of noise and of spacing over the thickness, with the share of the volume that
    balls of other radii would carve otherwise, and with the share of the points that lie inside.
    """
    volume, area = max(solid.volume, _LEAST_KEPT * draft.carved.volume), float(solid.areas.sum())
    thickness = volume / area
    shares = [
        _FLOOR,
        _BY_NOISE * (noise / thickness) ** 2,
        _BY_SPACING * (draft.spacing.usual / thickness) ** 2,
        _BY_BALL * draft.carved.volume_std / draft.carved.volume,
        _BY_INSIDE * max(inside - _INSIDE, 0.0),
    ]
    return float(volume * np.linalg.norm(shares))


def guarded(made: Reconstruction, labels: Indices) -> Solid:
    """The solid, in which the motion of vertices is halved, if need be, until no part has been turned inside out.

    Args:
        made: as reconstructed.
        labels: (T,) part of each tetrahedron, 0..P-1.
    """
    moves = made.solid.vertices - made.carved.vertices
    before = part_moments(made.carved, labels)
    thick = np.linalg.cond(before) < _FLAT  # a part of flat tetrahedra has no volume to keep
    kept = np.ones(len(before))
    for _ in range(_HALVINGS):
        found = replace(made.solid, vertices=made.carved.vertices + moves)
        change = np.linalg.solve(before[thick], part_moments(found, labels)[thick])
        kept[thick] = np.linalg.eigvals(change).real.min(axis=1)
        spoilt = ~(kept > _LEAST_KEPT)
        if not spoilt.any():
            return found
        moves[made.carved.tetrahedra[spoilt[labels]]] /= 2
    return replace(made.carved, volume_std=made.solid.volume_std)
