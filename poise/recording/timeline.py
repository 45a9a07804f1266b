"""Bringing stamps in order: a message that a network delivered late is put in its place, a clock that jumped is not."""

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError

# How late a message may come and still be put in its place: networks delay by milliseconds, clocks jump by more.
MAX_LATENESS = 50_000_000  # ns
# Late messages that make the samples this much denser than elsewhere walk through the same time again.
_DENSER = 1.5


def in_time_order(stamps: npt.NDArray[np.int64], topic: str) -> tuple[npt.NDArray[np.int64], int]:
    """Return the order that sorts the stamps, and how many messages came late.

    A message is late when one with a greater stamp came before it. Reordering leaves as many samples in any
    stretch of time as there should be; a clock that was set back leaves about twice as many.

    Args:
        stamps: (N,) ns, in the order of arrival.
        topic: for the error.

    Raises:
        InputError: TIME_BACKWARDS when a message is later than MAX_LATENESS, or when the clock was set back.
    """
    order = np.argsort(stamps, kind="stable")
    latest = np.maximum.accumulate(stamps)
    late = stamps < latest
    if not late.any():
        return order, 0
    starts = np.flatnonzero(late & ~np.r_[False, late[:-1]])
    first = np.minimum.reduceat(np.where(late, stamps, latest), starts)  # of each run of late messages
    lateness = latest[starts] - first
    ordered = stamps[order]
    steps = np.diff(ordered)
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    found = np.searchsorted(ordered, latest[starts], "right") - np.searchsorted(ordered, first, "left")
    jumped = (lateness > MAX_LATENESS) | (found > _DENSER * (lateness / period + 1) + 1)
    if jumped.any():
        at = int(starts[np.argmax(jumped)])
        back = (latest[at] - stamps[at]) * 1e-9
        raise InputError(
            ErrorCode.TIME_BACKWARDS,
            f"{topic}: the stamps go back by {back:.6f} s at message {at} (stamp {stamps[at]} ns), as when a clock is "
            "set during a recording: cut the recording there and use the parts one by one",
            topic=topic,
            index=at,
            stamp=int(stamps[at]),
        )
    return order, int(late.sum())
