"""Identification problems made up for the tests of the methods; every random number from a given generator."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from simulated_loads import GRAVITY, random_body

from poise.inertia.estimators.pmd import unit_points
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.types import Array

EXACT = NoiseLevels(force=1e-3, torque=1e-4, linear_acceleration=1e-3, angular_acceleration=1e-3)
BOX = np.array([0.2, 0.1, 0.05])  # m
AT = (0.05, -0.02, 0.1)  # m, the centre of the box


def motion(rng: np.random.Generator, n: int, liveliness: float = 1.0) -> dict[str, Array]:
    """Kinematics in random attitudes, as fields of a problem; liveliness 0 stands still."""
    return {
        "stamps": np.arange(n) * 10_000_000,
        "gravity_in_sensor": Rotation.random(n, random_state=rng).apply([0, 0, -GRAVITY], inverse=True),
        "linear_acceleration": liveliness * rng.normal(0.0, 1.0, (n, 3)),
        "angular_velocity": liveliness * rng.normal(0.0, 1.0, (n, 3)),
        "angular_acceleration": liveliness * rng.normal(0.0, 4.0, (n, 3)),
    }


def problem_of(
    body: InertialParameters,
    rng: np.random.Generator,
    n: int = 40,
    liveliness: float = 1.0,
    noise: NoiseLevels = EXACT,
    wrench_noise: float = 0.0,
    bias: Array | None = None,
    **known: Array,
) -> IdentificationProblem:
    """Samples of a body's wrench; `wrench_noise` in units of `noise`."""
    fields = motion(rng, n, liveliness)
    silent = IdentificationProblem(**fields, wrench=np.zeros((n, 6)), noise=noise, **known)
    wrench = silent.regressor @ body.phi + wrench_noise * noise.wrench * rng.normal(size=(n, 6))
    return replace(silent, wrench=wrench + (0.0 if bias is None else bias))


def box_body(mass: float = 0.8, sides: Array = BOX, at: tuple[float, float, float] = AT) -> InertialParameters:
    """A homogeneous box away from the sensor."""
    return InertialParameters(mass, np.array(at), np.diag(mass / 12 * (sides @ sides - sides**2)))


def two_boxes() -> tuple[Array, Array]:
    """Unit-mass parameters (10, 2) and volumes (2,) of two boxes of different size."""
    first, second = box_body(1.0), box_body(1.0, BOX / 2, (-0.1, 0.0, 0.05))
    return np.stack([first.phi, second.phi], axis=1), np.array([np.prod(BOX), np.prod(BOX / 2)])


def box_points(rng: np.random.Generator, count: int, at: tuple[float, float, float] = AT) -> Array:
    """(count, 3) inside the box of `box_body`."""
    return (rng.random((count, 3)) - 0.5) * BOX + at


def wild_problem(rng: np.random.Generator) -> IdentificationProblem:
    """Anything: few samples, noise up to a hundred times the signal, any shape, a wrench that fits none of them."""
    n, n_points = int(rng.integers(1, 12)), int(rng.integers(4, 30))
    body = random_body(rng)
    size = 10 ** rng.uniform(-2, 0) * 10 ** rng.uniform(-1, 0, 3)  # m
    points = rng.normal(size=(n_points, 3)) * size + 0.2 * rng.normal(size=3)
    masses = rng.random((n_points, 3))
    unit_parts = unit_points(points) @ (masses / masses.sum(axis=0))
    volumes = 10 ** rng.uniform(-7, -3, 3)
    return problem_of(
        body,
        rng,
        n,
        10 ** rng.uniform(-2, 1),
        NoiseLevels(force_bias=float(rng.integers(0, 2)), torque_bias=0.1),
        10 ** rng.uniform(-3, 2),
        unit_parts=unit_parts,
        part_volumes=volumes,
        shape_points=points,
    )
