"""What a sensor shows at rest: the mean of some samples, and whether it was at rest at all."""

from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, NoAnswerError, SensorError
from poise.types import Array

_PARTS = 10
"""Rest is judged by the means of this many consecutive parts: noise averages out of them, motion does not."""
MAX_DRIFT = np.repeat([0.5, 0.02], 3)
"""N and N m between the largest and the smallest part."""


@dataclass(frozen=True)
class Bias:
    """A zero of the sensor.

    Attributes:
        wrench_in_sensor: (6,) mean, N and N m: subtract it.
        spread: (6,) standard deviation of the samples.
        drift: (6,) largest minus smallest mean of the parts.
        count: samples.
    """

    wrench_in_sensor: Array
    spread: Array
    drift: Array
    count: int


def estimate_bias(wrench_in_sensor: Array, max_drift: Array = MAX_DRIFT) -> Bias:
    """Average samples that were taken at rest.

    Args:
        wrench_in_sensor: (N, 6) consecutive samples, N >= 10.
        max_drift: (6,) how far the parts' means may lie apart, N and N m.

    Raises:
        NoAnswerError: TOO_FEW_SAMPLES; or NOT_IDENTIFIABLE, when the load moves.
    """
    count = len(wrench_in_sensor)
    if count < _PARTS:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES, f"{count} samples are too few for a bias; take at least {_PARTS}"
        )
    means = np.array([part.mean(axis=0) for part in np.array_split(wrench_in_sensor, _PARTS)])
    drift = np.ptp(means, axis=0)
    if np.any(drift > max_drift):
        axis = int(np.argmax(drift / max_drift))
        name, unit = ("fx", "fy", "fz", "tx", "ty", "tz")[axis], "N" if axis < 3 else "N m"
        raise NoAnswerError(
            ErrorCode.NOT_IDENTIFIABLE,
            f"the load moves: {name} wandered by {drift[axis]:.3g} {unit} (at most {max_drift[axis]:.3g}); "
            "hold the arm still and ask again",
            drift=drift,
        )
    return Bias(wrench_in_sensor.mean(axis=0), wrench_in_sensor.std(axis=0), drift, count)


class BiasJob:
    """Collects the samples of one bias request; its future holds the Bias, or the error.

    Args:
        count: samples to average.
    """

    def __init__(self, count: int) -> None:
        self.future: Future[Bias] = Future()
        self._count = count
        self._parts: list[Array] = []
        self._collected = 0

    def feed(self, wrench_in_sensor: Array, usable: bool) -> None:
        """Take the samples of a read, (N, 6); `usable` is False when any is saturated or faulty."""
        if self.future.done():
            return
        if not usable:
            self.fail(
                SensorError(ErrorCode.SENSOR_SATURATED, "a sample is saturated or faulty; unload the sensor, ask again")
            )
            return
        self._parts.append(wrench_in_sensor)
        self._collected += len(wrench_in_sensor)
        if self._collected < self._count:
            return
        try:
            self.future.set_result(estimate_bias(np.concatenate(self._parts)[: self._count]))
        except NoAnswerError as error:
            self.fail(error)

    def fail(self, error: Exception) -> None:
        """End without a bias."""
        if not self.future.done():
            self.future.set_exception(error)
