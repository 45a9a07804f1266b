"""Contact: a part of the recording is explained by a payload to the noise, and the rest has forces of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode
from poise.inertia.model import RejectedInterval
from poise.inertia.verdict import FitSamples
from poise.types import Array, Mask
from poise.weighing.fitting import Explanation, block_levels, explain, plain_design
from poise.weighing.moving_base import base_sentence, without_base
from poise.weighing.reading import Family, Reading, Says

_STARTS = 6
_ROUNDS = 4
_KEPT = 0.35
"""Share of blocks that the first rounds keep."""
_LOUDER = 2 * np.log(3.0)
"""A block is in contact when the logs of its force and torque residual together are this much above the free ones."""
_LEAST_FREE, _LEAST_TURN = 0.2, 0.5
_RARE = -4.0


def in_contact(pushed: Sequence[RejectedInterval]) -> Family:
    """The consistent part of a recording: least trimmed squares over blocks, from several starts (Rousseeuw 1984).

    The other part is explained by forces of its own, or by an acceleration of the base.

    Args:
        pushed: spans in which the estimator found contact; one of the starts.
    """
    return lambda samples, plain: _readings(samples, plain, pushed)


def _readings(samples: FitSamples, plain: Explanation, pushed: Sequence[RejectedInterval]) -> list[Reading]:
    n_blocks = len(plain.levels)
    if n_blocks < 12:
        return []
    block: NDArray[np.int64] = np.repeat(
        np.arange(n_blocks), [len(part) for part in np.array_split(np.arange(len(samples)), n_blocks)]
    )
    known = samples.outside(pushed)
    shares = np.bincount(block, known) / np.bincount(block)
    given = [] if known.all() else [shares > 0.5]
    parts = [_trimmed(samples, block, kept) for kept in (*_starts(plain.levels), *given)]
    free, _ = min(parts, key=lambda part: _cost(*part))
    if free.all() or free.mean() < _LEAST_FREE or not _informative(samples, free[block]):
        return []
    usable = np.repeat(free[block][:, None], 6, axis=1)
    touched = ~free[block]
    shared: dict[str, Any] = {"prior": _RARE, "usable": usable, "excluded": ~free}
    return [
        Reading(ErrorCode.IN_CONTACT, plain_design, _contact_sentence(samples, touched), **shared),
        Reading(
            ErrorCode.BASE_MOVED,
            plain_design,
            _base_sentence(samples, touched),
            reduced=lambda fit: np.where(touched[:, None], without_base(samples, fit)[0], fit.residual),
            **shared,
        ),
    ]


def _contact_sentence(samples: FitSamples, touched: Mask) -> Says:
    spans = _spans(samples.seconds, ~touched)
    times = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in spans[:4]) + (", ..." if spans[4:] else "")

    def says(fit: Explanation) -> tuple[str, Mapping[str, float]]:
        size = float(np.sqrt(np.mean(fit.residual[touched, :3] ** 2)))
        return (
            f"something touches the payload in {100 * touched.mean():.0f} % of the recording ({times}), with"
            f" {size:.2g} N rms: record without contact",
            {"share": float(touched.mean()), "force": size},
        )

    return says


def _base_sentence(samples: FitSamples, touched: Mask) -> Says:
    def says(fit: Explanation) -> tuple[str, Mapping[str, float]]:
        _, course = without_base(samples, fit)
        return base_sentence(float(np.percentile(np.linalg.norm(course[touched], axis=1), 90)))

    return says


def _informative(samples: FitSamples, free: Mask) -> bool:
    """The free part turns the sensor about as far as the recording does: a part at rest is always explained."""
    down = samples.gravity_in_sensor
    return bool(np.std(down[free], axis=0).sum() > _LEAST_TURN * np.std(down, axis=0).sum())


def _cost(free: Mask, found: Explanation) -> float:
    """Nats of a split: the level of its free blocks, and two parameters for each of the others."""
    if free.mean() < _LEAST_FREE:
        return np.inf
    return 3 * float(np.median(found.levels[free].sum(axis=1))) * len(free) + 6 * float((~free).sum())


def _starts(levels: Array) -> list[Mask]:
    """(B,) the blocks that the plain fit explains best, and stretches of the recording."""
    n_blocks = len(levels)
    keep = max(int(_KEPT * n_blocks), 6)
    found = [np.argsort(np.argsort(levels.sum(axis=1))) < keep]
    for start in range(_STARTS):
        first = round(start * (n_blocks - keep) / (_STARTS - 1))
        found.append((np.arange(n_blocks) >= first) & (np.arange(n_blocks) < first + keep))
    return found


def _trimmed(samples: FitSamples, block: NDArray[np.int64], start: Mask) -> tuple[Mask, Explanation]:
    """The free blocks (B,) that follow from a start, and their fit."""
    kept, keep = start, min(max(int(_KEPT * len(start)), 6), max(int(start.sum()), 6))
    for _ in range(_ROUNDS):
        found = explain(samples, plain_design, (), np.repeat(kept[block][:, None], 6, axis=1), quick=True)
        levels = block_levels(found.residual)
        size = levels.sum(axis=1)
        reference = float(np.median(size[kept]))
        kept = size < max(reference + _LOUDER, float(np.sort(size)[keep - 1]))
    return np.asarray(size < reference + _LOUDER), replace(found, levels=levels)


def _spans(seconds: Array, free: Mask) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[True], free, [True]]).astype(int)))
    return [
        (float(seconds[a]), float(seconds[min(b, len(seconds)) - 1]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
