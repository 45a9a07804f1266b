"""The noise of a stream of samples, where it is not given: from second differences and from residuals."""

from dataclasses import replace

import numpy as np

from poise.inertia.model import InertialSolution, NoiseLevels
from poise.robot import ScatterMeter
from poise.types import Array

LEAST_NOISE = NoiseLevels(force=2e-3, torque=1e-4, linear_acceleration=1e-3, angular_acceleration=1e-3)
"""No sensor is better, and no model of the motion either."""

_DIGITS = 4
"""Significant digits of a level. More of them would hand the rounding of sums on to the estimator."""
_ENOUGH = 10
"""Samples from which on the residuals of least squares say something about the noise."""


class NoiseMeter:
    """White noise of wrenches that come one by one or in portions."""

    def __init__(self) -> None:
        self._force, self._torque = ScatterMeter(), ScatterMeter()
        self._n_samples = 0

    def add(self, wrench: Array) -> None:
        """Take wrenches (N, 6), N and N m, in the order of time."""
        self._force.add(wrench[:, :3])
        self._torque.add(wrench[:, 3:])
        self._n_samples += len(wrench)

    @property
    def n_blocks(self) -> int:
        """How many blocks of samples have been seen: without `plain`, levels change with it alone."""
        return self._force.n_blocks

    def levels(self, plain: InertialSolution | None, motion: NoiseLevels) -> NoiseLevels:
        """The noise of force and torque is what second differences show, and no more than least squares leave.

        Args:
            plain: least squares of these samples; None when they show nothing.
            motion: the noise of the accelerations; the rest of it serves where the samples say nothing.

        Returns:
            Levels with an unknown bias.
        """
        left = (np.nan, np.nan) if plain is None else (plain.residual_force, plain.residual_torque)
        levels = {}
        for name, meter, most in (("force", self._force, left[0]), ("torque", self._torque, left[1])):
            seen = np.array([meter.value, most if self._n_samples > _ENOUGH else np.nan])
            usual, least = getattr(motion, name), getattr(LEAST_NOISE, name)
            levels[name] = max(float(np.nanmin(seen)), least) if np.isfinite(seen).any() else usual
        levels |= {name: getattr(motion, name) for name in ("linear_acceleration", "angular_acceleration")}
        levels = {name: float(f"{level:.{_DIGITS}g}") for name, level in levels.items()}
        return replace(motion, **levels, force_bias=np.inf, torque_bias=np.inf)
