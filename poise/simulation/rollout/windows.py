"""Windows of a recording, run freely together, and their errors of motion and wrench."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.simulation.rollout.free_arm import FreeArm
from poise.simulation.rollout.recorded_run import RecordedRun
from poise.types import Array

_DIVERGED = np.pi
"""rad or m, the error that counts for a run that diverged, and the largest one of any."""


@dataclass(frozen=True)
class RolloutOptions:
    """Which windows are run.

    Args:
        horizons: s, lengths of the windows.
        windows: of each length, at most; they are spread over the time, and overlap by half at most.
        begin, end: s of the recording between which they lie.
    """

    horizons: tuple[float, ...] = (0.1, 1.0, 10.0)
    windows: int = 40
    begin: float = -np.inf
    end: float = np.inf


@dataclass(frozen=True, eq=False)
class HorizonErrors:
    """The windows of one length.

    Args:
        horizon: s.
        starts: (W,) s of the recording.
        motion: (W, J) rad or m, rms over each window.
        wrench: (W, 2) N and N m, likewise; NaN without a sensor.
        diverged: windows whose simulation diverged.
    """

    horizon: float
    starts: Array
    motion: Array
    wrench: Array
    diverged: int

    @property
    def by_joint(self) -> Array:
        """(J,) means over the windows."""
        return np.asarray(self.motion.mean(axis=0))

    @property
    def mean(self) -> float:
        """rad or m, over windows and joints."""
        return float(self.motion.mean())


@dataclass(frozen=True, eq=False)
class FreeRun:
    """One model's windows.

    Args:
        arm: the model.
        horizons: errors, the shortest windows first.
        seconds, position, recorded: the windows of the longest length, for pictures: (T,) s since their start, and
            (W, T, J) simulated and recorded.
    """

    arm: FreeArm
    horizons: tuple[HorizonErrors, ...]
    seconds: Array
    position: Array
    recorded: Array


def rolled_out(arm: FreeArm, options: RolloutOptions) -> FreeRun:
    """Run a model freely in windows of a recording.

    Raises:
        InputError: TOO_FEW_SAMPLES when not even the shortest window fits between begin and end.
    """
    begin, end = span(arm.run, options)
    fitting = sorted(h for h in options.horizons if h <= end - begin)
    if not fitting:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"no window of {min(options.horizons):g} s fits between {begin:.1f} s and {end:.1f} s of the recording",
        )
    found: list[HorizonErrors] = []
    for horizon in fitting:
        starts = window_starts(begin, end, horizon, options.windows)
        seconds, position, wrench = arm.positions(starts, horizon)
        at = starts[:, None] + seconds
        recorded = arm.recorded(at)
        off = np.minimum(np.nan_to_num(np.abs(position - recorded), nan=_DIVERGED), _DIVERGED)
        error = _of_wrench(wrench, arm.run.wrench_at(at))
        gone = int(np.isnan(position).any(axis=(1, 2)).sum())
        found.append(HorizonErrors(horizon, starts, np.sqrt(np.mean(off**2, axis=1)), error, gone))
    return FreeRun(arm, tuple(found), seconds, position, recorded)


def span(run: RecordedRun, options: RolloutOptions) -> tuple[float, float]:
    """s of the recording between which windows may lie: where motion and inputs are known."""
    first, last = float(run.seconds[0]), float(run.seconds[-1])
    return max(first, options.begin), min(last, options.end)


def window_starts(begin: float, end: float, horizon: float, most: int) -> Array:
    """(W,) s, spread evenly; neighbours overlap by half at most."""
    count = int(np.clip(2.0 * (end - begin - horizon) / horizon + 1.0, 1, most))
    return np.linspace(begin, end - horizon, count) if count > 1 else np.array([begin])


def share_removed(before: Sequence[HorizonErrors], after: Sequence[HorizonErrors]) -> dict[float, float]:
    """By length of the windows: the part of the error before that is gone after; negative where it is worse."""
    return {one.horizon: 1.0 - other.mean / max(one.mean, 1e-12) for one, other in zip(before, after, strict=True)}


def _of_wrench(simulated: Array, recorded: Array) -> Array:
    """(W, 2) rms of force and torque; NaN without a sensor."""
    off = (simulated - recorded) ** 2
    parts = [np.sqrt(off[..., part].sum(axis=2).mean(axis=1)) for part in (slice(0, 3), slice(3, 6))]
    return np.stack(parts, axis=1)
