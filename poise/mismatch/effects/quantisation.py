"""Quantisation: the reading comes in steps that are coarser than the noise."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.effects.base import Array, Effect, Parameter, Values
from poise.mismatch.world import World

FINEST = (1e-3, 1e-5)
"""N, N m: finer steps do not matter to anyone."""


class Quantisation(Effect):
    """w_read = step round(w / step), forces and torques each with one step; the last thing that happens to a reading.

    A residual hardly shows it (what is rounded off looks like noise), the readings themselves do: all of them are
    whole multiples of the step. `starts` reads it there, and yields nothing when there is no such step.
    """

    name = "quantisation"
    layer = "sensor"
    fast = True
    equation = "w_read = step round(w / step)"
    source = "uniform quantiser; error step / sqrt(12) when it is busy (Widrow and Kollar 2008)"
    excited_by = "anything: every reading is a multiple of the step"
    separating_motion = "none needed; a slow turn under load shows the stairs one by one"
    confused_with = ()
    order = 100

    def parameters(self, world: World) -> tuple[Parameter, ...]:
        del world
        return tuple(
            Parameter(f"{what}_step", unit, low=fine, high=1e4 * fine, linear=False, log=True, resolution=1e-3 * fine)
            for what, unit, fine in zip(("force", "torque"), ("N", "N m"), FINEST, strict=True)
        )

    def starts(self, world: World, residual: Array) -> Iterable[Values]:
        del residual
        found = self.found(world)
        if found is not None:
            yield found

    @staticmethod
    def found(world: World) -> dict[str, float] | None:
        """The steps that the readings are multiples of, or None when neither forces nor torques are on any grid."""
        steps = [lattice(world.wrench[:, part]) for part in (slice(0, 3), slice(3, 6))]
        if not any(steps):
            return None
        return {f"{what}_step": max(s, fine) for what, s, fine in zip(("force", "torque"), steps, FINEST, strict=True)}

    def simulate(self, world: World, values: Values) -> Array:
        step = np.repeat([values["force_step"], values["torque_step"]], 3)
        return np.asarray(np.round(world.prediction / step) * step - world.prediction)

    def sentence(self, world: World, values: Values) -> str:
        del world
        return (
            f"The readings come in steps of {values['force_step']:.3g} N and {values['torque_step']:.3g} N m: "
            "the nominal sensor has none."
        )


def lattice(values: NDArray[np.float64]) -> float:
    """The step of which all values are whole multiples, 0 when there is none.

    A grid that was rounded once more, to one much finer, still counts; readings at the largest magnitude may be those
    of a limit and do not. On a grid many readings are equal, which those of a fine converter are not.

    Args:
        values: any shape; NaN are left out.
    """
    flat = values[np.isfinite(values)]
    size = float(np.abs(flat).max()) if len(flat) else 0.0
    flat = flat[np.abs(flat) < size * (1.0 - 1e-9)]
    levels = np.unique(np.round(flat / max(size, 1e-300), 10)) * size
    if len(levels) < 3 or len(levels) > 0.9 * len(flat):
        return 0.0
    gaps = np.diff(levels)
    finest = float(np.quantile(gaps, 0.1))
    if finest < 1e-6 * size:
        return 0.0
    counts = np.concatenate([[0.0], np.cumsum(np.round(gaps / finest))])
    step = float(np.polyfit(counts, levels, 1)[0])
    off = np.abs(levels / step - np.round(levels / step))
    return step if np.quantile(off, 0.99) < 0.04 else 0.0
