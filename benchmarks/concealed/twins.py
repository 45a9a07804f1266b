"""Situations in which two effects look the same: the right answer says so, whichever it names first."""

from collections.abc import Callable

import numpy as np

from benchmarks.concealed.changes.base import Change, named
from benchmarks.concealed.changes.chain import Bias, Clock, Encoders, LowPass, Turned, six
from benchmarks.concealed.changes.ground import Slope
from benchmarks.concealed.changes.outside import Pull
from benchmarks.concealed.changes.weight import OtherPayload, PointMass
from benchmarks.concealed.motions import DURATION, HOME, Motion, fourier, still, through
from benchmarks.concealed.scene import Scene
from poise.types import Array

Twin = tuple[list[Change], list[str], Motion]
"""The changes, the names that are as right as theirs, and the motion that does not distinguish them."""


def upright_load(scene: Scene, strength: float, rng: np.random.Generator) -> Twin:
    """The tool hangs down throughout: a heavier load, a pull downwards and a bias are one."""
    force = strength * 1.5 * rng.choice([-1, 1])
    bias = np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
    pull = np.array([0.0, 0.0, -force])  # the sensor's z points down
    mass = force / 9.80665
    kinds: list[Change] = [
        Bias(name="sensor_bias", parameters=six("force", "torque", bias), settles=("bias",), bias=bias),
        Pull(
            name="world_force",
            parameters=named("force", pull) | named("", scene.payload.com),
            place=scene.payload.com,
            pull=pull,
        ),
        OtherPayload(name="payload_parameters", settles=("payload",), mass=mass / scene.payload.mass),
    ]
    made = kinds[rng.integers(3)]
    return [made], ["sensor_bias", "world_force", "payload_parameters", "sensor_gain"], _hanging(rng)


def upright_loss(scene: Scene, strength: float, rng: np.random.Generator) -> Twin:
    """The tool hangs down throughout: a vessel that runs out and a drift are one."""
    if rng.random() < 0.5:
        mass = 0.15 * strength
        parameters = {"rate": mass / DURATION, "start": 0.0, **named("", scene.payload.com)}
        leak = PointMass(
            name="mass_leak",
            parameters=parameters,
            windows=[(0.0, DURATION)],
            place=scene.payload.com,
            times=(0.0, DURATION),
            masses=(mass, 0.0),
            sudden=False,
        )
        return [leak], ["mass_leak", "bias_drift"], _hanging(rng)
    drift = np.array([0.0, 0.0, -1.5 * strength, 0.0, 0.0, 0.0])
    made = Bias(name="bias_drift", parameters=six("force", "torque", drift), settles=("drift",), drift=drift)
    return [made], ["mass_leak", "bias_drift"], _hanging(rng)


def tilted_plane(scene: Scene, strength: float, rng: np.random.Generator) -> Twin:
    """The first joint and the base stand still: an offset of the second joint and a slope are one."""
    angle = 0.02 * strength * rng.choice([-1, 1])
    arm = fourier(rng)

    def without_pan(t: Array) -> tuple[Array, Array, Array]:
        position, velocity, acceleration = (values.copy() for values in arm(t))
        position[:, 0], velocity[:, 0], acceleration[:, 0] = 0.0, 0.0, 0.0
        return position, velocity, acceleration

    motion = Motion("Fourier, first joint still, standing", without_pan, still(3))
    if rng.random() < 0.5:
        offset = np.array([0.0, angle, 0.0, 0.0, 0.0, 0.0])
        made: Change = Encoders(name="joint_offset", parameters={"offset_2": angle}, settles=("joints",), offset=offset)
    else:
        rotation = np.array([0.0, angle, 0.0])
        made = Slope(name="base_tilt", parameters=named("rotation", rotation[:2], "xy"), rotation=rotation)
    return [made], ["joint_offset", "base_tilt"], motion


def turned_flange(scene: Scene, strength: float, rng: np.random.Generator) -> Twin:
    """An offset of the last joint and a sensor turned about its axis are one, but for the load's lateral offset."""
    angle = 0.02 * strength * rng.choice([-1, 1])
    if rng.random() < 0.5:
        offset = np.array([0.0, 0.0, 0.0, 0.0, 0.0, angle])
        made: Change = Encoders(name="joint_offset", parameters={"offset_6": angle}, settles=("joints",), offset=offset)
    else:
        rotation = np.array([0.0, 0.0, angle])
        made = Turned(
            name="sensor_rotation", parameters=named("rotation", rotation), settles=("rotation",), rotation=rotation
        )
    return [made], ["joint_offset", "sensor_rotation"], scene.motion


def slow_sine(scene: Scene, strength: float, rng: np.random.Generator) -> Twin:
    """One slow sine in all joints: a late clock and a low-pass filter are one."""
    amplitude = np.array([0.0, 0.1, 0.2, 0.8, 0.8, 0.6]) * rng.uniform(0.7, 1.0, 6)
    rate = 2 * np.pi * rng.uniform(0.12, 0.16)

    def arm(t: Array) -> tuple[Array, Array, Array]:
        # A cosine begins at rest; its step of acceleration is a twentieth of a newton.
        angle = rate * np.clip(t, 0.0, DURATION)[:, None]
        return (
            HOME + amplitude * (1 - np.cos(angle)),
            amplitude * rate * np.sin(angle),
            amplitude * rate**2 * np.cos(angle),
        )

    late = 0.03 * strength
    if rng.random() < 0.5:
        made: Change = Clock(name="clock_offset", parameters={"offset": late}, settles=("clock",), offset=late)
    else:
        made = LowPass(name="low_pass", parameters={"time_constant": late}, time_constant=late)
    return [made], ["clock_offset", "low_pass"], Motion("one slow sine, standing", arm, still(3))


def _hanging(rng: np.random.Generator) -> Motion:
    """The first and the last joint turn slowly; the tool hangs down."""
    poses = np.tile(HOME, (20, 1))
    poses[:, [0, 5]] += rng.uniform(-0.8, 0.8, (20, 2))
    arm = through(poses, 0.3, 0.3, 0.3, rng.uniform(0.2, 1.0, 20))
    return Motion("tool hanging down, standing", arm, still(3))


TWINS: dict[str, Callable[[Scene, float, np.random.Generator], Twin]] = {
    "upright_load": upright_load,
    "upright_loss": upright_loss,
    "tilted_plane": tilted_plane,
    "turned_flange": turned_flange,
    "slow_sine": slow_sine,
}
