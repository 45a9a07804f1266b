"""Wrenches that cannot be what they claim: wrong units, the opposite sign, single samples that jump out."""

import warnings

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.world import World

NEIGHBOURS = (-6, -5, -4, -3, -2, 2, 3, 4, 5, 6)
"""Samples that say what one in their middle should be like."""
MAX_SPIKES = 0.03
"""Share of samples that may be spikes; more of them are no accidents."""


def check_wrench(world: World, name: str) -> None:
    """Refuse a wrench whose units or sign are not the contract's.

    Force and torque are each regressed on the prediction, both without their means.

    Raises:
        InputError: BAD_INPUT, with what to do.
    """
    read, said = (values - values.mean(axis=0) for values in (world.wrench, world.prediction))
    gains, likeness = [], []
    for part in (slice(0, 3), slice(3, 6)):
        a, b = read[:, part], said[:, part]
        gains.append(float(np.sum(a * b) / max(np.sum(b * b), 1e-12)))
        likeness.append(float(np.sum(a * b) / max(np.sqrt(np.sum(a * a) * np.sum(b * b)), 1e-12)))
    if likeness[0] < -0.9 and -2.0 < gains[0] < -0.5:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: the wrench has the opposite sign: it is what the sensor exerts on the load (weight reads up); "
            "negate it, the contract is what the load exerts on the sensor",
            gain=gains[0],
        )
    for index, (what, unit, small) in enumerate((("force", "N", "mN"), ("torque", "N m", "N mm"))):
        if abs(likeness[index]) > 0.9 and abs(gains[index]) > 200.0:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"{name}: the {what} is {abs(gains[index]):.0f} times what the model says: it seems to be in {small}; "
                f"the contract is {unit}",
                gain=gains[index],
            )


def without_spikes(world: World) -> tuple[World, list[str]]:
    """The world without single samples that stand far out of their neighbours (lost bits, not physics)."""
    residual = world.wrench - world.prediction
    out = np.zeros(len(world), dtype=bool)
    for _ in range(2):  # what was found does not hide its neighbours
        calm = np.where(out[:, None], np.nan, residual)
        with warnings.catch_warnings():  # where no neighbour is good, nothing is known: NaN is right
            warnings.simplefilter("ignore", RuntimeWarning)
            around = np.nanmedian(np.stack([np.roll(calm, shift, axis=0) for shift in NEIGHBOURS]), axis=0)
        off = residual - around
        spread = 1.4826 * np.nanmedian(np.abs(off), axis=0)
        out = np.nan_to_num(np.abs(off / np.maximum(spread, 1e-9)).max(axis=1)) > 8.0
        out[:6] = out[-6:] = False
    beside = np.convolve(out.astype(float), np.ones(5), mode="same") > 2.5
    out &= ~beside
    if not out.any() or out.mean() > MAX_SPIKES:
        return world, []
    return world.select(~out), [f"{int(out.sum())} wrench samples stand alone far out of line and were left out"]
