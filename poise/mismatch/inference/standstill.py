"""Joints that stand still in dry friction: their efforts say less than a model without memory predicts.

At rest, dry friction carries any load up to its size: which one depends on how the joint stopped. A law of the velocity
predicts none, and what it lacks looks like an offset, a tilt or a push that comes and goes with the motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from poise.mismatch.effects import Effect, in_model
from poise.mismatch.inference.courses import follows_residual
from poise.mismatch.inference.linear_screen import screened
from poise.mismatch.inference.problem import Problem
from poise.mismatch.inference.search import testable
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.types import Mask

_SLOW, _CREEPS = 0.002, 0.02
"""Shares of the usual largest speed of a joint: of its mean speed over `_SPAN` at rest, and of a sample, with noise."""
_SPAN = 0.1
"""s."""
_LEAST = 0.06
"""Share of the samples of a joint at rest from which these matter."""
_MARGIN = 4.0
"""Load at rest, in units of the dry friction while moving, that stiction may carry."""


def standing(track: EffortTrack) -> Mask:
    """(M, J) where a joint stands still."""
    span = max(int(_SPAN / track.period), 1)
    speed = np.abs(track.velocity)
    usual = track.speeds
    mean = np.abs(uniform_filter1d(track.velocity, span, axis=0, mode="nearest"))
    still = (mean <= _SLOW * usual) & (speed <= _CREEPS * usual)
    # The mean speed of the first and the last samples of a rest is that of the motion beside it.
    beside = maximum_filter1d(still, 2 * (span // 2) + 1, axis=0, mode="nearest")
    return np.asarray(beside & (speed <= _CREEPS * usual))


def beside_stuck_joints(problem: Problem, library: Sequence[Effect] | None) -> Problem:
    """Efforts without readings that the dry friction of joints at rest explains; other signals as they are.

    The friction is that which the moving joints show, beside effects that act in all joints and at all times.
    """
    track = problem.recorded.effort
    if problem.signal == "wrench" or track is None or track.errors_cancel:
        return problem
    still = standing(track)
    if still.mean(axis=0).max() < _LEAST:
        return problem
    moving = problem.of(_with(problem.recorded, track, still))
    parts = screened(moving, [each for each in testable(moving, library)[0] if not follows_residual(each, moving)])
    dry = [np.abs(each.effect.simulate(moving.recorded, each.values)).max(axis=0) for each in parts if each.effect.dry]
    size = np.sum([in_model(moving.recorded, "friction"), *dry], axis=0)
    if not size.any():
        return problem
    left = moving.measured - moving.predicted(moving.compose(parts)[1])
    return problem.of(_with(problem.recorded, track, still & (np.abs(left) <= _MARGIN * size)))


def _with(recorded: RecordedMotion, track: EffortTrack, stuck: Mask) -> RecordedMotion:
    return replace(recorded, effort=replace(track, stuck=stuck))
