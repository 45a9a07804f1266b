"""Sentences about what stands but can roll, or balances, for answers that would otherwise only say that it stands."""

import numpy as np

from poise.assembly.robustness.gravity_cone import GravityCone
from poise.assembly.scene import SceneFinding
from poise.assembly.statics import (
    NO_DEADLINE,
    ROLLING_TOGETHER,
    Analysis,
    Deadline,
    Rolling,
    rolling,
    too_many_to_roll,
)

_NAMED = 4
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
    """What only balances, on an edge or a point, as far as it is on one other body; its margin does not show that."""
    gravity, found = np.asarray(analysis.assembly.gravity), []
    for block in analysis.blocks:
        if block.geometry.statically_determinate:
            item = analysis.assembly.objects[block.block.members[0][0]]
            if abs(GravityCone.of(block).spare(gravity)) <= _BALANCED * float(np.ptp(item.vertices, axis=0).max()):
                found.append(item.id)
    if not found:
        return ()
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    what = f"{', '.join(found[:_NAMED])}{more}: balances on an edge or a point; the least push or tilt tips it"
    return (SceneFinding(what, {"objects": float(len(found))}),)


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
