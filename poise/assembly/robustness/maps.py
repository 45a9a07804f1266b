"""Certified maps: how hard each point of the surface may be pushed, between bounds that meet a tolerance."""

import time
from dataclasses import dataclass

import numpy as np

from poise.assembly.contact import SurfacePoints, sample_surface
from poise.assembly.robustness.elastic_maps import confirm_map
from poise.assembly.robustness.map_regions import Bounds, Pool, bound_block, chunks
from poise.assembly.robustness.registry import DEFAULT_MODEL, ROBUSTNESS_MODELS
from poise.assembly.scene import Assembly
from poise.assembly.statics import NO_DEADLINE, Analysis, BlockAnalysis, Deadline, Mechanism
from poise.errors import ErrorCode, InputError
from poise.geometry import wrench_of_force
from poise.ranges import check_range
from poise.threads import in_one_thread
from poise.types import Array, Indices, Mask

_CEILING = 100.0
"""Points that hold this many weights of the assembly are strong enough: larger robustness is not resolved."""
MAX_MAP_POINTS = 1_000_000
"""Points of one map: more would take minutes and gigabytes."""
_LESS = 0.6
"""Share of the tolerance that limit analysis may be below a patch's answer without being asked."""
_FOR_EVER = 1e-5
"""Inverse load factors below this, per weight of the assembly, count as 0; maps are solved to a tenth of it."""


@dataclass(frozen=True, eq=False)
class RobustnessMap:
    """How hard points of the surface may be pushed.

    Args:
        analysis: of the assembly.
        surface: where, and along which direction.
        lower, upper: (N,) N; certified by the model. The upper bound is what the best mechanism found allows.
        block: (N,) number in `analysis.blocks` of the block that collapses at the upper bound; -1 for none.
        mechanism: (N,) its number in `mechanisms`; -1 for none, or when a patch alone collapses (see `assess`).
        mechanisms: collapse mechanisms; each bounds the robustness of every point from above.
        doubtful: (N,) contact forces have a choice here, and elastic contacts did not confirm the bounds to the
            tolerance: they withstand less at points nearby, or were not asked in time. `lower` is then what they
            withstand around the point, or 0. Models other than `default` never ask them, and `lower` is their own.
        complete: the bounds meet the tolerance everywhere; otherwise the deadline passed before.
        solves: conic programs solved.
        seconds: taken.
    """

    analysis: Analysis
    surface: SurfacePoints
    lower: Array
    upper: Array
    block: Indices
    mechanism: Indices
    mechanisms: tuple[Mechanism, ...]
    doubtful: Mask
    complete: bool
    solves: int
    seconds: float

    def moves(self, point: int) -> tuple[str, ...]:
        """Ids of what moves first when one point is pushed at its upper bound."""
        objects = self.analysis.assembly.objects
        if self.mechanism[point] >= 0:
            places = tuple(self.mechanisms[self.mechanism[point]].places)
        elif self.block[point] >= 0:
            places = self.analysis.blocks[self.block[point]].block.members[0]
        else:
            places = ()
        return tuple(objects[place].id for place in places)


@in_one_thread
def robustness_map(
    assembly: Assembly | Analysis,
    surface: SurfacePoints | int = 10_000,
    tolerance: float = 0.03,
    model: str | None = None,
    deadline: float | None = None,
) -> RobustnessMap:
    """Bound the robustness of many points of the surface, with few solved exactly.

    1 / robustness is a convex function of the load. On a flat face with one direction of push the load is affine in
    the point: solved points bound all between them from above by convexity, and every collapse mechanism found
    bounds all points, directions and objects from below. Points are solved where the bounds are farthest apart.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        surface: points and directions of push, or how many to spread over the surface (pushes inward along the normal).
        tolerance: the bounds are brought to upper <= (1 + tolerance) lower, except above `_CEILING` weights.
        model: limit, patch, or default (the weaker of both). Under `patch`, bodies on several interfaces have their
            centres of pressure where they are at rest.
        deadline: s; what is certified by then is returned, with bounds 0 and inf for the rest.

    Raises:
        InputError: BAD_INPUT for a model without certified bounds, or for no points or more than `MAX_MAP_POINTS`;
            EMPTY when points are asked for and all objects are fixed; INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    start, clock, name = time.perf_counter(), Deadline.after(deadline), model or DEFAULT_MODEL
    if not isinstance(surface, int | SurfacePoints):
        raise InputError(ErrorCode.BAD_INPUT, f"surface is {surface!r:.80}: give a number of points, or SurfacePoints")
    check_range("map_tolerance", tolerance)
    _check_request(name, surface if isinstance(surface, int) else len(surface.points))
    analysis = Analysis.of(assembly, deadline=clock)
    stands = not analysis.require_stable(clock).doubtful
    if isinstance(surface, int):
        surface = sample_surface(analysis.structure, surface)
    bounds, complete, doubtful = _bounded(analysis, surface, tolerance, name, clock)
    if not stands:
        bounds.upper[:], doubtful[:], complete = np.inf, True, False
    smallest = _FOR_EVER / _weight(analysis)
    with np.errstate(divide="ignore"):
        lower, upper = (1 / np.where(bound > smallest, bound, 0.0) for bound in (bounds.upper, bounds.lower))
    mechanisms, seconds = tuple(bounds.mechanisms), time.perf_counter() - start
    known = lower, upper, bounds.block, bounds.mechanism, mechanisms
    return RobustnessMap(analysis, surface, *known, doubtful, complete, bounds.solves, seconds)


def rough_robustness(analysis: Analysis, surface: SurfacePoints, tolerance: float) -> Array:
    """(N,) N, about how hard points may be pushed, to choose among them; inf above `_CEILING` weights.

    Nothing is certified.

    Of a body on one interface what uniform pressure holds, in closed form; of others what limit analysis holds at
    least, bounded to a tolerance.

    Raises:
        NoAnswerError: SOLVER_FAILED.
    """
    bounds, wrenches = Bounds.none(len(surface.points)), wrench_of_force(surface.directions, surface.points)
    floor = 1 / (_CEILING * _weight(analysis))
    for number, block in enumerate(analysis.blocks):
        rows = np.flatnonzero(block.bodies_of(surface.place) >= 0)
        if block.solvers.single_patch is None:
            pool = Pool(block, number, bounds, NO_DEADLINE, with_limit=True, with_patch=False)
            bound_block(pool, surface, rows, wrenches, tolerance, floor)
        else:
            _single_patch(block, number, rows, wrenches, bounds, np.inf, NO_DEADLINE)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.where(bounds.upper > floor, bounds.upper, 0.0))


def _check_request(model: str, count: int) -> None:
    if not ROBUSTNESS_MODELS.find(model).maps:
        raise InputError(ErrorCode.BAD_INPUT, f"maps are certified for limit, patch and default, not for {model!r}")
    if count < 1:
        raise InputError(ErrorCode.BAD_INPUT, f"a map of {count} points shows nothing; ask for at least one")
    if count > MAX_MAP_POINTS:
        raise InputError(ErrorCode.BAD_INPUT, f"a map of {count} points is too large; ask for {MAX_MAP_POINTS} at most")


def _weight(analysis: Analysis) -> float:
    return sum(block.geometry.units.weight for block in analysis.blocks) or 1.0


def _bounded(
    analysis: Analysis, surface: SurfacePoints, tolerance: float, model: str, clock: Deadline
) -> tuple[Bounds, bool, Mask]:
    """Bounds on the inverse load factors, whether they meet the tolerance, and which points are doubtful."""
    bounds = Bounds.none(len(surface.points))
    wrenches = wrench_of_force(surface.directions, surface.points)
    loaded = [np.flatnonzero(block.bodies_of(surface.place) >= 0) for block in analysis.blocks]
    open_rows = list(loaded)
    complete, floor = not clock.passed, 1 / (_CEILING * _weight(analysis))
    if model != "limit":
        for number, block in enumerate(analysis.blocks):
            less = _LESS * tolerance if model == "default" else 0.0
            open_rows[number], done = _single_patch(block, number, loaded[number], wrenches, bounds, less, clock)
            complete &= done
    answers = []
    for number, (block, rows) in enumerate(zip(analysis.blocks, open_rows, strict=True)):
        pool = Pool(block, number, bounds, clock, with_limit=model != "patch", with_patch=model != "limit")
        answers.append(pool.answers)
        if model == "patch" and block.solvers.single_patch is not None:
            continue
        complete &= bound_block(pool, surface, rows, wrenches, tolerance, floor)
    doubtful = np.zeros(len(surface.points), dtype=bool)
    for block, rows, known in zip(analysis.blocks, loaded, answers, strict=True):
        if block.geometry.statically_determinate or not len(rows):
            continue
        if model == "default":
            doubtful[rows] |= confirm_map(block, surface, rows, wrenches, bounds, tolerance, floor, clock, known)
        else:  # the model alone is asked for
            doubtful[rows] = True
    complete &= not clock.passed
    return bounds, complete, doubtful


def _single_patch(
    block: BlockAnalysis, number: int, rows: Indices, wrenches: Array, bounds: Bounds, less: float, deadline: Deadline
) -> tuple[Indices, bool]:
    """Blocks of one body on one interface need no bounds under `patch`: all points (rows) have a closed form.

    Returns:
        The points for which limit analysis has still to be asked: it may hold less, by more than this share. And
        whether all points were reached before the deadline.
    """
    if block.solvers.single_patch is None:
        return rows, True
    still_open = [rows[:0]]
    for part in chunks(len(rows)):
        if deadline.passed:
            bounds.give_up(rows[part.start :])
            return np.concatenate(still_open), False
        some = rows[part]
        factor = block.solvers.single_patch.collapse(wrenches[some]).factor
        with np.errstate(divide="ignore"):
            inverse = 1 / factor
        if not np.isfinite(less):
            bounds.raise_to(some, inverse, inverse, number, np.full(len(some), -1))
            continue
        bounds.raise_to(some, inverse, inverse * (1 + less), number, np.full(len(some), -1))
        still_open.append(some[~block.solvers.single_patch.allowed_by_limit(wrenches[some], factor / (1 + less))])
    return np.concatenate(still_open), True
