"""Objects made up of boxes and cylinders of any materials, and wrenches that a noisy robot would measure with them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poise.inertia.bayes.mass_model import MassModel
from poise.inertia.model.parts import Parts, box_moments
from poise.inertia.model.problem import IdentificationProblem, NoiseLevels
from poise.inertia.model.wrench_regressor import regressor
from poise.types import Array

GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class Composite:
    """What is given to an estimator, and the truth."""

    parts: Parts
    phi: Array


def composite(
    rng: np.random.Generator, shape_error: float = 0.0, cut_error: float = 0.0, resolution: float = 0.0
) -> Composite:
    """One to five boxes or cylinders of 1 to 10 cm, chained; of one material or several, some grams to some kilograms.

    Args:
        shape_error, cut_error: relative errors of lengths that the given parts have; the latter where densities differ.
        resolution: m, error of every length, however short.
    """
    count = int(rng.integers(1, 6))
    sides = np.exp(rng.uniform(np.log(0.01), np.log(0.1), (count, 3)))
    moments, corners, centre = [], [], np.zeros(3)
    for side in sides:
        moment = box_moments(np.zeros((1, 3)), side[None])[0]
        if rng.random() < 0.5:  # an elliptic cylinder: a sixteenth instead of a twelfth, and pi/4 of the volume
            moment = np.pi / 4 * moment * np.diag([0.75, 0.75, 1.0, 1.0])
        place = np.eye(4)
        place[:3, :3] = Rotation.random(random_state=rng).as_matrix()
        centre = centre + rng.normal(0.0, 0.5, 3) * sides.max(axis=0)
        place[:3, 3] = centre
        moments.append(place @ moment @ place.T)
        cube = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
        corners.append((cube * side) @ place[:3, :3].T + centre)
    parts = Parts.from_moments(moments, np.arange(count), np.concatenate(corners))
    away = rng.normal(0.0, 0.05, 3) + np.array([0.0, 0.0, 0.08])
    parts = parts.in_frame(np.eye(3), away - parts.homogeneous_phi[1:4])
    one = rng.random() < 0.4
    density = np.exp(rng.uniform(np.log(600), np.log(8000), 1 if one else count))
    model = MassModel.of_parts(parts.unit_phi, parts.volumes)
    error = shape_error if one or count == 1 else np.hypot(shape_error, cut_error)
    deviations = np.hypot(error * np.repeat([1.0, 0.7], [6, 3]), np.sqrt(model.roughness(resolution)))
    deformation = deviations * rng.normal(size=9)
    state = np.concatenate([np.log(density * parts.volumes.sum() * np.ones(count)), deformation])
    return Composite(parts, model.to_sensor @ model.evaluate(state[None])[0][0])


def motion(rng: np.random.Generator, seconds: Array, speed: float) -> tuple[Array, Array, Array, Array]:
    """Gravity, a, omega, alpha (N, 3) in sensor axes at times (N,): rotation about a turning axis, as a wrist does it.

    The attitude is Exp(swing(t)); rates are its exact derivatives, taken by small differences.
    """
    amplitude, phase = rng.normal(0.0, 0.8, 3), rng.uniform(0, 2 * np.pi, 3)
    frequency = speed * rng.uniform(0.7, 1.3, 3)
    start = Rotation.random(random_state=rng)
    arm = np.array([0.05, 0.02, 0.15])

    def attitude(time: Array) -> Rotation:
        return start * Rotation.from_rotvec(amplitude * np.sin(frequency * time[:, None] + phase))

    step = 1e-4
    here, later, before = attitude(seconds), attitude(seconds + step), attitude(seconds - step)
    forward, backward = (here.inv() * later).as_rotvec() / step, -(here.inv() * before).as_rotvec() / step
    omega, alpha = (forward + backward) / 2, (forward - backward) / step
    linear = np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    return here.apply([0, 0, -GRAVITY], inverse=True), linear, omega, alpha


def measured(
    rng: np.random.Generator,
    phi: Array,
    *,
    samples: int = 150,
    rate: float = 100.0,
    speed: float = 2.0,
    noise: NoiseLevels | None = None,
    delay: float = 0.0,
    bias: Array | None = None,
    parts: Parts | None = None,
) -> IdentificationProblem:
    """What a robot that moves at about `speed` rad/s measures, wrench stamps being late by `delay` s."""
    level = NoiseLevels() if noise is None else noise
    seconds = np.arange(samples) / rate
    seed = int(rng.integers(1 << 31))
    gravity, linear, omega, alpha = motion(np.random.default_rng(seed), seconds, speed)
    true = motion(np.random.default_rng(seed), seconds - delay, speed)
    wrench = regressor(true[0] - true[1], true[2], true[3]) @ phi + (np.zeros(6) if bias is None else bias)
    known = {} if parts is None else {"unit_parts": parts.unit_phi, "part_volumes": parts.volumes}
    return IdentificationProblem(
        stamps=np.round(seconds * 1e9).astype(np.int64),
        gravity_in_sensor=gravity,
        linear_acceleration=linear + level.linear_acceleration * rng.normal(size=linear.shape),
        angular_velocity=omega,
        angular_acceleration=alpha + level.angular_acceleration * rng.normal(size=alpha.shape),
        wrench=wrench + level.wrench * rng.normal(size=wrench.shape),
        noise=level,
        shape_points=None if parts is None else parts.points,
        **known,
    )


def without_shape(problem: IdentificationProblem) -> IdentificationProblem:
    """The same samples when nothing is known of the object."""
    return replace(problem, unit_parts=None, part_volumes=None, shape_points=None)
