"""Bringing stamps in order: a message that a network delivered late is put in its place, a clock that jumped is not."""

import numpy as np
import numpy.typing as npt

from poise.errors import ErrorCode, InputError

# How late a message may come and still be put in its place: networks delay by milliseconds, clocks jump by more.
MAX_LATENESS = 50_000_000  # ns
# A step of a clock shows against the log times of this many messages on either side, this many at least: the
# differences jump by far more than they scatter, while the log goes on. Both clocks run alike up to 1 %.
_AROUND, _FEWEST, _SCATTER, _HOLE, _RATE = 200, 20, 10.0, 0.3, 0.01
# Quantile of the differences that is compared: logs are late by chance, and never early.
_PROMPT = 0.9
# Holes that are examined.
_MOST_HOLES = 16
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


def holes(stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """The messages after which ascending stamps (N,), ns, lack others, the longest holes first."""
    steps = np.diff(stamps)
    if not steps.any():
        return np.zeros(0, dtype=np.intp)
    long = np.flatnonzero(steps > MAX_LATENESS + _period(steps))
    return long[np.argsort(-steps[long], kind="stable")][:_MOST_HOLES]


def _period(steps: npt.NDArray[np.int64]) -> float:
    """ns between stamps; some drivers repeat theirs."""
    return float(np.median(steps[steps > 0]))


def clock_steps(stamps: npt.NDArray[np.int64], logged: npt.NDArray[np.int64]) -> list[tuple[int, int]]:
    """Where a clock was set forward during a recording: the stamps have a hole that the log times lack.

    Args:
        stamps: (N,) ns, ascending.
        logged: (N,) ns, ascending; the same messages.

    Returns:
        (index of the first message after a step, ns by which the clock was set), in time.
    """
    steps, log_steps = np.diff(stamps), np.diff(logged)
    if np.count_nonzero(steps) < 2 * _FEWEST or np.ptp(logged) <= 0:
        return []
    period, behind, found = _period(steps), stamps - logged, []
    for i in holes(stamps).tolist():
        before, after = behind[max(i + 1 - _AROUND, 0) : i + 1], behind[i + 1 : i + 1 + _AROUND]
        if min(len(before), len(after)) < _FEWEST:
            continue
        jump = float(np.quantile(after, _PROMPT) - np.quantile(before, _PROMPT))
        scatter = max(float(np.median(np.abs(side - np.median(side)))) for side in (before, after))
        alike = abs(steps[i] - period - jump) < _HOLE * jump and log_steps[i] < _HOLE * jump + period
        if jump > max(MAX_LATENESS, _SCATTER * scatter) and alike:
            # The hole is the step and a whole number of periods.
            found.append((i + 1, round(steps[i] - period * max(round((steps[i] - jump) / period), 1))))
    rest = np.ptp(stamps) - sum(jump for _, jump in found)
    return sorted(found) if abs(rest / np.ptp(logged) - 1.0) < _RATE else []


def on_one_clock(
    stamps: npt.NDArray[np.int64], logged: npt.NDArray[np.int64], steps: list[tuple[int, int]]
) -> npt.NDArray[np.int64]:
    """Stamps (N,), ns, as if the clock had not been set: as it ran where it was nearest to the log."""
    later = np.zeros(len(stamps), dtype=np.int64)
    for first, jump in steps:
        later[first:] += jump
    even = stamps - later
    pieces = np.split(stamps - logged, [first for first, _ in steps])
    best = min(range(len(pieces)), key=lambda k: abs(float(np.median(pieces[k]))))
    return np.asarray(even + later[([0, *(first for first, _ in steps)])[best]])
