"""Questions to single blocks, shared by models: limit analysis, patches, and the check by elastic contacts."""

from collections.abc import Callable

import numpy as np

from poise.assembly.robustness.limit_loads import LimitLoads
from poise.assembly.statics import (
    UNLIMITED,
    Analysis,
    BlockAnalysis,
    Deadline,
    ElasticFactor,
    InverseLoadFactor,
    Loads,
    Mechanism,
    PatchMechanism,
)
from poise.types import Array, Indices, Mask

CHECKED_SHARE = 0.98
"""Elastic contacts are checked at this share of the robustness found: closer to collapse they do not converge."""
CHECKED_WEIGHTS = 1000.0
"""Loads without limit are checked at this many weights of the assembly."""

_BODIES_AT_ONCE = 200
"""Bodies of the loads that a block is asked about between two looks at the deadline: some milliseconds."""
_SIDE_BY_SIDE = 8
"""Loads that the kernel computes together: of many, a multiple of this is asked about."""
_AT_ONCE = 200
"""Loads on a single body that limit analysis is asked about between two looks at the deadline: some milliseconds."""


def limit_factors(block: BlockAnalysis, loads: Array) -> list[list[InverseLoadFactor]]:
    """By limit analysis alone."""
    return [[found] for found in block.solvers.limit.each(loads)]


def patch_factors(block: BlockAnalysis, loads: Array) -> list[list[InverseLoadFactor]]:
    """By patches alone."""
    return [found[-1:] for found in both_factors(block, loads)]


def both_factors(block: BlockAnalysis, loads: Array) -> list[list[InverseLoadFactor]]:
    """By limit analysis, and by patches where friction spread uniformly can hold the block at rest."""
    limits, patch = block.solvers.limit.each(loads), block.solvers.patch
    if patch is None:
        return [[limit] for limit in limits]
    return [list(both) for both in zip(limits, patch.inverse_factors(loads, limits, np.zeros(len(loads))), strict=True)]


def loads_at_once(block: BlockAnalysis) -> int:
    """Loads that a block is asked about between two looks at the deadline."""
    number = max(1, _BODIES_AT_ONCE // block.geometry.count)
    return number - number % _SIDE_BY_SIDE if number > _SIDE_BY_SIDE else number


def ask_block(
    limit_loads: LimitLoads,
    block: BlockAnalysis,
    questions: Indices,
    loads: Array,
    deadline: Deadline,
    inverses: Callable[[BlockAnalysis, Array], list[list[InverseLoadFactor]]],
) -> dict[int, InverseLoadFactor]:
    """Solve one block for loads (q, 6 n), some at once; loads after the deadline are given up.

    Returns:
        The first answer to each question that was solved.
    """
    answers: dict[int, InverseLoadFactor] = {}
    step = loads_at_once(block)
    for start in range(0, len(loads), step):
        some = slice(start, start + step)
        if deadline.passed:
            limit_loads.give_up(questions[start:])
            break
        found = inverses(block, loads[some])
        for question, load, inverses_of in zip(questions[some].tolist(), loads[some], found, strict=True):
            answers[question] = inverses_of[0]
            for inverse in inverses_of:
                limit_by(limit_loads, block, question, load, inverse)
    return answers


def limit_by(
    limit_loads: LimitLoads, block: BlockAnalysis, question: int, load: Array, inverse: InverseLoadFactor
) -> None:
    """Record what was found of a load (6 n,) on a block."""
    if inverse.value > UNLIMITED * float(np.abs(load).max()):
        limit_loads.limit_by(question, 1 / inverse.upper, 1 / inverse.value, Mechanism(block, inverse.twist))


def ask_single_patch(limit_loads: LimitLoads, block: BlockAnalysis, questions: Indices, loads: Array) -> None:
    """Solve a block of one body on one interface for all loads at once; other blocks are skipped."""
    single = block.solvers.single_patch
    if single is None:
        return
    wrenches = block.geometry.units.wrench(loads)
    found = single.collapse(wrenches)
    factors, slips = found.factor.tolist(), found.slips.tolist()

    def mechanism(row: int) -> PatchMechanism:
        return PatchMechanism(block, single, wrenches[row], factors[row], slips[row])

    limit_loads.limit_by_all(questions, found.factor, found.factor, mechanism)


def ask_single_limit(
    limit_loads: LimitLoads, block: BlockAnalysis, questions: Indices, loads: Array, deadline: Deadline
) -> None:
    """Ask limit analysis about a block of one body on one interface, as far as it may hold less than what is known.

    Args:
        limit_loads: with what patches of all such blocks hold. Other blocks, and loads that limit analysis surely
            holds at that, are skipped.
        block, questions, loads, deadline: as `ask_block` takes them.
    """
    single = block.solvers.single_patch
    if single is None:
        return
    known = limit_loads.upper[questions]
    rows = np.flatnonzero(~single.allowed_by_limit(block.geometry.units.wrench(loads), known))
    for start in range(0, len(rows), _AT_ONCE):
        some = rows[start : start + _AT_ONCE]
        if deadline.passed:
            limit_loads.give_up(questions[rows[start:]])
            return
        _ask_limit(limit_loads, block, questions[some], loads[some])


def _ask_limit(limit_loads: LimitLoads, block: BlockAnalysis, questions: Indices, loads: Array) -> None:
    with np.errstate(divide="ignore"):
        found = block.solvers.limit.inverse_factors(loads, 1 / limit_loads.upper[questions])
        bounded = found.value > UNLIMITED * np.abs(loads).max(axis=1)
        lower, upper = (np.where(bounded, 1 / inverse, np.inf) for inverse in (found.upper, found.value))
    limit_loads.limit_by_all(questions, lower, upper, lambda row: Mechanism(block, found.twist[row]))


def coupled_questions(analysis: Analysis, loads: Loads) -> Mask:
    """(Q,) questions that load a block in which contact forces have a choice."""
    found = np.zeros(loads.count, dtype=bool)
    for block in analysis.blocks:
        if not block.geometry.statically_determinate:
            found[loads.question[block.bodies_of(loads.place) >= 0]] = True
    return found


def check_elastic(
    limit_loads: LimitLoads,
    analysis: Analysis,
    loads: Loads,
    wanted: Mask,
    deadline: Deadline,
    nearly: float = CHECKED_SHARE,
) -> dict[tuple[int, int], ElasticFactor]:
    """Check some questions (Q,) with elastic contacts, and lower the lower bounds that they do not withstand.

    Those for which there is no time, or whose collapse is not found, keep as a lower bound what was confirmed.

    Returns:
        What each block, by the identity of its solvers, withstands in each question.
    """
    answers: dict[tuple[int, int], ElasticFactor] = {}
    known = wanted.copy()
    total = sum(block.geometry.units.weight for block in analysis.blocks) or 1.0
    for block in analysis.blocks:
        if block.geometry.statically_determinate and nearly < 1:  # its answers are exact
            continue
        questions, block_loads = block.loads(loads)
        asked = wanted[questions]
        questions, block_loads = questions[asked], block_loads[asked]
        most = nearly * np.minimum(limit_loads.upper[questions], CHECKED_WEIGHTS * total)
        factors = block.solvers.coulomb.factors(block_loads, most, deadline)
        for question, above, found in zip(questions.tolist(), most.tolist(), factors, strict=True):
            answers[id(block.solvers), question] = found
            known[question] &= found.known
            if found.value < above:
                limit_loads.lower[question] = min(float(limit_loads.lower[question]), found.value)
                if found.twist is not None:
                    limit_loads.mechanisms[question] = Mechanism.elastic(block, found.twist)
    limit_loads.complete &= bool(known[wanted].all()) or not deadline.passed
    limit_loads.checked |= known
    return answers
