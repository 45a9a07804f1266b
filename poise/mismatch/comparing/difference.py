"""A recording without what another one of the same motion has too."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.comparing.alignment import Alignment
from poise.mismatch.recorded import EffortTrack, RecordedMotion, linear_at
from poise.types import Array, Mask

_FEWEST = 200
"""Samples of a signal that a comparison needs."""


def difference(
    this: RecordedMotion, other: RecordedMotion, alignment: Alignment, alike: Mask, same_speed: bool
) -> RecordedMotion:
    """This recording minus what the other one's readings are above its prediction, at the same place of the motion.

    What the model lacks in both cancels; what only one has stays. Samples without a counterpart are left out.

    Args:
        this, other: with the predictions of one model, and with efforts of the same joints.
        alignment: of this with the other.
        alike: (K,) the times of the alignment at which both motions are the same.
        same_speed: whether both go through it at one speed, so that errors of the model cancel.

    Raises:
        InputError: TOO_FEW_SAMPLES when too little is left.
    """
    times, kept = _counterparts(this.seconds, other.seconds, alignment, alike)
    rest = linear_at(other.seconds, other.wrench - other.prediction, times)
    varied = _sum(this.motion_variance, other.motion_variance, times, other.seconds)
    result = replace(this, wrench=this.wrench - rest, motion_variance=varied)
    if this.has("wrench") and other.has("wrench"):
        kept &= np.isfinite(result.wrench).all(axis=1)
    else:
        result = replace(result, wrench=np.full_like(this.wrench, np.nan))
    effort = None
    if this.effort is not None and other.effort is not None:
        effort = _efforts(this.effort, other.effort, alignment, alike, same_speed)
    if kept.sum() < _FEWEST or (effort is not None and len(effort.seconds) < _FEWEST):
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES, f"compare: only {kept.sum()} samples have a counterpart in the other recording"
        )
    return replace(result.select(kept), effort=effort)


def with_motion_of(this: RecordedMotion, other: RecordedMotion, alignment: Alignment) -> RecordedMotion:
    """The readings of this recording on the motion and the clock of the other one.

    Args:
        this, other: of one motion at one speed; this one's clock is wrong.
        alignment: of the other with this.
    """
    times, kept = _counterparts(other.seconds, this.seconds, alignment)
    moved = replace(other, wrench=linear_at(this.seconds, this.wrench, times)).select(kept)
    if this.effort is None or other.effort is None:
        return replace(moved, effort=None)
    track = other.effort
    times, kept = _counterparts(track.seconds, this.effort.seconds, alignment)
    measured = linear_at(this.effort.seconds, this.effort.measured, times)
    return replace(moved, effort=replace(track, measured=measured).select(kept))


def _counterparts(seconds: Array, others: Array, alignment: Alignment, alike: Mask | None = None) -> tuple[Array, Mask]:
    """(N,) s in the other recording, and which samples have one there; `alike` as in `difference`."""
    times = alignment.at(seconds)
    kept = np.isfinite(times) & (times >= others[0]) & (times <= others[-1])
    if alike is not None:
        kept &= np.interp(seconds, alignment.seconds, alike.astype(np.float64)) > 0.99
    return np.where(kept, times, others[0]), kept


def _efforts(this: EffortTrack, other: EffortTrack, alignment: Alignment, alike: Mask, same_speed: bool) -> EffortTrack:
    times, kept = _counterparts(this.seconds, other.seconds, alignment, alike)
    rest = linear_at(other.seconds, other.measured - other.prediction, times)
    varied = _sum(this.motion_variance, other.motion_variance, times, other.seconds)
    return replace(this, measured=this.measured - rest, motion_variance=varied, errors_cancel=same_speed).select(kept)


def _sum(own: Array | None, others: Array | None, times: Array, seconds: Array) -> Array | None:
    if own is None or others is None:
        return own
    return own + linear_at(seconds, others, times)
