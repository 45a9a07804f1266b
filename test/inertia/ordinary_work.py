"""An arm that picks, carries and places for minutes: what its sensors say, and when the payload really changed."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from simulated_motion import HOME, fr3

from poise.inertia import InertialParameters
from poise.inertia.model import regressor
from poise.recording import JointStream, WrenchStream
from poise.robot import RobotModel, sensor_motion
from poise.types import Array

START = 1_700_000_000_000_000_000
GRASP = 0.06
"""s in which the load goes from the table to the hand."""


@dataclass(frozen=True, eq=False)
class Work:
    """What was measured, and the truth: (E,) s at which the payload began to change, and (E, 10) phi afterwards."""

    model: RobotModel
    joints: JointStream
    wrench: WrenchStream
    changes: Array
    payloads: Array


@dataclass(frozen=True)
class Nuisance:
    """What is no payload.

    Args:
        pushes: per minute, of 5 to 30 N in the world for 50 to 300 ms.
        drift: of the bias, N (and 1/20 of it in N m) in a minute.
        force, torque: noise of a sample, N and N m.
        joint: noise of a joint position, rad.
    """

    pushes: float = 0.0
    drift: float = 0.0
    force: float = 0.1
    torque: float = 0.005
    joint: float = 1e-5


def object_in_hand(rng: np.random.Generator) -> InertialParameters:
    """Something of 0.2 to 2 kg, 5 to 15 cm before the sensor."""
    mass = float(np.exp(rng.uniform(np.log(0.2), np.log(2.0))))
    sides = rng.uniform(0.03, 0.15, 3)
    inertia = mass / 12 * np.diag(np.sum(sides**2) - sides**2)
    return InertialParameters(mass, np.array([*rng.normal(0, 0.02, 2), rng.uniform(0.05, 0.15)]), inertia)


def way(rng: np.random.Generator, duration: float) -> tuple[Array, Array, Array]:
    """Times (P,) s and postures (P, 7) of moves of 1 to 2 s with rests of 0.3 to 1 s; each is there twice in a row."""
    times, postures = [0.0], [HOME]
    while times[-1] < duration:
        times += [times[-1] + rng.uniform(0.3, 1.0)]
        postures += [postures[-1]]
        times += [times[-1] + rng.uniform(1.0, 2.0)]
        postures += [HOME + rng.uniform(-0.7, 0.7, 7)]
    return np.array(times), np.array(postures)


def along(times: Array, postures: Array, seconds: Array) -> tuple[Array, Array, Array]:
    """Quintic in between, at rest at each: positions, velocities, accelerations (N, 7)."""
    number = np.clip(np.searchsorted(times, seconds, "right") - 1, 0, len(times) - 2)
    span = np.diff(times)[number][:, None]
    s = np.clip((seconds - times[number])[:, None] / span, 0.0, 1.0)
    step = np.diff(postures, axis=0)[number]
    return (
        postures[number] + step * (10 * s**3 - 15 * s**4 + 6 * s**5),
        step * (30 * s**2 - 60 * s**3 + 30 * s**4) / span,
        step * (60 * s - 180 * s**2 + 120 * s**3) / span**2,
    )


def work(
    rng: np.random.Generator,
    duration: float,
    *,
    every: int = 3,
    nuisance: Nuisance | None = None,
    joint_rate: float = 125.0,
    wrench_rate: float = 500.0,
) -> Work:
    """Go from posture to posture; at every so-manieth rest something is grasped, or what is held is released.

    Args:
        every: 0: nothing ever changes, and what is held is held from the beginning.
    """
    nuisance = nuisance or Nuisance()
    model = fr3()
    times, postures = way(rng, duration)
    rests = times[:-1:2] + 0.15
    held = object_in_hand(rng)
    now = every == 0
    changes, payloads = [], [held.phi * now]
    for number, rest in enumerate(rests[1:], 1):
        if every and number % every == 0 and rest < duration - 1.0:
            now = not now
            held = object_in_hand(rng) if now else held
            changes.append(rest)
            payloads.append(held.phi * now)

    seconds = np.arange(0, duration, 1 / joint_rate)
    position = along(times, postures, seconds)[0] + nuisance.joint * rng.normal(size=(len(seconds), 7))
    unknown = np.full(position.shape, np.nan)
    joints = JointStream(_stamps(seconds), model.joint_names, position, unknown, unknown)

    at = np.arange(0.0013, duration, 1 / wrench_rate)
    motion = sensor_motion(model, _stamps(at), *along(times, postures, at))
    phi = np.tile(payloads[0], (len(at), 1))
    for change, before, after in zip(changes, payloads[:-1], payloads[1:], strict=True):
        phi += np.clip((at - change) / GRASP, 0.0, 1.0)[:, None] * (after - before)
    specific = motion.gravity_in_sensor() - motion.linear_acceleration_in_sensor
    matrix = regressor(specific, motion.angular_velocity_in_sensor, motion.angular_acceleration_in_sensor)
    wrench = (matrix @ phi[:, :, None])[:, :, 0]
    wrench += at[:, None] / 60 * nuisance.drift * rng.normal(size=6) * np.repeat([1, 1 / 20], 3)
    for _ in range(rng.poisson(nuisance.pushes * duration / 60)):
        begin, length = rng.uniform(1.0, duration), rng.uniform(0.05, 0.3)
        shape = np.sin(np.pi * np.clip((at - begin) / length, 0, 1))[:, None] ** 0.5
        force = rng.normal(size=3)
        force *= rng.uniform(5, 30) / np.linalg.norm(force)
        in_sensor = force @ motion.rotation_world_sensor
        wrench += shape * np.hstack([in_sensor, np.cross([0, 0, 0.15], in_sensor)])
    wrench += rng.normal(size=wrench.shape) * np.repeat([nuisance.force, nuisance.torque], 3)
    return Work(
        model, joints, WrenchStream(_stamps(at), wrench, model.sensor_frame), np.array(changes), np.array(payloads)
    )


def _stamps(seconds: Array) -> npt.NDArray[np.int64]:
    return START + np.round(seconds * 1e9).astype(np.int64)
