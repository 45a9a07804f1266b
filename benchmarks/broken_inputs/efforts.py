"""Joint efforts of wrong drivers: signs, units, what was subtracted, joints of another order, late and frozen ones."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.broken_inputs.way import Change, Way, clipped, frozen
from benchmarks.foreign.bag import Streams
from benchmarks.foreign.case import Case
from benchmarks.foreign.profiles import BY_NAME
from benchmarks.foreign.robots import ROBOTS, Array, spec

LATE = 0.1
"""s"""


def _efforts(change: Callable[[Array], Array]) -> Change:
    return _with_case(lambda case, effort: change(effort))


def _with_case(change: Callable[[Case, Array], Array]) -> Change:
    def broken(case: Case) -> Streams:
        joints = case.streams.joints
        return replace(case.streams, joints=replace(joints, effort=change(case, joints.effort.copy())))

    return broken


def _one_negative(effort: Array) -> Array:
    effort[:, effort.shape[1] // 2] *= -1.0
    return effort


def _currents(effort: Array) -> Array:
    """A: gear and torque constant of each joint's own."""
    return np.asarray(effort / np.random.default_rng(effort.shape[1]).uniform(5.0, 15.0, effort.shape[1]))


def _at_the_motors(effort: Array) -> Array:
    """N m before the gears."""
    return np.asarray(effort / np.random.default_rng(effort.shape[1]).uniform(50.0, 160.0, effort.shape[1]))


def _external(effort: Array) -> Array:
    """What is left when a driver subtracts all that it knows."""
    return np.asarray(0.1 * np.random.default_rng(1).normal(size=effort.shape) * effort.std(axis=0))


def _without_gravity(case: Case, effort: Array) -> Array:
    """The driver subtracts the weight of the arm, not of the load."""
    robot = ROBOTS[BY_NAME[case.label["profile"]].robot]
    model = spec(robot, mobile=False).compile()
    data = mujoco.MjData(model)
    address = [model.joint(name).qposadr[0] for name in robot.joints]
    for row, position in enumerate(case.streams.joints.position):
        data.qpos[address] = position
        mujoco.mj_forward(model, data)
        effort[row] -= data.qfrc_bias[[model.joint(name).dofadr[0] for name in robot.joints]]
    return effort


def _exchanged(effort: Array) -> Array:
    order = np.arange(effort.shape[1])
    order[[0, 1]] = 1, 0
    return effort[:, order]


def _one_dead(effort: Array) -> Array:
    effort[:, 1] = effort[0, 1]
    return effort


def _late(case: Case, effort: Array) -> Array:
    step = float(np.median(np.diff(case.streams.joints.stamps))) * 1e-9
    rows = np.arange(len(effort)) - round(LATE / step)
    return effort[np.maximum(rows, 0)]


WAYS = {
    "opposite signs": Way(_efforts(np.negative), "opposite sign"),
    "one joint of opposite sign": Way(_efforts(_one_negative), "opposite sign"),
    "N mm": Way(_efforts(lambda effort: 1000.0 * effort), "N mm"),
    "lbf in": Way(_efforts(lambda effort: 8.8507457 * effort), "another unit|not in N m|lbf in"),
    "kgf m": Way(_efforts(lambda effort: effort / 9.80665), "another unit|not in N m|kgf"),
    "currents": Way(_efforts(_currents), "another unit|not in N m|motor currents"),
    "before the gears": Way(_efforts(_at_the_motors), "another unit|not in N m|before the gear"),
    "magnitudes": Way(_efforts(np.abs), "no sign"),
    "zeros": Way(_efforts(np.zeros_like), "zero"),
    "one dead": Way(_efforts(_one_dead), "constant"),
    "external torques": Way(_efforts(_external), "do not contain|was subtracted"),
    "without gravity": Way(_with_case(_without_gravity), "subtracts it|was subtracted", "effort_offset"),
    "two efforts exchanged": Way(_efforts(_exchanged), "exchanged|order"),
    "efforts in other order": Way(_efforts(lambda effort: np.roll(effort, 1, axis=1)), "order"),
    "efforts frozen": Way(_efforts(frozen), "repeat"),
    "efforts late": Way(_with_case(_late), r"if they are 0\.\d+ s late"),
    "efforts clipped": Way(_efforts(clipped), "end of their range"),
}
