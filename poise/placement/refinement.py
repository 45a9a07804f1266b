"""Move a placement that was found, step by step, as long as it gets better."""

from collections.abc import Callable

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.errors import NoAnswerError
from poise.geometry import Pose, plane_axes, rotation_about, unit
from poise.placement.scoring import PlacementScore, estimate_score
from poise.placement.validation import Validator
from poise.types import Array

_FIRST_STEP = 0.15
"""Of the object's size; and in radians for turns."""
_SMALLEST_STEP = 0.01


def refine(
    validator: Validator, analysis: Analysis, item: RigidObject, criterion: str, late: Callable[[], bool]
) -> tuple[Analysis, RigidObject]:
    """Slide and turn the object on its support while its score grows; a pattern search with shrinking steps.

    Args:
        validator: of the assembly without the object.
        analysis: of the assembly with it.
        item: at the placement found.
        criterion: see `PlacementScore.better_than`.
        late: whether time is up.
    """
    size = float(np.linalg.norm(np.ptp(item.vertices, axis=0)))
    up = -unit(analysis.assembly.gravity)
    moves = [sign * axis for axis in plane_axes(up) for sign in (1.0, -1.0)]
    try:
        best = estimate_score(analysis, criterion == "median")
    except NoAnswerError:
        return analysis, item
    step = _FIRST_STEP
    while step >= _SMALLEST_STEP and not late():
        better = None
        for move in (*moves, None):
            candidate = _try(validator, item, move, step, size, up, criterion)
            if candidate is not None and candidate[2].better_than(best, criterion):
                better = candidate
                best = candidate[2]
            if late():
                break
        if better is None:
            step /= 2
        else:
            analysis, item, _ = better
    return analysis, item


def _try(
    validator: Validator, item: RigidObject, move: Array | None, step: float, size: float, up: Array, criterion: str
) -> tuple[Analysis, RigidObject, PlacementScore] | None:
    """The object moved, or (None) turned about the vertical through its centre of mass."""
    com = item.com_in_world
    if move is None:
        turn = rotation_about(up, step)
        pose = Pose(turn @ item.pose.rotation, turn @ (item.pose.translation - com) + com)
    else:
        pose = Pose(item.pose.rotation, item.pose.translation + step * size * move)
    accepted = validator.accept(pose)
    if accepted is None:
        return None
    try:
        return (*accepted, estimate_score(accepted[0], criterion == "median"))
    except NoAnswerError:
        return None
