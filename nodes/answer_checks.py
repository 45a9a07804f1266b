"""Answers are checked before they leave: bounds in order, and finite where their documentation says so."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from poise.errors import ErrorCode, PoiseError
from poise.nodes.map_message import MAP_POINT


def check_answer(response: Any) -> None:
    """Raise when the response of a robustness service contradicts itself.

    Raises:
        PoiseError: INTERNAL, naming the entry.
    """
    for margin in (*getattr(response, "margins", ()), getattr(response, "margin", 0.0)):
        _require(not math.isnan(margin), "margin", margin)
    for number, result in enumerate(getattr(response, "robustness", ())):
        in_order = 0 <= result.lower <= result.robustness <= result.upper
        _require(in_order, f"robustness[{number}]", (result.lower, result.robustness, result.upper))
        around = 0 <= result.interval_lower <= result.robustness <= result.interval_upper
        _require(around, f"interval of robustness[{number}]", (result.interval_lower, result.interval_upper))
        _require(_are_finite(result.mechanism), f"robustness[{number}].mechanism", result.mechanism)
    for found in getattr(response, "map", ()):
        points = np.frombuffer(found.cloud.data, MAP_POINT)
        good = (points["lower"] >= 0) & (points["lower"] <= points["upper"])
        for axis in "xyz":
            good &= np.isfinite(points[axis]) & np.isfinite(points[f"normal_{axis}"])
        _require(bool(good.all()), "map: points", int(np.count_nonzero(~good)))


def _are_finite(twists: Iterable[Any]) -> bool:
    return all(
        math.isfinite(value)
        for twist in twists
        for vector in (twist.linear, twist.angular)
        for value in (vector.x, vector.y, vector.z)
    )


def _require(holds: bool, name: str, value: Any) -> None:
    if not holds:
        raise PoiseError(
            ErrorCode.INTERNAL, f"the answer contradicts itself ({name}: {value}) and was withheld; please report it"
        )
