"""Whether the load of a recording changes enough to distinguish an effect of the sensor from simpler ones."""

import numpy as np

from poise.types import Array

_CHANGES = 0.02
"""Least share of a response that a gain and a bias of each channel do not have."""


def imitates_gain(load: Array, response: Array) -> str:
    """Why a response (N, 6) to the load (N, 6) shows no more than a gain and a bias of each channel; "" if it does."""
    pairs = zip(load.T, response.T, strict=True)
    left = sum(_left(np.column_stack([one, np.ones(len(one))]), seen) for one, seen in pairs)
    hardly = left < _CHANGES**2 * float(np.sum(response**2))
    return "the load hardly changes: a gain or a bias has the same response" if hardly else ""


def imitates_drift(course: Array, response: Array) -> str:
    """Why a response (N, 6) shows no more than a zero of each channel that follows a course (N,); "" if it does."""
    hardly = _left(course[:, None], response) < _CHANGES**2 * float(np.sum(response**2))
    return "the load hardly changes: a zero that drifts has the same response" if hardly else ""


def _left(known: Array, seen: Array) -> float:
    """The square of what columns (N, k) do not explain of a signal (N,) or of several (N, c)."""
    return float(np.sum((seen - known @ np.linalg.lstsq(known, seen, rcond=None)[0]) ** 2))
