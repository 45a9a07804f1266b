"""Where to begin: the mass, and for a body of unknown shape also where it is and how large."""

import numpy as np

from poise.inertia.bayes.mass_model import MassModel
from poise.inertia.model import N_UNKNOWNS, NormalEquations
from poise.types import Array

_LEAST_MASS = 0.3
"""In its own standard deviations, when the samples show none."""

_SPREAD = np.concatenate([[10.0], np.full(3, 1.0), np.full(6, 0.1)])
"""kg, kg m, kg m2: of what a sensor holds, at most."""

_TYPICAL_DENSITY = 2000.0
"""kg/m3, between wood and steel."""

_ELONGATION = 1.5
"""What a hand tool's radius of gyration is, in units of that of a ball."""

_REACH = 1.0
"""m, beyond which nothing is held."""


def states_of_shape(model: MassModel, normal: NormalEquations, bias_variances: Array) -> Array:
    """(B, n) states of the homogeneous body, with the mass that fits best for each prior of the bias (B, 6)."""
    directions = np.zeros((N_UNKNOWNS, 7))
    directions[:10, 0] = model.to_sensor @ model.evaluate(np.zeros((1, model.n_states)))[0][0]
    directions[10:, 1:] = np.eye(6)
    states = np.zeros((len(bias_variances), model.n_states))
    mean, deviation = _ridge(normal, directions, np.insert(bias_variances, 0, np.inf, axis=1))
    masses = np.maximum(mean[:, 0], _LEAST_MASS * deviation[:, 0])
    states[:, : model.n_parts] = np.log(masses)[:, None]
    return states


def blob(normal: NormalEquations, bias_variances: Array) -> tuple[MassModel, Array]:
    """A body of unknown shape about where the samples put it, and (B, n) states for each prior of the bias (B, 6)."""
    spreads = np.tile(_SPREAD**2, (len(bias_variances), 1))
    mean, deviation = _ridge(normal, np.eye(N_UNKNOWNS), np.concatenate([spreads, bias_variances], axis=1))
    masses = np.maximum(mean[:, 0], _LEAST_MASS * deviation[:, 0])
    centres = mean[:, 1:4] / masses[:, None]
    centres = centres * (_REACH / np.maximum(np.linalg.norm(centres, axis=1), _REACH))[:, None]
    sphere = np.cbrt(3 * masses[EXPECTED] / (4 * np.pi * _TYPICAL_DENSITY))
    model = MassModel.of_blob(centres[EXPECTED], float(_ELONGATION * sphere / np.sqrt(5)))
    states = np.zeros((len(masses), model.n_states))
    states[:, 0] = np.log(masses)
    states[:, -3:] = (centres - centres[EXPECTED]) / model.radii
    return model, states


EXPECTED = 1
"""The case of the bias that is neither zero nor anything."""


def _ridge(normal: NormalEquations, directions: Array, variances: Array) -> tuple[Array, Array]:
    """Mean and deviation (B, M) along directions (16, M), for prior variances (B, M) that may be 0 or infinite."""
    scale = np.sqrt(np.where(np.isfinite(variances), variances, 1.0))
    inside = directions * scale[:, None]
    prior = np.isfinite(variances)[:, :, None] * np.eye(variances.shape[1])
    covariance = np.linalg.inv(inside.swapaxes(1, 2) @ normal.information @ inside + prior)
    mean = (covariance @ (normal.vector @ inside)[..., None])[..., 0]
    return scale * mean, scale * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).clip(min=0.0))
