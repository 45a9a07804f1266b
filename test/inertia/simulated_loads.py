"""Loads, motions and wrenches made up for the tests, with every random number from a given generator."""

import numpy as np
from scipy.spatial.transform import Rotation

from poise.inertia import InertialParameters
from poise.inertia.model import regressor
from poise.types import Array

GRAVITY = 9.80665
BIAS = np.array([9.0, -1.0, 10.0, 0.4, -0.7, -0.15])


def random_body(rng: np.random.Generator) -> InertialParameters:
    """A body of some grams to some kilograms, made of point masses: physically consistent by construction."""
    masses = rng.uniform(0.01, 0.3, 12)
    points = rng.normal(0.0, 0.08, (12, 3)) + rng.uniform(-0.1, 0.1, 3)
    com = masses @ points / masses.sum()
    arms = points - com
    inertia = np.einsum(
        "n,nij->ij", masses, np.einsum("nk,nk,ij->nij", arms, arms, np.eye(3)) - np.einsum("ni,nj->nij", arms, arms)
    )
    return InertialParameters(float(masses.sum()), com, inertia)


def random_motion(rng: np.random.Generator, n: int) -> tuple[Array, Array, Array]:
    """Gravity minus acceleration, angular velocity and angular acceleration, (n, 3) each, all in sensor axes."""
    gravity_in_sensor = Rotation.random(n, random_state=rng).apply([0, 0, -GRAVITY], inverse=True)
    return (
        gravity_in_sensor - rng.normal(0.0, 1.0, (n, 3)),
        rng.normal(0.0, 1.0, (n, 3)),
        rng.normal(0.0, 4.0, (n, 3)),
    )


def static_regressor(rng: np.random.Generator, n: int) -> Array:
    """(n, 6, 10) at rest in n random attitudes."""
    gravity_in_sensor = Rotation.random(n, random_state=rng).apply([0, 0, -GRAVITY], inverse=True)
    return regressor(gravity_in_sensor, np.zeros((n, 3)), np.zeros((n, 3)))
