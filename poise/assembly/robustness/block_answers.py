"""Questions to single blocks, shared by models: limit analysis, patches, and the check by elastic contacts."""

from collections.abc import Callable

import numpy as np

from poise.assembly.robustness.limit_loads import Collapses
from poise.assembly.statics import NEVER, Analysis, BlockAnalysis, Deadline, Gauge, Loads, Mechanism, PatchMechanism
from poise.types import Array, Indices, Mask

NEARLY = 0.98
"""Elastic contacts are asked at this share of the robustness found: nearer to collapse nothing converges."""
HUGE = 1000.0
"""What is sustained for ever is checked at this many weights of the assembly."""


def limit_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    """By limit analysis alone."""
    return [block.solvers.limit.gauge(load)]


def patch_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    """By patches alone."""
    return both_gauges(block, load)[-1:]


def both_gauges(block: BlockAnalysis, load: Array) -> list[Gauge]:
    """By limit analysis, and by patches where friction spread uniformly can hold the block at rest."""
    found = block.solvers.limit.gauge(load)
    return [found] if block.solvers.patch is None else [found, block.solvers.patch.gauge(load, found)]


def ask_block(
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


def ask_single_patch(collapses: Collapses, block: BlockAnalysis, questions: Indices, loads: Array) -> None:
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


def check_elastic(
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
