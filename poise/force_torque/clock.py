"""Stamps without jitter: the device's count of samples, laid under the times at which they arrived.

A sample arrives after it was measured, by a delay that varies and is never negative. So the line time(count) lies
below all observed (count, arrival) pairs, as high as it can: the supporting line of their lower convex hull that
minimises the sum of the delays (S. Moon, P. Skelly, D. Towsley, Estimation and removal of clock skew from network
delay measurements, INFOCOM 1999). The constant least delay (wire, device filter) cannot be seen from here.
"""

import itertools
from collections import deque

import numpy as np
from numpy.typing import NDArray

_BUCKET = 100_000_000
"""ns; the least delayed pair of every bucket is kept."""
_BUCKETS = 100
"""How many buckets the line is fitted to: 10 s."""
_LEAST_BUCKETS = 5
"""Below this the nominal period is used."""
_JUMP = 50_000_000
"""ns; a larger step means that the host clock was set."""


class SampleClock:
    """Time of measurement of numbered samples, on the host's clock.

    Args:
        period: nominal time between samples, ns; a start value only.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._pairs: deque[tuple[int, int]] = deque(maxlen=_BUCKETS)
        self._bucket: tuple[int, int] | None = None
        self._bucket_end = 0
        self._anchor = (0, 0)
        self._last_stamp = 0

    def observe(self, position: int, arrival: int) -> None:
        """Take the arrival time of a sample: its `position` in the count, `arrival` ns."""
        if self._bucket is None:
            self._restart(position, arrival)
            return
        delay = arrival - self._time(position)
        if delay < -_JUMP:  # the host clock was set back
            self._restart(position, arrival)
            return
        if delay < 0:  # nothing arrives before it is measured
            self._anchor = (position, arrival)
        if arrival < self._bucket_end:
            if delay < self._delay(self._bucket):
                self._bucket = (position, arrival)
            return
        self._pairs.append(self._bucket)
        self._bucket = (position, arrival)
        self._bucket_end = arrival + _BUCKET
        self._fit()

    def stamps(self, positions: NDArray[np.int64]) -> NDArray[np.int64]:
        """When these samples were measured: (N,) ns, later from one to the next."""
        position, time = self._anchor
        stamps: NDArray[np.int64] = time + np.rint((positions - position) * self.period).astype(np.int64)
        floor = np.arange(self._last_stamp + 1, self._last_stamp + 1 + len(stamps))
        stamps = np.maximum(stamps, floor)
        if len(stamps):
            self._last_stamp = int(stamps[-1])
        return stamps

    def restart(self) -> None:
        """Forget the relation of count and time, but not the period (the device restarted its count)."""
        self._bucket = None

    def _restart(self, position: int, arrival: int) -> None:
        self._pairs.clear()
        self._bucket = (position, arrival)
        self._bucket_end = arrival + _BUCKET
        self._anchor = (position, arrival)
        self._last_stamp = min(self._last_stamp, arrival)

    def _time(self, position: int) -> int:
        return self._anchor[1] + round((position - self._anchor[0]) * self.period)

    def _delay(self, pair: tuple[int, int]) -> int:
        return pair[1] - self._time(pair[0])

    def _fit(self) -> None:
        recent = list(self._pairs)[-_LEAST_BUCKETS:]
        if len(recent) < _LEAST_BUCKETS:
            return
        if len(self._pairs) > _LEAST_BUCKETS and all(self._delay(pair) > _JUMP for pair in recent):
            self._pairs = deque(recent, maxlen=_BUCKETS)  # the host clock was set forward
        (x0, y0), (x1, y1) = lower_support(list(self._pairs))
        if x1 > x0:
            self.period = (y1 - y0) / (x1 - x0)
        self._anchor = (x0, y0)


def lower_support(points: list[tuple[int, int]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The edge of the lower convex hull under the mean abscissa: no line below all points is closer to them in sum.

    Args:
        points: (x, y), x never falling.

    Returns:
        The two ends of the edge (the same point twice when there is but one abscissa).
    """
    hull: list[tuple[int, int]] = []
    for x, y in points:
        while len(hull) > 1:
            (ax, ay), (bx, by) = hull[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            hull.pop()
        hull.append((x, y))
    mean = sum(x for x, _ in points) / len(points)
    for left, right in itertools.pairwise(hull):
        if left[0] <= mean <= right[0] and left[0] < right[0]:
            return left, right
    return hull[0], hull[0]
