"""Models of when an assembly gives way, by name: each answers many questions at once."""

from collections.abc import Callable

import numpy as np

from poise.assembly.analysis import Analysis, BlockAnalysis, Mechanism, PatchMechanism
from poise.assembly.collapses import Collapses, Model
from poise.assembly.coulomb import BISECTED
from poise.assembly.deadline import Deadline
from poise.assembly.gauge import NEVER, Gauge
from poise.assembly.pushes import Loads
from poise.assembly.rivals.approximate import approx
from poise.assembly.rivals.bullet import pybullet
from poise.assembly.rivals.linear import lp4, lp8
from poise.assembly.rivals.thesis import thesis
from poise.types import Array, Indices, Mask

NEARLY = 0.98
"""Elastic contacts are asked at this share of the robustness found: nearer to collapse nothing converges."""
HUGE = 1000.0
"""What is sustained for ever is checked at this many weights of the assembly."""
CHECKS = 8
"""So many of the weakest answers are checked by elastic contacts, and all that may rest on self-stress."""


def limit(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """Exact-cone limit analysis; see `limit.limit_program`."""
    collapses = Collapses.start(loads.count)
    for block in analysis.blocks:
        _ask(collapses, block, *block.loads(loads), deadline, _limit_gauges)
    return collapses


def patch(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """One wrench per interface, friction as under uniform pressure; see `SinglePatch` and `PatchProgram`."""
    collapses = Collapses.start(loads.count)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        _ask_single_patch(collapses, block, questions, block_loads)
        if block.solvers.single_patch is None:
            _ask(collapses, block, questions, block_loads, deadline, _patch_gauges)
    return collapses


def coulomb(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """Elastic contacts with Coulomb friction; see `CoulombBlock`. Limit analysis says where to stop looking."""
    collapses = limit(analysis, loads, deadline)
    _check_elastic(collapses, analysis, loads, np.ones(loads.count, dtype=bool), deadline, nearly=1.0)
    collapses.upper = np.minimum(collapses.upper, (1 + BISECTED) * collapses.lower)
    return collapses


def default(analysis: Analysis, loads: Loads, deadline: Deadline) -> Collapses:
    """The weaker of `limit` and `patch`; the weakest, and what may rest on self-stress, checked by `coulomb`."""
    collapses = Collapses.start(loads.count)
    doubtful = np.zeros(loads.count, dtype=bool)
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        doubtful[questions] |= block.solvers.self_stress
        single = block.solvers.single_patch is not None
        _ask_single_patch(collapses, block, questions, block_loads)
        _ask(collapses, block, questions, block_loads, deadline, _limit_gauges if single else _both_gauges)
    # One body on one interface has no choice of contact forces.
    free = [isinstance(m, Mechanism) and not m.block.geometry.statically_determinate for m in collapses.mechanisms]
    weakest = np.argsort(np.where(free, collapses.upper, np.inf))[:CHECKS]
    doubtful[weakest] |= np.array(free, dtype=bool)[weakest]
    _check_elastic(collapses, analysis, loads, doubtful, deadline)
    return collapses


MODELS: dict[str, Model] = {
    "default": default,
    "limit": limit,
    "patch": patch,
    "coulomb": coulomb,
    "thesis": thesis,
    "approx": approx,
    "lp4": lp4,
    "lp8": lp8,
    "pybullet": pybullet,
}
"""By the names that services and the command line take."""


def _limit_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    return [block.solvers.limit.gauge(load)]


def _patch_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    return _both_gauges(block, load)[-1:]


def _both_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    found = block.solvers.limit.gauge(load)
    return [found] if block.solvers.patch is None else [found, block.solvers.patch.gauge(load, found)]


def _ask(
    collapses: Collapses,
    block: BlockAnalysis,
    questions: Indices,
    loads: Array,
    deadline: Deadline,
    gauges: Callable[[BlockAnalysis, Array], list[Gauge]],
) -> None:
    """Ask one block about loads (q, 6 n) on it, one by one; past the deadline nothing is known of the rest."""
    for row, (question, load) in enumerate(zip(questions.tolist(), loads, strict=True)):
        if deadline.passed:
            collapses.give_up(questions[row:])
            return
        never = NEVER * float(np.abs(load).max())
        for gauge in gauges(block, load):
            if gauge.value > never:
                collapses.limit_by(question, 1 / gauge.upper, 1 / gauge.value, Mechanism(block, gauge.twist))


def _ask_single_patch(collapses: Collapses, block: BlockAnalysis, questions: Indices, loads: Array) -> None:
    """Ask a block of one body on one interface about all loads at once; other blocks are left alone."""
    single = block.solvers.single_patch
    if single is None:
        return
    wrenches = block.geometry.units.wrench(loads)
    found = single.collapse(wrenches)
    for row in np.flatnonzero(np.isfinite(found.factor)).tolist():
        factor = float(found.factor[row])
        mechanism = PatchMechanism(block, single, wrenches[row], factor, bool(found.slips[row]))
        collapses.limit_by(int(questions[row]), factor, factor, mechanism)


def _check_elastic(
    collapses: Collapses,
    analysis: Analysis,
    loads: Loads,
    wanted: Mask,
    deadline: Deadline,
    nearly: float = NEARLY,
) -> None:
    """Ask elastic contacts about some questions (Q,), and lower the lower bound of what they do not hold."""
    if not wanted.any():
        return
    total = sum(block.geometry.units.weight for block in analysis.blocks) or 1.0
    for block in analysis.blocks:
        questions, block_loads = block.loads(loads)
        for row in np.flatnonzero(wanted[questions]).tolist():
            if deadline.passed:
                collapses.complete = False
                return
            question, load = int(questions[row]), block_loads[row]
            above = nearly * min(float(collapses.upper[question]), HUGE * total)
            factor, complete = block.solvers.coulomb.factor(load, above, deadline)
            collapses.complete &= complete
            if factor < above:
                collapses.lower[question] = min(float(collapses.lower[question]), factor)
                gravity = block.geometry.gravity.ravel()
                fall = block.solvers.coulomb.settle(gravity + 1.02 * factor * load, deadline=deadline)
                collapses.mechanisms[question] = Mechanism(block, fall.displacement)
    collapses.checked |= wanted
