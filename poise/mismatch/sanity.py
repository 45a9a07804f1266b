"""Wrenches that cannot be what they claim: wrong units, the opposite sign, single samples that jump out."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.world import World

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
    around = np.stack([np.roll(residual, shift, axis=0) for shift in (-3, -2, 2, 3)])
    off = residual - np.median(around, axis=0)
    spread = 1.4826 * np.median(np.abs(off), axis=0)
    largest = np.abs(off / np.maximum(spread, 1e-9)).max(axis=1)
    out = largest > 8.0
    out[:3] = out[-3:] = False
    beside = np.convolve(out.astype(float), np.ones(5), mode="same") > 2.5
    out &= ~beside
    if not out.any() or out.mean() > MAX_SPIKES:
        return world, []
    return world.select(~out), [f"{int(out.sum())} wrench samples stand alone far out of line and were left out"]
