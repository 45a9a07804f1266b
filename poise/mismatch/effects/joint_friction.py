"""What effects on joint efforts share: which joint is which, its sense of motion, and sizes that suit it."""

from collections.abc import Sequence

import numpy as np

from poise.mismatch.recorded import EffortTrack, World
from poise.types import Array

CREEPING = 0.005
"""rad/s about which a joint's sense of motion changes."""


def efforts(world: World) -> EffortTrack:
    """The joint efforts of a world that has them; effects on effort are not asked about others.

    Raises:
        ValueError: when it has none.
    """
    if world.effort is None:
        raise ValueError("this world has no joint efforts")
    return world.effort


def numbers(world: World) -> tuple[int, ...]:
    """Of each joint with a measured effort its number in the arm, 1 at the base."""
    if world.effort is None:
        return ()
    names = world.effort.names
    arm = names if world.joints is None or not set(names) <= set(world.joints.names) else world.joints.names
    return tuple(arm.index(name) + 1 for name in names)


def sense(world: World) -> Array:
    """(M, J) sign of the velocity, smooth through zero."""
    return np.tanh(efforts(world).velocity / CREEPING)


def each_joint(values: Array) -> Array:
    """(M, J, J) columns that act on one joint each, from (M, J)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))


def torque_sizes(world: World) -> Array:
    """(J,) a tenth of what each joint usually bears; a typical friction."""
    if world.effort is None:
        return np.zeros(0)
    usual = np.quantile(np.abs(world.effort.rigid), 0.9, axis=0)
    return np.asarray(0.1 * np.maximum(usual, 0.02 * usual.max(initial=0.0)) + 1e-6)


def per(world: World, rates: Array) -> Array:
    """(J,) sizes of a coefficient that turns rates (M, J) into torques."""
    usual = np.quantile(np.abs(rates), 0.9, axis=0)
    return np.asarray(torque_sizes(world) / np.maximum(usual, max(0.05 * float(usual.max(initial=0.0)), 1e-3)))


def joint_called(world: World, number: float) -> str:
    """The name of a joint by its number."""
    names = dict(zip(numbers(world), efforts(world).names, strict=True))
    return names.get(round(number), f"joint {number:.0f}")


def column_of(world: World, number: float) -> int:
    """Where a joint of a number stands among the efforts; 0 for one that is not there."""
    known = numbers(world)
    return known.index(round(number)) if round(number) in known else 0


def listed(world: World, values: Sequence[float], unit: str) -> str:
    """Numbers by joint, the largest first, none that is small beside it: 'elbow_joint 5.1, wrist_1_joint 1 N m'."""
    ranked = sorted(zip(values, efforts(world).names, strict=True), key=lambda item: -abs(item[0]))
    told = [f"{name} {value:.3g}" for value, name in ranked[:3] if abs(value) > 0.15 * abs(ranked[0][0])]
    return f"{', '.join(told)} {unit}"
