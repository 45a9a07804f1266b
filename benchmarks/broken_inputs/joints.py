"""Joint states of wrong drivers: directions, order, units, stamps, encoders that freeze, a second publisher."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.broken_inputs.way import Change, Way
from benchmarks.foreign.bag import Joints, Streams
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array


def _joints(change: Callable[[Joints], Joints]) -> Change:
    return lambda case: replace(case.streams, joints=change(case.streams.joints))


def _moved(change: Callable[[Array], Array]) -> Change:
    """Positions and velocities."""
    return _joints(lambda joints: replace(joints, position=change(joints.position), velocity=change(joints.velocity)))


def _positions(change: Callable[[Array], Array]) -> Change:
    return _joints(lambda joints: replace(joints, position=change(joints.position.copy())))


def _velocities(change: Callable[[Array], Array]) -> Change:
    return _joints(lambda joints: replace(joints, velocity=change(joints.velocity)))


def _stamps(change: Callable[[NDArray[np.int64]], NDArray[np.int64]]) -> Change:
    return _joints(lambda joints: replace(joints, stamps=change(joints.stamps)))


def _reversed_joint(values: Array) -> Array:
    return values * np.where(np.arange(values.shape[1]) == values.shape[1] - 2, -1.0, 1.0)


def _in_other_order(case: Case) -> Streams:
    names = case.streams.names
    return replace(case.streams, names=(*names[-1:], *names[:-1]))


def _zero_off(position: Array) -> Array:
    position[:, -2] += 0.2
    return position


def _encoder_freezes(joints: Joints) -> Joints:
    """The encoder that moves most repeats its reading from the middle on."""
    position, velocity = joints.position.copy(), joints.velocity.copy()
    middle, joint = len(position) // 2, int(np.argmax(np.ptp(position, axis=0)))
    position[middle:, joint] = position[middle, joint]
    if velocity.size:
        velocity[middle:, joint] = 0.0
    return replace(joints, position=position, velocity=velocity)


def _wrapped(position: Array) -> Array:
    """The joint that moves most passes the end of a turn in the middle."""
    joint = int(np.argmax(np.ptp(position, axis=0)))
    middle = np.median(position[:, joint])
    position[:, joint] = np.where(position[:, joint] > middle, position[:, joint] - 2 * np.pi, position[:, joint])
    return position


def _second_publisher(joints: Joints) -> Joints:
    """Another node sends zeros at 10 Hz, as joint_state_publisher does."""
    stamps = np.arange(joints.stamps[0] + 3_000_000, joints.stamps[-1], 100_000_000)
    order = np.argsort(np.concatenate([joints.stamps, stamps]), kind="stable")

    def mixed(values: Array) -> Array:
        return np.concatenate([values, np.zeros((len(stamps), values.shape[1]))])[order]

    return Joints(
        np.concatenate([joints.stamps, stamps])[order],
        mixed(joints.position),
        mixed(joints.velocity),
        mixed(joints.effort),
    )


def _without_bursts(joints: Joints) -> Joints:
    """A third of the messages is lost, in spans of 0.2 s."""
    rng = np.random.default_rng(1)
    span = (joints.stamps - joints.stamps[0]) // 200_000_000
    kept = (rng.random(int(span[-1]) + 1) > 1 / 3)[span]
    return Joints(joints.stamps[kept], joints.position[kept], joints.velocity[kept], joints.effort[kept])


def _of_float32(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    return (stamps * 1e-9).astype(np.float32).astype(np.int64) * 10**9


WAYS = {
    "joint reversed": Way(_moved(_reversed_joint), "opposite direction|its range in the description"),
    "joints in other order": Way(_in_other_order, "in the order|its range in the description"),
    "degrees": Way(_moved(np.degrees), "degrees|in mm"),
    "a zero 0.2 rad off": Way(_positions(_zero_off), "its range in the description", "joint_offset"),
    "encoder freezes": Way(_joints(_encoder_freezes), "stays at exactly"),
    "wrapped": Way(_positions(_wrapped), "whole turns|its range in the description", harmless=True),
    "second publisher": Way(_joints(_second_publisher), "two publishers|publish|jump"),
    "bursts lost": Way(_joints(_without_bursts), harmless=True),
    "velocities in degrees": Way(_velocities(np.degrees), harmless=True),
    "velocities reversed": Way(_velocities(np.negative), harmless=True),
    "velocities zero": Way(_velocities(np.zeros_like), harmless=True),
    "stamps of 10 ms": Way(_stamps(lambda stamps: stamps // 10**7 * 10**7), harmless=True),
    "stamps of float32": Way(_stamps(_of_float32), "repeat the stamp"),
}
