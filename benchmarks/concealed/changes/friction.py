"""What lies between motors and links: friction, gears, rotors; in the joint efforts alone."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.concealed.changes.base import Change
from poise.types import Array

if TYPE_CHECKING:
    from benchmarks.concealed.engine import Engine, Log
    from benchmarks.concealed.scene import Scene

SIZES = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])  # of a wrist joint's effects against the others'
REVERSAL = 0.005  # rad/s within which Coulomb friction turns around
STOP_RATE = 120.0  # rad/s, natural frequency of a link against its gear's teeth
STOP_DAMPING = 0.7  # ratio, there


@dataclass
class Torque(Change):
    """A torque that follows from position, velocity, acceleration and rigid effort of the arm, each (K, 6)."""

    law: Callable[[Array, Array, Array, Array], Array] = field(default=lambda q, v, a, rigid: np.zeros_like(q))

    def effort(self, engine: "Engine", log: "Log") -> Array:
        return self.law(*log.arm, log.effort)


@dataclass
class Backlash(Change):
    """One link is loose by `gap` on its motor; the arm's other motion follows the command."""

    joint: int = 0
    gap: float = 0.0

    def effort(self, engine: "Engine", log: "Log") -> Array:
        rigid, step = log.effort[:, self.joint], engine.step
        coarse = slice(None, None, 20)
        inertia = engine.joint_inertia(log.arm[0][coarse])[:, self.joint]
        inertia = np.interp(log.seconds, log.seconds[coarse], inertia)
        torque = np.empty_like(rigid)
        slack, rate = -np.sign(rigid[0]) * self.gap / 2, 0.0  # link ahead of its motor, rad
        for k in range(len(rigid)):
            over = slack - np.clip(slack, -self.gap / 2, self.gap / 2)
            push = inertia[k] * STOP_RATE**2 * over + 2 * STOP_DAMPING * STOP_RATE * inertia[k] * rate
            # Teeth push, they do not pull.
            torque[k] = -push if push * over > 0 else 0.0
            rate += step * (torque[k] - rigid[k]) / inertia[k]
            slack += step * rate
        change = np.zeros_like(log.effort)
        change[:, self.joint] = torque - rigid
        return change


def sign(velocity: Array) -> Array:
    """The sign that friction follows, smooth within the reversal."""
    return np.asarray(np.tanh(velocity / REVERSAL))


def viscous_friction(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    damping = 3.0 * strength * _spread(rng)
    return Torque(
        name="viscous_friction", parameters=per_joint("damping", damping), law=lambda q, v, a, rigid: damping * v
    )


def coulomb_friction(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    torque = 5.0 * strength * _spread(rng)
    return Torque(
        name="coulomb_friction", parameters=per_joint("torque", torque), law=lambda q, v, a, rigid: torque * sign(v)
    )


def stribeck_friction(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    torque, stiction, damping = (size * strength * _spread(rng) for size in (3.0, 6.0, 2.0))
    velocity = rng.uniform(0.05, 0.15)

    def law(q: Array, v: Array, a: Array, rigid: Array) -> Array:
        return (torque + stiction * np.exp(-((v / velocity) ** 2))) * sign(v) + damping * v

    parameters = per_joint("torque", torque) | per_joint("stiction", stiction) | per_joint("damping", damping)
    return Torque(name="stribeck_friction", parameters=parameters | {"velocity": velocity}, law=law)


def load_dependent_friction(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    ratio = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * 0.08 * strength * rng.uniform(0.8, 1.2, 6)
    return Torque(
        name="load_dependent_friction",
        parameters={"ratio_2": float(ratio[1]), "ratio_3": float(ratio[2])},
        law=lambda q, v, a, rigid: ratio * np.abs(rigid) * sign(v),
    )


def joint_coupling(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    driven = int(rng.integers(6))
    driving = int(rng.choice([joint for joint in (driven - 1, driven + 1) if 0 <= joint < 6]))
    inertia, damping = 0.8 * strength * SIZES[driven], 2.0 * strength * SIZES[driven]

    def law(q: Array, v: Array, a: Array, rigid: Array) -> Array:
        torque = np.zeros_like(q)
        torque[:, driven] = inertia * a[:, driving] + damping * v[:, driving]
        return torque

    parameters = {"inertia": inertia, "damping": damping, "driving": driving + 1, "driven": driven + 1}
    return Torque(name="joint_coupling", parameters=parameters, law=law)


def gear_ripple(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    joint, order, phase = int(rng.integers(6)), float(rng.integers(8, 41)), rng.uniform(0, 2 * np.pi)
    amplitude = 2.0 * strength * SIZES[joint]

    def law(q: Array, v: Array, a: Array, rigid: Array) -> Array:
        torque = np.zeros_like(q)
        torque[:, joint] = amplitude * np.sin(order * q[:, joint] + phase)
        return torque

    parameters = {"amplitude": amplitude, "order": order, "phase": phase, "joint": joint + 1}
    return Torque(name="gear_ripple", parameters=parameters, law=law)


def backlash(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    """Of a joint whose load turns around often: the first, or one of the wrist."""
    effort = scene.preview.effort
    large = np.where(np.abs(effort) > 0.1 * np.abs(effort).max(axis=0), np.sign(effort), 0)
    turns = [int((np.diff(column[column != 0]) != 0).sum()) for column in large.T]
    joints = [joint for joint in (0, 3, 4, 5) if turns[joint] >= 6] or [int(np.argmax(turns))]
    joint, gap = int(rng.choice(joints)), 0.02 * strength
    return Backlash(name="backlash", parameters={"gap": gap, "joint": joint + 1}, joint=joint, gap=gap)


def motor_inertia(scene: "Scene", strength: float, rng: np.random.Generator) -> Change:
    inertia = 0.8 * strength * _spread(rng)
    return Torque(
        name="motor_inertia", parameters=per_joint("inertia", inertia), law=lambda q, v, a, rigid: inertia * a
    )


def per_joint(stem: str, values: Array) -> dict[str, float]:
    """`{stem_1: .., stem_6: ..}`."""
    return {f"{stem}_{joint + 1}": float(value) for joint, value in enumerate(values)}


def _spread(rng: np.random.Generator) -> Array:
    return np.asarray(SIZES * rng.uniform(0.6, 1.2, 6))
