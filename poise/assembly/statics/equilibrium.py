"""Whether a block stands by itself, and with which contact forces."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, diags_array, eye_array, vstack

from poise.assembly.statics.block import BlockGeometry
from poise.assembly.statics.elimination import Elimination
from poise.assembly.statics.least_forces import least_forces
from poise.assembly.statics.pair_program import PairProgram, PairRows
from poise.assembly.statics.solvers import SOLVER_TOLERANCE, Cones, ConicProgram, Outcome
from poise.errors import ErrorCode, NoAnswerError
from poise.types import Array, Indices

_MARGINAL = 1e-6
"""Margins below this share of the block's weight are 0: as good as rounding lets one know."""

_BALANCED = 1e-10
"""What forces that prove a margin may leave of the loads, in the block's units."""
_FEW = 8
"""Bodies of a block up to which matrices are dense."""
_WEIGHTED, _LEAST_WEIGHT = 4, 1e-3
"""Times that such forces are looked for, each with the normal forces of the last one as weights, of at least this."""


@dataclass(frozen=True, eq=False)
class Standing:
    """How safely a block stands.

    Args:
        margin: the force, in block weights, by which every interface could press less and still hold; 0: on the
            verge of moving; negative: how hard every interface would have to pull.
        twist: (6 n,) the motion that is nearest to happening, or happens.
    """

    margin: float
    twist: Array


def corner_rows(geometry: BlockGeometry, shared: Array, equal: bool) -> PairRows:
    """The rows for which motions open and slide all corners as friction cones allow; see `PairRows` for the rest."""
    forces = geometry.wrenches
    # The scale makes a standard cone of |t| <= mu n, and of its dual.
    scale = np.stack([np.ones_like(geometry.friction), geometry.friction, geometry.friction], axis=1)
    none = np.zeros(len(geometry.supports), dtype=np.int64)
    corners = np.bincount(geometry.interface, minlength=len(none)).astype(np.int64)
    entries = (-scale[:, :, None] * forces).ravel()
    return PairRows(geometry.supports, geometry.count, none, corners, none, 3, entries, shared, equal)


def stability(
    geometry: BlockGeometry,
    load: Array | None = None,
    order: Elimination | None = None,
    tolerance: float = SOLVER_TOLERANCE,
) -> Standing:
    """How safely a block stands under gravity, or under another load (6 n,) in the block's units.

    One SOCP: the largest t for which contact forces in their cones, moved inwards by t / (corners of the interface),
    balance the load. Its dual is the least power needed against gravity by an admissible motion that opens the
    interfaces at a mean rate of 1: the motion nearest to happening.

    Raises:
        NoAnswerError: SOLVER_FAILED.
    """
    load = geometry.gravity.ravel() if load is None else load
    corners = np.bincount(geometry.interface)[geometry.interface]
    spread = np.zeros((len(corners), 3))
    spread[:, 0] = 1 / corners
    opening = (geometry.dense_grasp if geometry.count <= _FEW else geometry.grasp) @ spread.ravel()
    found = PairProgram(corner_rows(geometry, opening, equal=True), tolerance, order).solve(load)
    if found.outcome is Outcome.INFEASIBLE:  # no motion at all: wedged from all sides
        return Standing(np.inf, np.zeros_like(load))
    if found.outcome is Outcome.UNBOUNDED:
        return Standing(-np.inf, found.motion)
    margin = -found.value
    return Standing(0.0 if abs(margin) <= _MARGINAL else margin, found.motion)


@dataclass(frozen=True, eq=False)
class Held:
    """What the contact points of a block show at once, without a conic program.

    Args:
        everywhere: they resist every motion: contact forces of any sign could balance any load.
        margin: the block stands at least this safely, see `Standing`, if any forces that balance count; -inf where
            that is not seen at once.
    """

    everywhere: bool
    margin: float


def held_at_once(geometry: BlockGeometry, enough: float) -> Held:
    """Look for contact forces that balance gravity well inside their cones, in a few weighted least squares.

    The forces found are checked: they prove the margin. Where they are on the edge of their cones, nothing is proven.

    Args:
        geometry: of a block of few bodies.
        enough: the search ends where this margin is proven.
    """
    grasp, load = geometry.dense_grasp, geometry.gravity.ravel()
    left, values, right = np.linalg.svd(grasp, full_matrices=False)
    rounding = values.max(initial=0.0) * max(grasp.shape) * np.finfo(np.float64).eps
    if len(values) < len(load) or values.min() <= rounding:
        return Held(False, -np.inf)
    corners = np.bincount(geometry.interface)[geometry.interface]
    forces = -right.T @ ((left.T @ load) / values)
    best = -np.inf
    for trial in range(_WEIGHTED):
        best = max(best, _margin_of(forces.reshape(-1, 3), grasp @ forces + load, geometry.friction, corners))
        if best >= enough or trial == _WEIGHTED - 1:
            break
        weights = np.repeat(np.maximum(forces[::3], _LEAST_WEIGHT), 3)
        weighted = grasp * weights
        forces = -weights * (grasp.T @ np.linalg.solve(weighted @ grasp.T, load))
    return Held(True, best)


def resists(geometry: BlockGeometry) -> Held:
    """Whether the contact points of a block resist every motion; no margin is looked for."""
    return Held(bool(np.linalg.matrix_rank(geometry.dense_grasp) == 6 * geometry.count), -np.inf)


def _margin_of(forces: Array, left: Array, friction: Array, corners: Indices) -> float:
    """By how much interfaces could press less with forces (K, 3); -inf where they leave more than rounding."""
    if float(np.abs(left).max()) > _BALANCED:
        return -np.inf
    slides = np.sqrt(forces[:, 1] ** 2 + forces[:, 2] ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(slides > 0, slides / friction, 0.0)
    return float(((forces[:, 0] - needed) * corners).min())


def contact_forces(geometry: BlockGeometry, load: Array | None = None, sides: int | None = None) -> Array:
    """Contact forces that balance gravity, or another load, with the least sum of squares (thesis eq. 4.12-4.15).

    Within friction circles by Newton steps, whose forces are checked. By Clarabel where these do not end, and within
    polygons.

    Args:
        geometry: the block.
        load: (6 n,) in the block's units; None: gravity.
        sides: of the polygon that stands for the friction circle (eq. 4.9, 4.10); None: the circle itself.

    Returns:
        (K, 3) normal force and two tangential ones at each point, in block weights.

    Raises:
        NoAnswerError: UNSTABLE when no forces do; SOLVER_FAILED.
    """
    load = geometry.gravity.ravel() if load is None else load
    if sides is None and np.isfinite(load).all() and (found := least_forces(geometry, load)) is not None:
        return found
    size = len(geometry.points)
    balance = geometry.grasp
    if sides is None:
        inside = -diags_array(np.stack([geometry.friction, np.ones(size), np.ones(size)], axis=1).ravel())
        cones = Cones(zero=balance.shape[0], second_order=(3,) * size)
    else:
        inside = block_diag([polygon_rows(mu, sides) for mu in geometry.friction])
        cones = Cones(zero=balance.shape[0], nonnegative=inside.shape[0])
    right = np.concatenate([-load, np.zeros(inside.shape[0])])
    program = ConicProgram(vstack([balance, inside], format="csc"), right, cones, eye_array(3 * size, format="csc"))
    solution = program.solve(np.zeros(3 * size))
    if solution.outcome is not Outcome.SOLVED:
        raise NoAnswerError(ErrorCode.UNSTABLE, "no contact forces keep the objects at rest; see its stability margin")
    return solution.x.reshape(-1, 3)


def polygon_rows(friction: float, sides: int) -> Array:
    """(sides + 1, 3) rows C with C f <= 0: the polygon inscribed in the friction circle (eq. 4.10), and n >= 0."""
    angles = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.full(sides, -friction * np.cos(np.pi / sides)), np.cos(angles), np.sin(angles)], axis=1)
    return np.vstack([circle, [-1.0, 0.0, 0.0]])
