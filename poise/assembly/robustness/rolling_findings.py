"""Sentences about what stands but can roll, or balances, for answers that would otherwise only say that it stands."""

import numpy as np

from poise.assembly.robustness.gravity_cone import GravityCone
from poise.assembly.scene import SceneFinding
from poise.assembly.statics import (
    NO_DEADLINE,
    ROLLING_TOGETHER,
    Analysis,
    BlockAnalysis,
    Deadline,
    Rolling,
    rolling,
    too_many_to_roll,
)
from poise.geometry import cross, unit
from poise.types import Array

_NAMED = 4
_UPRIGHT = 0.1
"""Sine of the angle to the vertical up to which a line of contacts stands upright."""
_BALANCED = 1e-6
"""Share of an object's size within which its line of weight meets the edge of what carries it."""


def rolling_findings(analysis: Analysis, deadline: Deadline = NO_DEADLINE) -> tuple[SceneFinding, ...]:
    """What can roll, of all that was found to stand so far; one finding for what rolls together. See `rolling`.

    Args:
        analysis: of the assembly.
        deadline: what is found until then is said.
    """
    found = rolling(analysis, deadline, only_known=True)
    return (
        *(SceneFinding(_sentence(each), _evidence(each)) for each in found),
        *(SceneFinding(_unasked(count), {"bodies": float(count)}) for count in too_many_to_roll(analysis)),
    )


def balance_findings(analysis: Analysis) -> tuple[SceneFinding, ...]:
    """What only balances, on an edge or a point, or on several that are in line; its margin does not show that."""
    gravity, found = np.asarray(analysis.assembly.gravity), []
    for block in analysis.blocks:
        if not block.geometry.statically_determinate:
            found += _in_line(analysis, block)
            continue
        item = analysis.assembly.objects[block.block.members[0][0]]
        if abs(GravityCone.of(block).spare(gravity)) <= _BALANCED * float(np.ptp(item.vertices, axis=0).max()):
            found.append(item.id)
    if not found:
        return ()
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    what = f"{', '.join(found[:_NAMED])}{more}: balances on an edge or a point; the least push or tilt tips it"
    return (SceneFinding(what, {"objects": float(len(found))}),)


def _in_line(analysis: Analysis, block: BlockAnalysis) -> list[str]:
    """Bodies of a block that touch others in one line alone, which is under their centres of mass: see `_tips`."""
    found, supports = [], np.array(block.block.supports)
    for body, members in enumerate(block.block.members):
        touching = [block.interfaces[k] for k in np.flatnonzero((supports == body).any(axis=1))]
        if any(interface.touch is not None for interface in touching):  # see `rolling`
            continue
        points = np.concatenate([interface.points for interface in touching])
        items = [analysis.assembly.objects[place] for place in members]
        masses = np.array([item.mass for item in items])
        com = masses @ np.array([item.com_in_world for item in items]) / masses.sum()
        size = _BALANCED * float(np.ptp(items[0].vertices, axis=0).max())
        if _tips(points, com, np.asarray(analysis.assembly.gravity), size):
            found.append(items[0].id)
    return found


def _tips(points: Array, com: Array, gravity: Array, size: float) -> bool:
    """Whether a body turns about the line through its contact points (P, 3) by itself, once it is a little off it.

    The centre of mass (3,) is above the line, and no farther than a `size`, m, from the vertical plane through it.
    """
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(points) > 1 and spread[1] > size * np.sqrt(len(points)):
        return False
    up, arm = -unit(gravity), com - middle
    run = axes[0] if spread[0] > size else np.zeros(3)
    across = cross(run, up) if run.any() else arm - (arm @ up) * up
    level = float(np.linalg.norm(across))
    if run.any() and level < _UPRIGHT:  # on points that are above each other nothing balances
        return False
    aside = arm @ across / level if level > 0 else 0.0
    height = (arm - (arm @ run) * run) @ up
    return bool(abs(aside) <= size and height > 0)


def _unasked(count: int) -> str:
    return (
        f"{count} bodies lean on each other, some of them on round sides: up to {ROLLING_TOGETHER} neighbours were "
        "asked together, and what rolls only if more of them move was not looked for"
    )


def _sentence(found: Rolling) -> str:
    more = len(found.objects) - _NAMED
    names = ", ".join(found.objects[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    starts = f": {found.force:.2g} N at the centre of mass moves it" if np.isfinite(found.force) else ""
    held = f"only rolling resistance holds it (coefficient {found.coefficient:g}{starts})"
    if found.equilibrium == "stable":
        return f"{names}: may rock on a round side (stable equilibrium): {held}, and it comes back"
    return f"{names}: may roll ({found.equilibrium} equilibrium): {held}; chock it, or put it behind a lip"


def _evidence(found: Rolling) -> dict[str, float]:
    evidence = {"coefficient": found.coefficient}
    return evidence | ({"force": found.force} if np.isfinite(found.force) else {})
