"""Whether the load of a recording changes enough to distinguish an effect of the sensor from a gain and a bias."""

import numpy as np

from poise.types import Array

_CHANGES = 0.02
"""Least share of a response that a gain and a bias of each channel do not have."""


def imitates_gain(load: Array, response: Array) -> str:
    """Why a response (N, 6) to the load (N, 6) shows no more than a gain and a bias of each channel; "" if it does."""
    left = 0.0
    for one, seen in zip(load.T, response.T, strict=True):
        known = np.column_stack([one, np.ones(len(one))])
        left += float(np.sum((seen - known @ np.linalg.lstsq(known, seen, rcond=None)[0]) ** 2))
    if left < _CHANGES**2 * float(np.sum(response**2)):
        return "the load hardly changes: a gain or a bias has the same response"
    return ""
