"""Columns averaged in blocks and whitened, and the most likely coloured noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array, Mask


@dataclass(frozen=True, eq=False)
class WhiteningFilters:
    """The filters of C channels for M samples, or blocks of them; needs `COMPILED`.

    Args:
        scale: (C,) factor on the values.
        plain: (C,) 1 where the factor is all.
        filters: (4, C, M) gain of the state in a sample, what is left of it at the next one, what of a value enters
            it, and weight of the innovation.
    """

    scale: Array
    plain: NDArray[np.int64]
    filters: Array

    def __call__(
        self, values: Array, counting: Mask, rows: NDArray[np.intp] | None, channel: NDArray[np.intp] | None = None
    ) -> Array:
        """(k, C K) whitened values, or means of values, channel by channel.

        Args:
            values: (N, C, k); or (N, k), columns that act in one channel each.
            counting: (M,) which of the samples, or blocks, are in the answer: K of them.
            rows: (M, b) consecutive samples of each block; None: M is N.
            channel: (k,) the channels of such columns.

        Raises:
            InputError: TYPE_MISMATCH for arrays of other shapes.
        """
        outputs, blocks = self.filters.shape[1:]
        given = np.asarray(values, dtype=np.float64)
        if any(step % given.itemsize for step in given.strides):
            given = np.array(given)
        wide = given if channel is None else given[:, None]
        length, first = (1, np.arange(len(given))) if rows is None else (rows.shape[1], rows[:, 0].astype(np.int64))
        inside = len(first) == len(counting) == blocks and (
            not blocks or 0 <= first.min() <= first.max() + length <= len(given)
        )
        if wide.ndim != 3 or wide.shape[1] != (outputs if channel is None else 1) or not inside:
            raise InputError(ErrorCode.TYPE_MISMATCH, f"values of shape {given.shape} do not fit {blocks} blocks")
        places = None if channel is None else _places(channel, wide.shape[2], outputs)
        keep = np.flatnonzero(counting)
        white = np.empty((wide.shape[2], outputs * len(keep)))
        if white.size:
            strides = np.array(wide.strides[::-1], dtype=np.int64) // given.itemsize
            blocked = blocks, length, address(first), address(places), outputs
            own = address(self.scale), address(self.plain), address(self.filters)
            kept = len(keep), address(keep), address(white)
            shape = wide.shape[2], wide.shape[1]
            check(library.poise_whitened(*shape, address(strides), given.ctypes.data, *blocked, *own, *kept))
        return white


def _places(channel: NDArray[np.intp], count: int, channels: int) -> NDArray[np.int64]:
    """The channels (k,) of columns, checked.

    Raises:
        InputError: TYPE_MISMATCH for another number, or channels that do not exist.
    """
    places = np.ascontiguousarray(channel, dtype=np.int64)
    if places.shape != (count,) or (count and not 0 <= places.min() <= places.max() < channels):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{count} columns cannot act in the channels {channel}")
    return places


def likely_colours(
    values: Array,
    speed: Array,
    motion: Array | None,
    colours: tuple[Array, Array, Array, NDArray[np.int64]],
    decays: Array,
    bounds: tuple[Array, Array],
) -> tuple[NDArray[np.int64], Array]:
    """The most likely colour of each channel, and the variance of its white part (C,); needs `COMPILED`.

    The colour is -1 where values are not finite.

    Args:
        values: (N, C).
        speed: (N,).
        motion: (N, C) variance by errors of the motion, in units of the white level's; None: there is none.
        colours: (K,) each: floor, slope, share of `motion`, and number of the decay.
        decays: (T, N) of the state, to the next sample.
        bounds: (C,) least and largest variance.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """
    given = contiguous(values, -1, -1, what="values")
    count, channels = given.shape
    moved = None if motion is None else contiguous(motion.T, channels, count, what="variances")
    course = np.ascontiguousarray(colours[3], dtype=np.int64)
    floor, slope, share = (contiguous(each, len(course), what="colours") for each in colours[:3])
    kept = contiguous(decays, -1, count, what="decays")
    usual = np.median(kept, axis=1) ** 2
    least, most = (contiguous(each, channels, what="bounds") for each in bounds)
    rate = contiguous(speed, count, what="speeds")
    if not count or not len(course) or course.min() < 0 or course.max() >= len(kept):
        raise InputError(ErrorCode.TYPE_MISMATCH, "there are no samples, or the decays are not those of the colours")
    chosen: NDArray[np.int64] = np.empty(channels, dtype=np.int64)
    likely = np.zeros(channels)
    arrays = map(address, (floor, slope, share, course, kept, usual, least, most, chosen, likely))
    series = address(given), address(rate), address(moved)
    check(library.poise_likely_colours(count, channels, *series, len(course), *arrays))
    return chosen, likely
