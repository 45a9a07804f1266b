"""Wrenches of wrong drivers: signs, axes, units, clocks, frozen and clipped readings."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.broken_inputs.way import Change, Way, clipped, frozen
from benchmarks.foreign.bag import Streams, Wrenches
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array


def _measured(case: Case) -> Wrenches:
    if case.streams.wrench is None:
        raise ValueError("the rig has no wrench")
    return case.streams.wrench


def _wrench(change: Callable[[Array], Array]) -> Change:
    def broken(case: Case) -> Streams:
        wrench = _measured(case)
        return replace(case.streams, wrench=replace(wrench, values=change(wrench.values.copy())))

    return broken


def _through(matrix: Array) -> Change:
    return _wrench(lambda values: values @ matrix.T)


def _factors(*factors: float) -> Change:
    return _through(np.diag(np.array(factors)))


def _turned(axis: int, degrees: float) -> Change:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a] = turn[b, b] = cosine
    turn[a, b], turn[b, a] = -sine, sine
    return _through(np.kron(np.eye(2), turn))


def _late(seconds: float) -> Change:
    def broken(case: Case) -> Streams:
        wrench = _measured(case)
        return replace(case.streams, wrench=replace(wrench, stamps=wrench.stamps + round(1e9 * seconds)))

    return broken


def _repeated(values: Array) -> Array:
    return np.asarray(values[np.arange(len(values)) // 5 * 5])


def _dead(values: Array) -> Array:
    values[:, 2] = 1e-6 * values[::-1, 2]
    return values


def _tared(values: Array) -> Array:
    return np.asarray(values - values[:20].mean(axis=0))


def _without_load(values: Array) -> Array:
    """What is left when a driver subtracts the load."""
    return np.asarray(0.02 * np.random.default_rng(1).normal(size=values.shape) * values.std(axis=0))


WAYS = {
    "opposite sign": Way(_factors(*[-1.0] * 6), "opposite sign"),
    "opposite torque": Way(_factors(*[1.0] * 3, *[-1.0] * 3), "torque has the opposite sign"),
    "one force negative": Way(_factors(1, 1, -1, 1, 1, 1), "fz alone|z axis is mirrored"),
    "one torque negative": Way(_factors(1, 1, 1, -1, 1, 1), "tx alone"),
    "left-handed": Way(_factors(1, -1, 1, 1, -1, 1), "y axis is mirrored"),
    "torque first": Way(_wrench(lambda values: np.roll(values, 3, axis=1)), "torque comes first"),
    "kgf": Way(_through(np.eye(6) / 9.80665), "in kgf"),
    "lbf, lbf in": Way(_factors(*[1 / 4.4482216] * 3, *[8.8507457] * 3), "in lbf.*lbf in"),
    "N cm": Way(_factors(*[1.0] * 3, *[100.0] * 3), "in N cm"),
    "dead force": Way(_wrench(_dead), "fz does not respond"),
    "turned 30 degrees": Way(_turned(2, 30.0), effect="sensor_rotation"),
    "turned 180 degrees": Way(_turned(0, 180.0), effect="sensor_rotation"),
    "1 s late": Way(_late(1.0), r"stamps are (0\.9|1\.0). s late"),
    "0.1 s early": Way(_late(-0.1), effect="clock_offset"),
    "frozen": Way(_wrench(frozen), "repeats one reading"),
    "repeated": Way(_wrench(_repeated), "repeats each measured wrench 5 times"),
    "tared with the load": Way(_wrench(_tared), effect="sensor_bias"),
    "clipped": Way(_wrench(clipped), effect="saturation"),
    "no load": Way(_wrench(_without_load), effect="payload_parameters"),
}
