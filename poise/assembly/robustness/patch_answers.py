"""What patches hold of loads that limit analysis and elastic contacts were asked about before."""

from collections.abc import Sequence

import numpy as np

from poise.assembly.robustness.block_answers import limit_by, loads_at_once
from poise.assembly.robustness.limit_loads import LimitLoads
from poise.assembly.statics import BlockAnalysis, Deadline, ElasticFactor, InverseLoadFactor
from poise.types import Array, Indices, Mask


def patch_factor(block: BlockAnalysis, load: Array, found: ElasticFactor) -> InverseLoadFactor | None:
    """What patches hold of a load (6 n,) with the centres of pressure as at rest; None: all that elastic contacts hold.

    Args:
        block: of several bodies or interfaces.
        load: in its units.
        found: what elastic contacts hold.
    """
    patch = block.solvers.patch
    if patch is None or _as_patches(block, [found])[0]:
        return None
    return patch.resting.inverse_factor(load, 1 / found.value if found.value > 0 else 0.0)


def ask_patches(
    limit_loads: LimitLoads,
    block: BlockAnalysis,
    questions: Indices,
    loads: Array,
    deadline: Deadline,
    limits: dict[int, InverseLoadFactor],
    elastic: dict[tuple[int, int], ElasticFactor],
) -> None:
    """Ask patches about loads (q, 6 n) on a block that limit analysis and elastic contacts were asked about before."""
    if block.solvers.patch is None:
        return
    solved = np.flatnonzero([question in limits for question in questions.tolist()])
    step = loads_at_once(block)
    for start in range(0, len(solved), step):
        if deadline.passed:
            limit_loads.give_up(questions[solved[start:]])
            return
        rows = solved[start : start + step]
        found = [elastic.get((id(block.solvers), question)) for question in questions[rows].tolist()]
        _ask_some(limit_loads, block, questions[rows], loads[rows], limits, found)


def _ask_some(
    limit_loads: LimitLoads,
    block: BlockAnalysis,
    questions: Indices,
    loads: Array,
    limits: dict[int, InverseLoadFactor],
    found: Sequence[ElasticFactor | None],
) -> None:
    """Ask patches what they hold less of than elastic contacts do, where these collapse, and than limit analysis."""
    patch = block.solvers.patch
    if patch is None:
        return
    collapsed = [None if one is None or one.twist is None else one for one in found]
    asked = np.flatnonzero(~_as_patches(block, collapsed)).tolist()
    held = np.array([0.0 if (one := collapsed[row]) is None else one.value for row in asked])
    enough = np.divide(1.0, held, out=np.zeros_like(held), where=held > 0)
    known = [limits[int(questions[row])] for row in asked]
    inverses = patch.inverse_factors(loads[asked], known, enough)
    for row, value, limit, inverse in zip(asked, held.tolist(), known, inverses, strict=True):
        if inverse is not limit and (collapsed[row] is None or inverse.upper * value > 1):
            limit_by(limit_loads, block, int(questions[row]), loads[row], inverse)


def _as_patches(block: BlockAnalysis, found: Sequence[ElasticFactor | None]) -> Mask:
    """(Q,) whether elastic contacts turn no patch more than uniform pressure could, so that patches hold as much."""
    coulomb, patch, held = block.solvers.coulomb, block.solvers.patch, np.zeros(len(found), dtype=bool)
    states = {row: one.displacement for row, one in enumerate(found) if one is not None and one.value > 0}
    states = {row: state for row, state in states.items() if state is not None}
    if patch is not None and states:
        forces = np.moveaxis(coulomb.forces(np.array(list(states.values()))), 2, 0)
        places, which = coulomb.contacts.places.T, coulomb.contacts.interface
        held[list(states)] = patch.allows_at((places[0], places[1]), which, forces[0], forces[1], forces[2])
    return held
