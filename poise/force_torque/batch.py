"""Many samples to a message: what a fast sensor's every sample travels in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.force_torque.clock import SampleClock
from poise.force_torque.decimation import Stamped
from poise.force_torque.sequence import SequenceCounter
from poise.force_torque.wire import SensorSamples
from poise.types import Array


@dataclass(frozen=True)
class SampleBatch:
    """Consecutive samples, saturated and faulty ones included, and the counts since activation.

    Attributes:
        stamp: ns when the first was measured.
        period: s between samples, as measured; 0 for a device without a sample clock.
        sequence: (N,) uint32 of the device; a gap is a loss.
        wrench_in_sensor: (N, 6) N and N m.
        status: (N,) uint32.
        received, lost, out_of_order: see sequence.SequenceCounter.
    """

    stamp: int
    period: float
    sequence: NDArray[np.uint32]
    wrench_in_sensor: Array
    status: NDArray[np.uint32]
    received: int
    lost: int
    out_of_order: int


class Batcher:
    """Collects samples until a batch's time is full.

    Args:
        rate: batches per second; 0: none.
    """

    def __init__(self, rate: float) -> None:
        self._length = round(1e9 / rate) if rate > 0 else 0
        self._parts: list[tuple[SensorSamples, Stamped]] = []

    def push(
        self, samples: SensorSamples, stamped: Stamped, counter: SequenceCounter, clock: SampleClock | None
    ) -> SampleBatch | None:
        """Take the samples of a read (`stamped` are the same with the bias taken off); return a batch when full."""
        if not self._length:
            return None
        if len(samples):
            self._parts.append((samples, stamped))
        if not self._parts:
            return None
        if int(self._parts[-1][1].stamps[-1]) - int(self._parts[0][1].stamps[0]) < self._length:
            return None
        return self.flush(counter, clock)

    def flush(self, counter: SequenceCounter, clock: SampleClock | None) -> SampleBatch | None:
        """What has been collected so far."""
        if not self._parts:
            return None
        parts, self._parts = self._parts, []
        return SampleBatch(
            stamp=int(parts[0][1].stamps[0]),
            period=clock.period / 1e9 if clock else 0.0,
            sequence=np.concatenate([raw.sequence for raw, _ in parts]),
            wrench_in_sensor=np.concatenate([stamped.wrench_in_sensor for _, stamped in parts]),
            status=np.concatenate([raw.status for raw, _ in parts]),
            received=counter.received,
            lost=counter.lost,
            out_of_order=counter.out_of_order,
        )
