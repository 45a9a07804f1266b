"""Which wrench samples are compared: finite ones, averaged down to a rate that the motion can follow."""

from typing import TypeVar

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.recorded import lattice
from poise.recording import Stream, WrenchStream
from poise.robot import blanks, each_stamp_once, interpolated, left_out
from poise.types import Array, Stamps

Measured = TypeVar("Measured", bound=Stream)

MAX_WRENCH_RATE = 250.0
"""Hz; a faster wrench is averaged down to about this rate."""
MAX_WRENCH_SAMPLES, MIN_WRENCH_RATE = 15_000, 25.0
"""Samples of a recording that are compared at most. A longer one is averaged further, down to this rate in Hz."""

_ALIKE = 0.5
"""Share of means of readings that are all equal, from which the converter is coarse."""
_FEWEST_RUNS, _REGULAR = 50, 0.9
"""Changes of the readings, and the share of them that come after the usual number of samples, for repetitions."""


def usable(wrench: WrenchStream) -> tuple[WrenchStream, list[str]]:
    """Without NaN and repeated stamps, at no more than MAX_RATE, and no longer than MOST_SAMPLES last."""
    infinite = np.asarray(~np.isfinite(wrench.wrench_in_sensor).all(axis=1))
    wrench, notes = left_out(wrench, infinite, "wrench samples are not finite")
    wrench = each_stamp_once(wrench)
    blank = blanks(wrench.wrench_in_sensor)
    wrench, said = left_out(wrench, blank, "wrench samples are zero between others that are not,")
    notes += said
    wrench, said = _measured_anew(wrench)
    notes += said
    between = interpolated(wrench, wrench.wrench_in_sensor)
    wrench, said = left_out(wrench, between, "wrench samples lie on lines between others")
    notes += said
    if len(wrench) < 100:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"{len(wrench)} usable wrench samples are too few to compare: record ten seconds or more at 50 Hz or more",
        )
    wrench, said = begun(wrench)
    notes += said
    period = float(np.median(np.diff(wrench.stamps))) * 1e-9
    rate = min(MAX_WRENCH_SAMPLES / (len(wrench) * period), MAX_WRENCH_RATE)
    together = int(np.ceil(1.0 / period / rate - 0.05))
    if together > 1:
        values = averaged_readings(wrench.wrench_in_sensor, together)
        wrench = WrenchStream(mean_stamps(wrench.stamps, together), values, wrench.frame_id)
        notes.append(f"the wrench came at {1 / period:.0f} Hz; {together} samples each were averaged")
    return wrench, notes


def _measured_anew(wrench: WrenchStream) -> tuple[WrenchStream, list[str]]:
    """Without the repetitions of a driver that publishes faster than the sensor measures, and a note on them.

    The readings of a coarse sensor repeat as well, but irregularly.
    """
    new = np.concatenate([[True], (np.diff(wrench.wrench_in_sensor, axis=0) != 0.0).any(axis=1)])
    begins = np.flatnonzero(new)
    times = np.diff(begins)
    if len(times) < _FEWEST_RUNS:
        return wrench, []
    usual = float(np.median(times))
    if usual < 2.0 or np.mean(np.abs(times - usual) <= 1.0) < _REGULAR:
        return wrench, []
    kept = wrench.select(new)
    return kept, [
        f"the driver repeats each measured wrench {usual:.0f} times; {len(kept)} of {len(wrench)} were compared"
    ]


def begun(stream: Measured) -> tuple[Measured, list[str]]:
    """The beginning of a stream, as long as is compared, and a note when something follows."""
    longest = MAX_WRENCH_SAMPLES / MIN_WRENCH_RATE
    inside = stream.stamps - stream.stamps[0] <= longest * 1e9
    if inside.all():
        return stream, []
    kept = stream.select(inside)
    jump = float(stream.stamps[len(kept)] - kept.stamps[-1]) * 1e-9
    if jump > longest / 10.0:
        last = kept.seconds[-1]
        note = f"the stamps jump by {jump:.0f} s at {last:.1f} s: only what is before was compared; is the clock right?"
    else:
        note = f"the recording is longer than {longest:.0f} s: only that much of its beginning was compared"
    return kept, [note]


def averaged(values: Array, together: int) -> Array:
    """(N, ...) -> (N // together, ...) means of consecutive samples."""
    count = len(values) // together * together
    return np.asarray(values[:count].reshape(-1, together, *values.shape[1:]).mean(axis=1))


def averaged_readings(values: Array, together: int) -> Array:
    """(N, C) -> (N // together, C) means of consecutive readings, on the grid of a converter that is coarse.

    Where most readings equal those beside them, their mean is as wrong as each of them, by the rounding. Means on a
    finer grid would look more exact, and their small changes like those of a fine converter.
    """
    means, count = averaged(values, together), len(values) // together * together
    spread = np.ptp(values[:count].reshape(-1, together, values.shape[1]), axis=1)
    for channel in np.flatnonzero(np.mean(spread == 0.0, axis=0) >= _ALIKE).tolist():
        step = lattice(values[:, channel])
        if step > 0.0:
            means[:, channel] = np.round(means[:, channel] / step) * step
    return means


def mean_stamps(stamps: Stamps, together: int) -> Stamps:
    """(N,) ns -> (N // together,) means of consecutive stamps."""
    return np.asarray(averaged((stamps - stamps[0]).astype(np.float64), together).round().astype(np.int64) + stamps[0])
