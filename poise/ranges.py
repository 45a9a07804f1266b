"""What numbers an input may hold: one table of ranges for messages, scene files, the command line and Python."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.types import Array


class Range(NamedTuple):
    """Least and greatest value of an entry, its unit, and the code of a value outside and of one that is not finite."""

    least: float
    greatest: float
    unit: str
    code: ErrorCode = ErrorCode.BAD_INPUT
    not_finite: ErrorCode = ErrorCode.NOT_FINITE


RANGES = {
    "position": Range(-1e4, 1e4, "m"),
    "size": Range(1e-5, 1e3, "m", ErrorCode.OBJECT_INVALID),
    "mesh vertex": Range(-1e3, 1e3, "m", ErrorCode.MESH_INVALID),
    "mesh_scale": Range(1e-6, 1e3, "", ErrorCode.OBJECT_INVALID),
    "mass": Range(1e-6, 1e6, "kg", ErrorCode.OBJECT_INVALID),
    "mass per volume of the bounding box": Range(1e-3, 1e5, "kg/m3", ErrorCode.OBJECT_INVALID),
    "com": Range(-1e3, 1e3, "m"),
    "inertia": Range(-1e9, 1e9, "kg m2"),
    "covariance": Range(-1e12, 1e12, "kg, kg m, kg m2 squared"),
    "pose_covariance": Range(-1e2, 1e2, "m2, m rad, rad2"),
    "mass_std": Range(0.0, 1.0, "of the mass"),
    "position of pose_std": Range(0.0, 1.0, "m"),
    "rotation_deg of pose_std": Range(0.0, 45.0, "degrees"),
    "gravity": Range(0.1, 100.0, "m/s2"),
    "gravity of a recording": Range(1.5, 30.0, "m/s2", not_finite=ErrorCode.BAD_INPUT),
    "friction": Range(0.0, 10.0, ""),
    "rolling": Range(0.0, 1.0, ""),
    "point": Range(-1e4, 1e4, "m"),
    "direction": Range(-1e6, 1e6, ""),
    "length of direction": Range(1e-6, 1e6, ""),
    "map_tolerance": Range(1e-4, 1.0, "", not_finite=ErrorCode.BAD_INPUT),
    "deadline": Range(0.0, 1e9, "s", not_finite=ErrorCode.BAD_INPUT),
    "characters of an id": Range(1, 255, "", ErrorCode.OBJECT_INVALID),
}
"""Entries of requests, scene files and Python calls; docs/robustness_server.md shows the same table."""
_HINTS = {
    "friction": "; is it an angle in degrees? A coefficient is its tangent",
    "gravity of a recording": "; on Earth it is 9.81",
}
"""What else a value outside of its range may be."""
_ROUNDING = 1e-6
"""Share of its largest entry by which a covariance may miss symmetry and a positive determinant."""


def check_range(name: str, values: Any, where: str = "", **data: Any) -> None:
    """Raise unless all values are numbers in the range of this name.

    Args:
        name: in `RANGES`.
        values: a number, or an array of any shape.
        where: what has them, for the message.
        data: of the error, for programs.

    Raises:
        InputError: BAD_INPUT when they are no numbers; NOT_FINITE, BAD_INPUT, OBJECT_INVALID or MESH_INVALID, as the
            range says.
    """
    least, greatest, unit, code, not_finite = RANGES[name]
    if isinstance(values, float | int) and least <= values <= greatest:
        return
    numbers = _numbers(values, f"{where}{name}: expected a number", **data)
    outside = ~((numbers >= least) & (numbers <= greatest))
    if not outside.any():
        return
    worst = float(numbers[outside].flat[0])
    if numbers.ndim and len(numbers) > 1:
        where += f"entry {np.argwhere(outside)[0, 0]} of "
    if not math.isfinite(worst):
        raise InputError(not_finite, f"{where}{name} is {worst}, which is not finite", **data)
    hint = _HINTS.get(name, "")
    if unit == "m" and least <= worst / 1000 <= greatest:
        hint = "; is it in mm?"
    unit = unit and f" {unit}"
    what = f"{where}{name} is {worst:g}{unit}; it may be {least:g} to {greatest:g}{unit}{hint}"
    raise InputError(code, what, **data)


def vectors(name: str, values: Any, width: int = 3, where: str = "") -> Array:
    """(N, width) numbers in the range of this name, of N vectors.

    Raises:
        InputError: BAD_INPUT when they are no such vectors; as `check_range`.
    """
    found = _numbers(values, f"{where}{name}: expected {width} numbers each")
    if found.shape == (0,):
        return found.reshape(0, width)
    if found.ndim != 2 or found.shape[1] != width:
        raise InputError(
            ErrorCode.BAD_INPUT, f"{where}{name}: the shape is {found.shape}; expected {width} numbers each"
        )
    check_range(name, found, where)
    return found


def directions_of(values: Any, where: str = "") -> Array:
    """(N, 3) directions, each of a length in its range.

    Raises:
        InputError: as `vectors`.
    """
    found = vectors("direction", values, where=where)
    check_range("length of direction", np.linalg.norm(found, axis=1), where)
    return found


def _numbers(values: Any, expected: str, **data: Any) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{expected}, found {values!r:.80}", **data) from error


_COVARIANCE_SIZES = {"covariance": 10, "pose_covariance": 6}


def check_covariance(values: Sequence[float] | Array, where: str = "", name: str = "covariance") -> None:
    """Raise unless the numbers are a symmetric and positive semi-definite matrix: 100, or 36 of a `pose_covariance`.

    Raises:
        InputError: NOT_FINITE, BAD_INPUT.
    """
    size = _COVARIANCE_SIZES[name]
    if len(values) != size**2:
        raise InputError(ErrorCode.BAD_INPUT, f"{where}{name}: {len(values)} numbers; it has {size**2}, or none")
    check_range(name, values, where)
    matrix = np.asarray(values, dtype=np.float64).reshape(size, size)
    # Mass, first moment and inertia, like lengths and angles, have scales of their own: compare correlations.
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scaled = matrix / np.maximum(np.outer(scale, scale), 1e-300)
    flat = scale == 0
    if (
        np.any(np.diag(matrix) < 0)
        or np.any(matrix[flat])
        or not np.allclose(scaled, scaled.T, atol=_ROUNDING)
        or np.linalg.eigvalsh((scaled + scaled.T) / 2)[0] < -_ROUNDING
    ):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}{name} is not symmetric and positive semi-definite")
