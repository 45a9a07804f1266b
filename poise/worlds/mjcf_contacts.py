"""Friction between bodies of a MuJoCo model, where it is not that of the rougher surface; and who lets whom pass."""

from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.types import Array

_MOST = 3000
"""Geoms whose pairs are examined: the matrices then take 0.3 GB."""


def mjcf_friction(
    model: Any, geoms: Sequence[int], owners: Sequence[str], movable: Collection[str]
) -> tuple[dict[tuple[str, str], float], list[str]]:
    """Coefficients that differ from the rougher surface of two bodies, and sentences about masks and flags.

    Of two geoms MuJoCo takes the friction and `condim` of the one with the higher `priority`, else the greater ones
    (XML reference, geom); a contact of `condim` 1 has no friction. The least of the pairs of geoms of two bodies
    counts, which is on the safe side.

    Args:
        model: MjModel.
        geoms: numbers of those that have a solid and may touch.
        owners: the body of each.
        movable: names of the bodies that can move.
    """
    import mujoco

    override = bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    notes = []
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        notes.append("contacts are switched off in the file, which is left out: bodies touch here")
    numbers, names = np.array(geoms, dtype=int), list(dict.fromkeys(owners))
    special = override or bool(np.any(model.geom_condim[numbers] == 1) or np.any(model.geom_priority[numbers] != 0))
    masks = np.unique(np.column_stack([model.geom_contype[numbers], model.geom_conaffinity[numbers]]), axis=0)
    if not special and np.all(_touching(*masks.T)):
        return {}, notes
    if len(numbers) > _MOST:
        notes.append(f"masks, priority and condim of more than {_MOST} geoms are left out: the rougher surface counts")
        return {}, notes
    friction, touching = _of_geoms(model, numbers, override)
    index = np.array([names.index(owner) for owner in owners], dtype=int)
    least = np.full((len(names), len(names)), np.inf)
    np.minimum.at(least, (index[:, None], index[None, :]), np.where(touching, friction, np.inf))
    pairs, passing = {}, list[str]()
    for one, other in combinations(range(len(names)), 2):
        if names[one] not in movable and names[other] not in movable:
            continue
        if not np.isfinite(least[one, other]):
            passing.append(f"{names[one]} and {names[other]}")
        elif special:
            pairs[names[one], names[other]] = float(least[one, other])
    if passing:
        more = f", and {len(passing) - 1} other pairs of bodies," if len(passing) > 1 else ""
        notes.append(f"masks (contype, conaffinity) let {passing[0]}{more} pass each other in MuJoCo; they touch here")
    return pairs, notes


def _of_geoms(model: Any, numbers: Array, override: bool) -> tuple[Array, NDArray[np.bool_]]:
    """(n, n): the coefficient of each two geoms, and whether their masks let them touch."""
    friction, dimensions = model.geom_friction[numbers, 0], model.geom_condim[numbers]
    rank, kind, affinity = model.geom_priority[numbers], model.geom_contype[numbers], model.geom_conaffinity[numbers]
    ahead, behind = rank[:, None] > rank[None, :], rank[:, None] < rank[None, :]

    def of_two(value: Array) -> Array:
        greater = np.maximum(value[:, None], value[None, :])
        return np.where(ahead, value[:, None], np.where(behind, value[None, :], greater))

    found = np.full((len(numbers),) * 2, min(model.opt.o_friction[:2])) if override else of_two(friction)
    return np.where(of_two(dimensions) == 1, 0.0, found), _touching(kind, affinity)


def _touching(kind: NDArray[np.int64], affinity: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n, n) whether the masks of two geoms let them touch."""
    return np.asarray(((kind[:, None] & affinity[None, :]) | (affinity[:, None] & kind[None, :])) != 0)
