"""Recordings with a known effect in them, made by Poise's own simulation: for developing and testing the diagnosis.

Every case also has what honest robots have: calibration errors inside the tolerances, coloured noise that grows with
speed, clocks with jitter. The label never reaches the tool: it gets streams and the nominal model alone. (The proof
on data of another engine is benchmarks/concealed.)
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from poise.inertia import InertialParameters
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import FittedEffect, Problem, payload_steps
from poise.mismatch.reading import NominalModel, Tolerance, recorded_from_motion
from poise.mismatch.reading.joint_motion import recorded_from_streams
from poise.mismatch.reading.sanity import without_spikes
from poise.mismatch.recorded import RecordedMotion
from poise.recording import JointStream, WrenchStream
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory, WaypointTrajectory
from poise.types import Array

DURATION = 35.0
ROBOT = RobotModel.from_file("ridgeback_ur10")
ARM_HOME = np.array([0.0, 0.0, 0.0, 0.0, -1.9, 2.0, -1.67, -1.5708, 0.0])


@dataclass(frozen=True, eq=False)
class Case:
    """Streams and the nominal model, and apart from them the truth."""

    joints: JointStream
    wrench: WrenchStream
    model: NominalModel
    truth: tuple[tuple[str, dict[str, float]], ...]
    exact: RecordedMotion

    def recorded(self) -> RecordedMotion:
        """As the tool reads it."""
        phi = np.zeros(10) if self.model.phi is None else self.model.phi
        return without_spikes(recorded_from_streams(ROBOT, self.joints, None, self.wrench, phi, 9.80665)[0])[0]


def make_case(
    seed: int,
    effects: tuple[tuple[str, float], ...] = (),
    *,
    motion: str = "fourier",
    spoil: Callable[[RecordedMotion, Array, np.random.Generator], Array] | None = None,
    duration: float = DURATION,
) -> Case:
    """A case with effects (name, strength), values drawn at random; `spoil` adds what no effect of the library is."""
    rng = np.random.default_rng(seed)
    body = _payload(rng)
    trajectory = _trajectory(rng, motion, duration)
    tolerance = Tolerance()

    def error(size: float | Array, shape: int | None = None) -> Array:
        return np.asarray(np.clip(rng.normal(size=shape) * 0.5, -1, 1) * size)

    true_phi = body.phi + payload_steps(body.phi, tolerance) @ error(1.0, 10)
    offsets = error(tolerance.joint_offset, 9) * (np.arange(9) >= 3)
    late = float(error(tolerance.clock_offset))
    taken = np.arange(round(duration * 100)) * 0.01 + 0.003
    said = taken + late
    exact = recorded_from_motion(ROBOT, taken, trajectory.at(taken), true_phi)
    truth = tuple((name, DRAWS[name](rng, exact, strength)) for name, strength in effects)
    wrench, shift = _composed(exact, truth)
    if spoil is not None:
        wrench = wrench + spoil(exact, wrench, rng)
    gain = 1.0 + error(tolerance.sensor_gain, 6)
    turn = Rotation.from_rotvec(error(tolerance.sensor_rotation, 3)).as_matrix()
    wrench = np.hstack([wrench[:, :3] @ turn, wrench[:, 3:] @ turn]) * gain
    ramp = taken[:, None] / duration - 0.5
    for size, drift in (
        ((tolerance.bias_force, tolerance.bias_torque), False),
        ((tolerance.drift_force, tolerance.drift_torque), True),
    ):
        value = error(np.repeat(size, 3), 6)
        wrench = wrench + (value * ramp if drift else value)
    wrench = wrench + _noise(rng, exact)
    joint_times = np.arange(round(duration * 125)) * 0.008
    joints = trajectory.at(joint_times)
    read = joints.position + offsets + shift + rng.normal(size=joints.position.shape) * 1e-5
    rates = joints.velocity + rng.normal(size=joints.position.shape) * 5e-4
    stamps = [times + rng.normal(size=len(times)) * 3e-4 for times in (joint_times, said)]
    joint_stamps, wrench_stamps = (np.sort(np.round((s + 1000.0) * 1e9).astype(np.int64)) for s in stamps)
    nan = np.full(read.shape, np.nan)
    return Case(
        JointStream(joint_stamps, ROBOT.joint_names, read, rates, nan),
        WrenchStream(wrench_stamps, wrench, "ft_sensor"),
        NominalModel(sensor_frame="ft_sensor", phi=body.phi),
        truth,
        exact,
    )


def _composed(exact: RecordedMotion, truth: tuple[tuple[str, dict[str, float]], ...]) -> tuple[Array, Array]:
    """What the sensor would read without calibration errors, and what the encoders read too much."""
    shift = np.zeros(9)
    parts = []
    for name, values in truth:
        effect = effect_named(name)
        if effect is None:
            raise KeyError(name)
        if name == "joint_offset":
            shift[3:] += [values[f"offset_{i}"] for i in range(1, 7)]
        else:
            parts.append(FittedEffect(effect, values))
    problem = Problem(exact, NominalModel(), None)  # type: ignore[arg-type]
    return problem.compose(parts)[1].prediction, shift


def _payload(rng: np.random.Generator) -> InertialParameters:
    mass = rng.uniform(1.6, 3.0)
    sides = rng.uniform(0.12, 0.24, 3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    inertia = turn @ np.diag(mass / 12 * (np.sum(sides**2) - sides**2)) @ turn.T
    com = np.array([*rng.uniform(-0.025, 0.025, 2), rng.uniform(0.06, 0.12)])
    return InertialParameters(mass, com, (inertia + inertia.T) / 2)


def _trajectory(rng: np.random.Generator, motion: str, duration: float) -> FourierTrajectory | WaypointTrajectory:
    reach = np.array([0.4, 0.4, 0.4, 1.0, 0.45, 0.6, 1.0, 1.0, 1.6])
    centre = ARM_HOME + rng.uniform(-1, 1, 9) * np.array([0, 0, 0, 0.5, 0.15, 0.15, 0.3, 0.3, 1.0])
    if motion == "fourier":
        made = FourierTrajectory.random(
            ROBOT, rng, duration=duration, speed=0.45, amplitude=1.0, frequency=0.09, harmonics=6, centre=centre
        )
        return FourierTrajectory(centre, made.sine * reach, made.cosine * reach, made.frequency, duration, made.ramp)
    poses = centre + rng.uniform(-1, 1, (int(duration / 1.9) + 1, 9)) * reach
    return WaypointTrajectory.stop_and_go(poses, 1.5, 0.4)


def _noise(rng: np.random.Generator, exact: RecordedMotion) -> Array:
    """White FT-300 noise, and coloured noise in proportion to 0.2 + 0.5 * joint speed."""
    n, sigma = len(exact), np.repeat([0.1, 0.005], 3)
    slow = np.empty((n, 6))
    for channel in range(6):
        keep = np.exp(-0.01 / rng.uniform(0.05, 0.3))
        drive = rng.normal(size=n) * np.sqrt(1 - keep**2)
        state = rng.normal()
        for i in range(n):
            state = keep * state + drive[i]
            slow[i, channel] = state
    return np.asarray(sigma * (rng.normal(size=(n, 6)) + slow * (0.2 + 0.5 * exact.speed[:, None])))


def _unit(rng: np.random.Generator, size: int = 3) -> Array:
    vector = rng.normal(size=size)
    return np.asarray(vector / np.linalg.norm(vector))


def _vectors(rng: np.random.Generator, force: float, torque: float) -> dict[str, float]:
    values = np.concatenate([_unit(rng) * force, _unit(rng) * torque])
    names = [f"{what}_{axis}" for what in ("force", "torque") for axis in "xyz"]
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _named(prefix: str, values: Array) -> dict[str, float]:
    return {f"{prefix}{a}": float(v) for a, v in zip("xyz", values, strict=True)}


def _bias(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    return _vectors(rng, 2.4 * strength, 0.15 * strength)


def _drift(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    return _vectors(rng, 0.72 * strength, 0.048 * strength)


def _gain(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    names = [p.name for p in effect_named("sensor_gain").parameters(recorded)]  # type: ignore[union-attr]
    values = dict.fromkeys(names, 0.0)
    block = rng.choice(["f", "t"])
    inside = [name for name in names if name.count(block) == 2 and name[5] == block == name[8]]
    for name in rng.choice(inside, rng.integers(1, 4), replace=False):
        values[str(name)] = float(0.06 * strength * rng.choice([-1, 1]))
    return values


def _rotation(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    return _named("rotation_", 0.03 * strength * _unit(rng))


def _low_pass(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    return {"time_constant": 0.08 * strength}


def _clock(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    return {"offset": float(0.025 * strength * rng.choice([-1, 1]))}


def _joints(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    values = {f"offset_{i}": 0.0 for i in range(1, 7)}
    for i in rng.choice([1, 2, 3, 4, 5], rng.integers(1, 3), replace=False):
        values[f"offset_{i}"] = float(0.015 * strength * rng.choice([-1, 1]))
    return values


def _payload_error(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    body = InertialParameters.from_phi(recorded.phi)
    mass = body.mass * (1 + 0.06 * strength * rng.choice([-1, 1]))
    new = InertialParameters(
        mass, body.com + 0.012 * strength * _unit(rng), body.inertia * (1 + 0.6 * strength * rng.uniform(0, 1))
    )
    rows = [p.name for p in effect_named("payload_parameters").parameters(recorded)]  # type: ignore[union-attr]
    return dict(zip(rows, (new.phi - recorded.phi).tolist(), strict=True))


def _mass_step(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    mass = 0.3 * strength * rng.choice([-1, 1])
    moment = mass * np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.03, 0.15)])
    return {"time": float(rng.uniform(5, 30)), "mass": float(mass), **_named("moment_", moment)}


def _world_force(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    point = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.2)])
    force = 2.0 * strength * _unit(rng) * [1, 1, 0.3]
    return {**dict(zip("xyz", point.tolist(), strict=True)), **_named("force_", force)}


def _cable(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    anchor = recorded.position_in_world.mean(axis=0) + _unit(rng) * 1.0
    length = np.linalg.norm(recorded.position_in_world - anchor, axis=1)
    point = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.2)])
    return {
        "on_base": 0.0,
        **_named("anchor_", anchor),
        **dict(zip("xyz", point.tolist(), strict=True)),
        "rest_length": float(np.quantile(length, rng.uniform(0.1, 0.4))),
        "stiffness": 25.0 * strength,
        "damping": 2.0 * strength,
    }


def _contact(rng: np.random.Generator, recorded: RecordedMotion, strength: float) -> dict[str, float]:
    """A bump of force with a part across it; the point is the finger tip."""
    point = np.array([0.0, 0.0, 0.17])
    direction, across = _unit(rng), rng.normal(size=3) * 0.2
    course = np.sin(np.pi * np.arange(1, 8) / 8) ** rng.uniform(0.5, 1.5) * (1 + 0.2 * rng.normal(size=7))
    course *= 9.0 * strength / course.max()
    values = {"start": float(rng.uniform(3, 30)), "length": float(rng.uniform(0.4, 2.0))}
    values |= {"knots": 7.0, **dict(zip("xyz", point.tolist(), strict=True))}
    values |= {f"force_{axis}_{k}": 0.0 for axis in "xyz" for k in range(15)}
    for k, size in enumerate(course):
        values |= {f"force_{a}_{k}": float(v) for a, v in zip("xyz", size * (direction + across), strict=True)}
    return values


DRAWS: dict[str, Callable[[np.random.Generator, RecordedMotion, float], dict[str, float]]] = {
    "sensor_bias": _bias,
    "bias_drift": _drift,
    "sensor_gain": _gain,
    "sensor_rotation": _rotation,
    "low_pass": _low_pass,
    "clock_offset": _clock,
    "joint_offset": _joints,
    "payload_parameters": _payload_error,
    "mass_step": _mass_step,
    "world_force": _world_force,
    "cable": _cable,
    "contact": _contact,
}
