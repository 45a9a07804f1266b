"""By how much wrenches are stamped later than the motion, from the samples alone: profile likelihood at many lags."""

import numpy as np

from poise.inertia.bayes.delay import Delay
from poise.inertia.model import N_SIGNALS, NoiseLevels, motion_signals, normal_equations, residual_moments
from poise.inertia.pipeline.samples import RecordedSamples
from poise.recording import interpolate
from poise.types import Array, Stamps

LONGEST, STEP = 0.06, 0.002
"""s: how far, and how finely lags are looked at. Shaking at 40 Hz turns around within 12 ms."""

PARTS = 10
"""Of a recording, each left out once: how the answer scatters then tells how sure it is (jackknife, Tukey 1958)."""

MAX_SAMPLES = 20_000
"""Of a long recording, that many are looked at, evenly spread."""

LARGEST_GAP = 0.1
"""s between samples across which nothing is interpolated."""

MIN_SAMPLES = 200


def clock_offset(samples: RecordedSamples) -> Delay | None:
    """The delay at which least squares leave least, and one sigma of it; None for too few samples in motion.

    The log likelihood of a delay, with the payload, the bias and the noise of each channel at their best for it, is
    -n/2 sum log s_k^2. No prior and no shape take part, and no model of how errors hang together in time.
    """
    lags = np.asarray(np.arange(-round(LONGEST / STEP), round(LONGEST / STEP) + 1) * STEP, dtype=np.float64)
    rows = np.flatnonzero(samples.used)
    if len(rows) < MIN_SAMPLES:
        return None
    moments, counts = _moments(samples, rows, lags)
    if (counts < MIN_SAMPLES / PARTS / 2).any():  # at rest, or all gaps
        return None
    whole = _best(moments.sum(axis=0), counts.sum(axis=0), lags, samples.noise)
    without = [
        _best(moments.sum(axis=0) - part, counts.sum(axis=0) - count, lags, samples.noise)
        for part, count in zip(moments, counts, strict=True)
    ]
    if any(np.isnan([whole, *without])):
        return None
    spread = np.sqrt((PARTS - 1) / PARTS * np.sum((np.array(without) - np.mean(without)) ** 2))
    return Delay(whole, float(spread))


def _moments(samples: RecordedSamples, rows: Stamps, lags: Array) -> tuple[Array, Array]:
    """(P, L, 19, 19) sums of s s^T over parts of the recording, and (P, L) samples in them."""
    motion = samples.motion
    specific = motion.gravity_in_sensor(samples.gravity) - motion.linear_acceleration_in_sensor
    columns = np.hstack([specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor])[rows]
    stamps, wrench = samples.stamps[rows], samples.wrench[rows]
    some = rows_of(len(rows))
    moments, counts = np.zeros((PARTS, len(lags), N_SIGNALS, N_SIGNALS)), np.zeros((PARTS, len(lags)))
    part = np.arange(len(some)) * PARTS // max(len(some), 1)
    for number, lag in enumerate(lags):
        earlier = stamps[some] - round(lag * 1e9)
        found = interpolate(stamps, columns, earlier, max_gap=LARGEST_GAP)
        signals = motion_signals(*np.hsplit(np.nan_to_num(found.values), 3))
        both = np.hstack([signals, wrench[some]])
        for which in range(PARTS):
            chosen = both[(part == which) & found.found]
            moments[which, number] = chosen.T @ chosen
            counts[which, number] = len(chosen)
    return moments, counts


def rows_of(count: int) -> Stamps:
    """Numbers of at most `MAX_SAMPLES` samples, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, MAX_SAMPLES)).astype(np.int64))


def _best(moments: Array, counts: Array, lags: Array, noise: NoiseLevels) -> float:
    """The lag where the likelihood has its peak, between samples of it; NaN at the ends."""
    log = np.array([_log_likelihood(one, count, noise) for one, count in zip(moments, counts, strict=True)])
    log /= counts
    top = int(np.argmax(log))
    if top in (0, len(lags) - 1):
        return np.nan
    before, at, after = log[top - 1 : top + 2]
    return float(lags[top] + STEP * (before - after) / (2 * (before - 2 * at + after)))


def _log_likelihood(moments: Array, count: float, noise: NoiseLevels) -> float:
    variances = np.repeat([noise.force, noise.torque], 3) ** 2
    for _ in range(3):  # the noise of each channel follows from the answer, and weighs it
        normal = normal_equations(moments, 0.0, np.diag(variances), noise)
        scale = np.sqrt(np.diag(normal.information).clip(min=1e-300))
        solved = np.linalg.lstsq(normal.information / np.outer(scale, scale), normal.vector / scale, rcond=1e-12)[0]
        squares, _ = residual_moments(moments, solved / scale)
        variances = np.diag(squares).clip(min=1e-12) / count
    return float(-count / 2 * np.sum(np.log(variances)))
