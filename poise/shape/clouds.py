"""Point clouds from files or arrays: validated, in metres, invalid points removed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.geometry import unique_rows
from poise.shape.cloud_formats import CLOUD_READERS, MAX_POINTS, CloudTable
from poise.types import Array, Indices, Mask

_MAX_BYTES = 400_000_000
_LEAST_NORMAL = 1e-6
_SMALLEST, _LARGEST = 2e-3, 5.0
"""m, diagonals between which a cloud can be of something that a robot carries."""
_LIKELY = 0.01, 1.0
"""m, diagonals between which the metre is believed to be the unit: an object in inches is 2 to 5 units long."""
_FEW_MILLIMETRES = 30.0
"""Units across below which millimetres are less likely than centimetres."""
_PLACEHOLDER, _TIMES = 10, 5.0
"""Rows of one place from which on it is no point, and over the median of all places."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Surface points of one object.

    Args:
        points: (N, 3) m, finite.
        colours: (N, 3) 0..1, or None.
        rows: (N,) where each point stands in the file or array.
        n_rows: how many rows that had.
        notes: what was found on the way, one sentence each.
        normals: (N, 3) outward unit normals, or None.
        seen: (N,) False where a scan completed the surface, or None when all of it was seen.
        doubt: (N,) m, one sigma of where completed surface is, or None when the file does not say.
        air: (K, 3) m, places that a scan saw through, on a grid, or None.
    """

    points: Array
    colours: Array | None
    rows: Indices
    n_rows: int
    notes: tuple[str, ...] = ()
    normals: Array | None = None
    seen: Mask | None = None
    doubt: Array | None = None
    air: Array | None = None

    def spread(self, labels: Indices) -> Indices:
        """(n_rows,) labels of all rows, given those (N,) of the points; -1 for rows that are not a point."""
        everywhere = np.full(self.n_rows, -1)
        everywhere[self.rows] = labels
        return everywhere


def read_cloud(path: Path, scale: float = 1.0) -> Cloud:
    """Read a PLY, PCD, XYZ, CSV or NPY file.

    Args:
        path: of the file; its ending says what it is.
        scale: from the file's unit to m (0.001 for mm).

    Raises:
        InputError: FILE_UNREADABLE, UNSUPPORTED, FILE_CORRUPT, TYPE_MISMATCH, and what `check_cloud` raises.
    """
    reader = CLOUD_READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: expected a cloud in {', '.join(CLOUD_READERS)}")
    try:
        if not path.is_file():
            raise InputError(
                ErrorCode.FILE_UNREADABLE, f"{path}: no such file; give a cloud in {', '.join(CLOUD_READERS)}"
            )
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise InputError(ErrorCode.UNSUPPORTED, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB; thin it out")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    table: CloudTable = reader(content, str(path))
    notes = () if not table.n_faces else (f"{path.name}: {table.n_faces} faces were left aside, its vertices used",)
    cloud = check_cloud(table.points, table.colours, scale, str(path), notes)
    seen = None if table.seen is None else table.seen[cloud.rows]
    if seen is not None and not seen.all():
        share = f"{np.mean(~seen):.0%} of the points were completed by a scan, not seen"
        cloud = replace(cloud, seen=seen, notes=(*cloud.notes, f"{share}: the volume's uncertainty includes that"))
        if table.doubt is not None and np.all(np.isfinite(table.doubt) & (table.doubt >= 0)):
            cloud = replace(cloud, doubt=scale * table.doubt[cloud.rows])
    if table.air is not None:
        cloud = replace(cloud, air=scale * table.air[np.isfinite(table.air).all(axis=1)])
    return cloud if table.normals is None else replace(cloud, normals=_unit(table.normals[cloud.rows]))


def _unit(normals: Array) -> Array | None:
    """Normals at length one; None when some are no directions."""
    lengths = np.linalg.norm(normals, axis=1)
    usable = np.all(np.isfinite(lengths) & (lengths > _LEAST_NORMAL))
    return normals / lengths[:, None] if usable else None


def check_cloud(
    points: ArrayLike,
    colours: ArrayLike | None = None,
    scale: float = 1.0,
    name: str = "cloud",
    notes: tuple[str, ...] = (),
) -> Cloud:
    """Check an array of points (N, 3) and colours (N, 3) 0..1; rows that are not finite are left out.

    Raises:
        InputError: TYPE_MISMATCH for shapes, EMPTY without a finite point, BAD_INPUT for a size that no object has
            (millimetres) or a scale that is not a positive number, UNSUPPORTED for too many points.
    """
    if not np.isfinite(scale) or scale <= 0:
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: scale {scale:g} is not a positive number")
    table = np.asarray(points, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 3:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{name}: points have shape {table.shape}, expected (N, 3)")
    if len(table) > MAX_POINTS:
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: {len(table)} points, at most {MAX_POINTS}; thin it out")
    shades = None if colours is None else np.asarray(colours, dtype=np.float64)
    if shades is not None and shades.shape != table.shape:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{name}: {len(table)} points but colours of shape {shades.shape}")
    rows = np.flatnonzero(np.all(np.isfinite(table), axis=1))
    if not len(rows):
        raise InputError(ErrorCode.EMPTY, f"{name}: none of {len(table)} points is finite; scan the object again")
    if len(rows) < len(table):
        notes = (*notes, f"{len(table) - len(rows)} of {len(table)} points are not finite and were left out")
    rows, notes = _without_placeholders(table, rows, notes)
    kept = table[rows] * scale
    notes = (*notes, *_check_size(kept, name))
    return Cloud(kept, None if shades is None else np.nan_to_num(shades[rows]), rows, len(table), notes)


def _without_placeholders(table: Array, rows: Indices, notes: tuple[str, ...]) -> tuple[Indices, tuple[str, ...]]:
    """Rows without those of one place that many have, and the notes with what was left out.

    Cameras write 0 0 0, or -9999 three times, where a pixel has no depth. A cloud in which each point stands several
    times has no such place.
    """
    if len(rows) < _PLACEHOLDER or not _often(table[rows, 0], _PLACEHOLDER):
        return rows, notes
    first, number = unique_rows(table[rows])
    counts = np.bincount(number)
    most = int(counts.argmax())
    if counts[most] < max(_PLACEHOLDER, _TIMES * float(np.median(counts))) or len(counts) < _PLACEHOLDER:
        return rows, notes
    place = ", ".join(f"{value:g}" for value in table[rows[first[most]]])
    return rows[number != most], (
        *notes,
        f"{counts[most]} of {len(table)} points are ({place}), as where a pixel has no depth, and were left out",
    )


def _often(values: Array, least: int) -> bool:
    """Whether some number is at least so often among values (N,)."""
    ordered = np.sort(values)
    return bool(np.any(ordered[least - 1 :] == ordered[: len(ordered) - least + 1]))


def _check_size(points: Array, name: str) -> tuple[str, ...]:
    """What to say of a size that few objects have; raises for one that none has."""
    # Quantiles: a single stray point does not turn metres into millimetres.
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if diagonal > _LARGEST:
        guess = f"millimetres? Then it is {diagonal:.0f} mm long: give a scale of 0.001 (--scale 0.001)"
        if diagonal < _FEW_MILLIMETRES:
            guess = (
                f"centimetres? Then it is {diagonal:.0f} cm long: give a scale of 0.01 (--scale 0.01; inches: 0.0254)"
            )
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: {diagonal:.3g} m across; are these {guess}", diagonal=diagonal)
    if diagonal < _SMALLEST:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: {diagonal:.3g} m across, too small for an object; are these metres? Fix --scale",
            diagonal=diagonal,
        )
    if _LIKELY[0] <= diagonal <= _LIKELY[1]:
        return ()
    return (
        f"{name} is {diagonal:.3g} m across, if its unit is the metre: if that is not so, state the unit (--scale 0.001"
        " for mm, 0.0254 for inches)",
    )
