"""Order of the rows of arrays, distinct rows and numbers, rows that are used, and runs of them."""

import numpy as np

from poise.types import Array, Indices, Mask

_MOST_PACKED = 2**31


def unique_rows(rows: Array | Indices) -> tuple[Indices, Indices]:
    """Distinct rows of an array, in lexicographic order.

    As `numpy.unique` with axis 0, which compares rows as records and takes five times as long.

    Args:
        rows: (N, C), finite.

    Returns:
        (K,) index of the first of each distinct row, and (N,) which of these each row is.
    """
    order = row_order(rows)
    ordered = rows[order]
    new = np.append(np.ones(min(len(rows), 1), dtype=bool), np.any(ordered[1:] != ordered[:-1], axis=1))
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return order[new], number


def row_order(rows: Array | Indices) -> Indices:
    """(N,) lexicographic order of rows (N, C), stable; pairs of small integers are packed into one number each."""
    if rows.shape[1] == 2 and rows.dtype.kind == "i" and rows.size and rows.min() >= 0 and rows.max() < _MOST_PACKED:
        packed = rows[:, 0].astype(np.int64) * _MOST_PACKED + rows[:, 1]
        return np.argsort(packed, kind="stable")
    return np.lexsort(rows.T[::-1])


def distinct_numbers(numbers: Indices) -> Indices:
    """Distinct whole numbers of an array of any shape, ascending.

    As `numpy.unique`, which puts them into a table of hashes since NumPy 2.3; of many that takes ten times as long.
    """
    ordered = np.sort(numbers, axis=None)
    return np.asarray(ordered[np.append(np.ones(min(len(ordered), 1), dtype=bool), ordered[1:] != ordered[:-1])])


def used_rows(numbers: Indices, count: int) -> tuple[Mask, Indices]:
    """(count,) which rows an array of row numbers uses, and the array with the numbers among those."""
    used = np.bincount(numbers.ravel(), minlength=count) > 0
    return used, (np.cumsum(used) - 1)[numbers]


def runs(inside: Mask) -> list[tuple[int, int]]:
    """First and last index of each run of a mask (N,)."""
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]
