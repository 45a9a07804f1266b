"""A scanned object as a PLY file: points, colours, normals, and which of them were seen."""

import numpy as np

from poise.scanning.scan import Scan, levels_of
from poise.shape import HIDDEN_OFF

_ATTRIBUTES = (
    *(("double", axis) for axis in "xyz"), *(("float", f"n{axis}") for axis in "xyz"),
    *(("uchar", name) for name in ("red", "green", "blue", "seen")), ("float", "doubt"),
)  # fmt: skip
_TYPES = {"double": "<f8", "float": "<f4", "uchar": "u1"}


def scan_ply(found: Scan) -> bytes:
    """Binary PLY, m in the robot's base; `seen` is 0 where a point was completed, `doubt` one sigma of its place.

    The element `air` has the places that views look through.
    """
    rows = np.zeros(len(found.points), [(name, _TYPES[kind]) for kind, name in _ATTRIBUTES])
    shades = np.full_like(found.points, 0.7) if found.colours is None else found.colours
    columns = [*found.points.T, *found.normals.T, *levels_of(shades).T, found.seen]
    columns.append(np.where(found.seen, 0.0, HIDDEN_OFF) if found.doubt is None else found.doubt)
    for (_, name), column in zip(_ATTRIBUTES, columns, strict=True):
        rows[name] = column
    lines = ["ply", "format binary_little_endian 1.0", "comment metres, in the robot's base frame"]
    lines += [f"element vertex {len(rows)}", *(f"property {kind} {name}" for kind, name in _ATTRIBUTES)]
    air = np.zeros((0, 3)) if found.air is None else found.air
    lines += [f"element air {len(air)}", *(f"property double {axis}" for axis in "xyz")]
    return "\n".join([*lines, "end_header", ""]).encode() + rows.tobytes() + air.astype("<f8").tobytes()
