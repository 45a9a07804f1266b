"""Derivatives while the robot moves: a sliding window of samples, answers a fraction of a second behind the newest."""

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.robot.differentiation import MIN_SAMPLES, Derivatives
from poise.robot.splines import Grid, SplineFit
from poise.types import Array

WINDOW = 32
"""Knot intervals kept before an answer: what is older would change it by a millionth of its error."""


class SlidingDifferentiator:
    """Differentiates a stream of samples with a fixed knot spacing.

    Push every sample, take what is ready when convenient. The knots stay where they are in time, so that an answer
    tends to the one of the whole recording on the same knots as its distance from the newest sample grows; the stated
    errors are those of the window, larger near its end.

    Args:
        knot_spacing: s; what `differentiate` chose for such a motion (0.1 s resolves ordinary work of an arm).
        lag: s that answers stay behind the newest sample; None: two knot intervals.
    """

    def __init__(self, knot_spacing: float = 0.1, lag: float | None = None) -> None:
        if not knot_spacing > 0.0:
            raise InputError(ErrorCode.BAD_INPUT, f"knot_spacing must be positive, got {knot_spacing}")
        self.knot_spacing = knot_spacing
        self.lag = 2.0 * knot_spacing if lag is None else lag
        self._stamps: deque[int] = deque()
        self._positions: deque[Array] = deque()
        self._origin = 0
        self._taken = 0  # stamp of the newest sample that was answered

    def push(self, stamp: int, position: ArrayLike) -> None:
        """Add a sample: stamp ns, position (J,). One that is not newer than the last is dropped.

        A jump of more than the window starts afresh.
        """
        if self._stamps:
            if stamp <= self._stamps[-1]:
                return
            if (stamp - self._stamps[-1]) * 1e-9 > self._window():
                self.clear()
        if not self._stamps:
            self._origin, self._taken = stamp, stamp - 1
        self._stamps.append(stamp)
        self._positions.append(np.asarray(position, dtype=np.float64))
        while (stamp - self._stamps[0]) * 1e-9 > self._window() + self.lag and self._stamps[0] <= self._taken:
            self._stamps.popleft()
            self._positions.popleft()

    def clear(self) -> None:
        """Forget all samples: after a jump in time, or when another robot takes over."""
        self._stamps.clear()
        self._positions.clear()

    def take(self) -> Derivatives | None:
        """Derivatives of the samples that have become ready since the last call; None when there are none."""
        if len(self._stamps) < MIN_SAMPLES:
            return None
        stamps = np.array(self._stamps, dtype=np.int64)
        ready = (stamps > self._taken) & (stamps <= stamps[-1] - round(self.lag * 1e9))
        if not ready.any():
            return None
        seconds: Array = (stamps - self._origin) * np.float64(1e-9)
        values: Array = np.array(self._positions)
        spline = SplineFit(Grid.at_multiples(seconds, self.knot_spacing), seconds, values)
        self._taken = int(stamps[ready][-1])
        parts = [spline(seconds[ready], d) for d in range(3)]
        sigmas = [spline.gain(seconds[ready], d)[:, None] * spline.sigma for d in range(3)]
        spacing = np.full(values.shape[1], self.knot_spacing)
        return Derivatives(stamps[ready], parts[0], parts[1], parts[2], sigmas[0], sigmas[1], sigmas[2], spacing)

    def _window(self) -> float:
        return WINDOW * self.knot_spacing
