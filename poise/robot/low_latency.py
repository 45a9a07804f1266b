"""The sensor's motion a few hundredths of a second after the newest pose: less accurate, with low latency."""

import numpy as np

from poise.robot.differentiation import GAP_INTERVALS, MIN_STRETCH, continuous_quaternions, turning
from poise.robot.motion import SensorMotion
from poise.robot.motion_buffers import BEGINNING, PairingReasons, PairingSettings, Samples, pair_moving
from poise.robot.sources import MotionSource
from poise.robot.splines import DEGREE, Design, Grid, SplineFit
from poise.types import Stamps

_SPAN = 600_000_000
"""ns of poses that take part; what is older would not change the answer."""

_KNOTS = 0.1
"""s between knots: resolves ordinary work of an arm."""

_LAG = 50_000_000
"""ns that answers stay behind the newest pose; nearer to it, accelerations are far more uncertain."""


class LowLatencyMotion:
    """A `MotionBuffer` that fits a spline to the newest poses at each update and keeps what is older than a lag."""

    def __init__(self, source: MotionSource, settings: PairingSettings) -> None:
        self._source, self._settings = source, settings
        self._poses = Samples(3)  # translation, m
        self._samples = Samples(9)  # angular velocity, angular and linear acceleration
        self.decided: int | None = None

    def update(self, flush: bool = False) -> None:
        newest = self._source.newest
        if newest is None:
            return
        held = self._poses.stamps
        fresh = self._source.poses(int(held[-1]) + 1 if len(held) else BEGINNING, newest)
        self._poses.append(fresh.stamps, fresh.rotation, fresh.translation)
        self._poses.forget_before(newest - _SPAN)
        ready = newest if flush else newest - _LAG
        self._work_out(ready)
        self.decided = ready

    def pair(self, stamps: Stamps) -> tuple[SensorMotion, PairingReasons]:
        return pair_moving(self._samples, stamps, self._settings.max_gap)

    def forget_before(self, stamp: int) -> None:
        self._samples.forget_before(stamp)

    def needs_from(self) -> int | None:
        held = self._poses.stamps
        return int(held[-1]) - round(self._settings.max_gap * 1e9) if len(held) else None

    def _work_out(self, ready: int) -> None:
        stamps = self._poses.stamps
        steps = np.diff(stamps)
        if len(stamps) < MIN_STRETCH or not steps.any():
            return
        breaks = np.flatnonzero(steps > GAP_INTERVALS * np.median(steps[steps > 0]))
        begin = int(breaks[-1]) + 1 if len(breaks) else 0
        known = self._samples.stamps
        edge = stamps[begin] + _LAG  # after a gap, too, accelerations are far more uncertain
        late = stamps[begin:] > (max(known[-1], edge) if len(known) else edge)
        wanted = begin + np.flatnonzero(late & (stamps[begin:] <= ready))
        if len(stamps) - begin < MIN_STRETCH or not len(wanted):
            return
        seconds = (stamps[begin:] - stamps[begin]) * 1e-9
        intervals = max(min(round(seconds[-1] / _KNOTS), len(seconds) // 2 - DEGREE), 1)
        rows = np.hstack([continuous_quaternions(self._poses.rotation[begin:]), self._poses.columns[begin:]])
        fit = SplineFit(Design(Grid.across(seconds, intervals), seconds), rows)
        at = seconds[wanted - begin]
        value, first, second = (fit(at, derivative) for derivative in range(3))
        rotation, omega, alpha = turning(value[:, :4], first[:, :4], second[:, :4])
        linear = np.einsum("nji,nj->ni", rotation, second[:, 4:])
        self._samples.append(stamps[wanted], rotation, np.hstack([omega, alpha, linear]))
