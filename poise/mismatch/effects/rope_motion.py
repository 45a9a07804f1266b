"""Motion of a rope that hangs from a moving point: masses on massless links."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from poise.geometry import cross
from poise.kernels import COMPILED
from poise.kernels import rope as compiled_rope
from poise.mismatch.recorded import linear_at
from poise.types import Array

_LENGTHS = np.array([0.5, 1.0, 1.0, 1.0])
"""Of the links, in equal parts of a rope, whose masses are in their middles: the second mode is 4 % off that of a rope
(as a pendulum's length, relative to the first)."""
_PHASE, _FADES = 0.6, 1.5
"""rad of the fastest mode in a step, and the share of its speed that the damping may take in a step."""
_SHORTEST_STEP, _LONGEST_STEP = 1e-3, 0.02
"""s; joints are damped less where a step would have to be shorter."""
_PROJECTIONS = 12
"""Passes of Newton's method on the tensions of a step."""


@dataclass(frozen=True)
class RopeModes:
    """Small swings of a rope of 1 kg of links (0.5, 1, 1, 1) m, under 1 m/s2.

    Args:
        masses: (L,) kg at the lower end of each link.
        first, fastest: squares of the slowest and the fastest frequency, 1/s2.
        share: of the mass that takes part in the slowest mode.
        damping: N m s/rad of each joint for a damping of 1/s of the slowest mode's speed.
        fading: 1/s of the mode that fades fastest, for joints of 1 N m s/rad.
    """

    masses: Array
    first: float
    fastest: float
    share: float
    damping: float
    fading: float


@lru_cache(maxsize=64)
def rope_modes(tip: float) -> RopeModes:
    """The modes of a uniform rope with a part of its mass at its lower end.

    Args:
        tip: share of the mass at the lower end, 0 to 1.
    """
    count = len(_LENGTHS)
    masses = np.full(count, (1.0 - tip) / count)
    masses[-1] += tip
    apart = np.eye(count) - np.eye(count, k=-1)  # the displacement of each mass against the one above it
    turns = apart / _LENGTHS[:, None]
    tension = np.cumsum(masses[::-1])[::-1]
    stiffness = apart.T @ (tension[:, None] * turns)
    squares, shapes = scipy.linalg.eigh(stiffness, np.diag(masses))
    bends = apart @ turns
    joints = bends.T @ bends
    fading = scipy.linalg.eigvalsh(joints, np.diag(masses))[-1]
    first = shapes[:, 0]
    return RopeModes(
        masses=masses,
        first=float(squares[0]),
        fastest=float(squares[-1]),
        share=float(masses @ first) ** 2,
        damping=float(1.0 / (first @ joints @ first)),
        fading=float(fading),
    )


def hanging_rope(
    seconds: Array, pull: Array, rate: Array, length: float, tip: float, damping_ratio: float
) -> tuple[Array, Array]:
    """The force and torque of a rope of 1 kg on its pivot, beside those of its mass at the pivot, (N, 3), world axes.

    Masses on links of fixed length, also for large swings; the tensions of a step follow from the lengths after it
    (SHAKE: Ryckaert, Ciccotti, Berendsen 1977). Its joints are damped, the first one against the vessel. It begins at
    rest along the pull.

    Args:
        seconds: (N,) ascending.
        pull: (N, 3) m/s2, gravity minus acceleration of the pivot, world axes.
        rate: (N, 3) rad/s of the vessel, world axes.
        length: m, of the pendulum that swings as its slowest mode.
        tip: see `rope_modes`.
        damping_ratio: of the slowest mode.
    """
    modes = rope_modes(tip)
    link = length * modes.first  # that swings as a pendulum of this length
    strongest = float(np.linalg.norm(pull, axis=1).max())
    frequency = np.sqrt(float(np.median(np.linalg.norm(pull, axis=1))) / length)
    stiff = _FADES * link**2 / modes.fading  # N m: of joints, times a step
    damping = min(2.0 * damping_ratio * frequency * modes.damping * link**2, stiff / _SHORTEST_STEP)
    fastest = np.sqrt(strongest * modes.fastest / link)
    wanted = max(min(_PHASE / fastest, stiff / max(damping, 1e-12), _LONGEST_STEP), _SHORTEST_STEP)
    # From a geometric ladder: the steps do not change with every length that is tried.
    finer = np.ceil(2.0 * np.log2(_LONGEST_STEP / wanted))
    count = int(np.ceil((seconds[-1] - seconds[0]) / _LONGEST_STEP * 2.0 ** (finer / 2.0))) + 1
    swung = compiled_rope if COMPILED else _swung
    return swung(link * _LENGTHS, modes.masses, seconds, pull, rate, damping, count)


def _swung(
    lengths: Array, masses: Array, seconds: Array, pull: Array, rate: Array, damping: float, steps: int
) -> tuple[Array, Array]:
    """See `poise.kernels.rope`."""
    even = np.linspace(seconds[0], seconds[-1], steps)
    step = float(even[1] - even[0])
    drive, turn = linear_at(seconds, pull, even), linear_at(seconds, rate, even)
    start = drive[0] / np.linalg.norm(drive[0])
    centres, first = _moved(lengths, masses, start, drive, turn, damping, step)
    second = np.zeros_like(centres)
    second[1:-1] = (centres[2:] - 2.0 * centres[1:-1] + centres[:-2]) / step**2
    second[0], second[-1] = second[1], second[-2]
    across = turn - first * np.sum(turn * first, axis=1, keepdims=True)
    twist = damping * (cross(first, np.gradient(first, step, axis=0)) - across)
    return linear_at(even, -second, seconds), linear_at(even, twist, seconds)


def _moved(
    lengths: Array, masses: Array, start: Array, drive: Array, turn: Array, damping: float, step: float
) -> tuple[Array, Array]:
    """Centres of mass (N, 3), m, and directions (N, 3) of the first link at even steps.

    Args:
        lengths, masses: (L,) m of the links, and kg at their lower ends.
        start: (3,) its direction at the first step, where it rests.
        drive: (N, 3) m/s2 on each mass.
        turn: (N, 3) rad/s of what the first link hangs from.
        damping: N m s/rad of each joint.
        step: s.
    """
    beads = np.outer(np.cumsum(lengths), start)
    before, inverse, square = beads, 1.0 / masses, lengths[:, None] ** 2
    centres, directions = [], []
    for push, turning in zip(drive, turn, strict=True):
        along, old = np.diff(beads, axis=0, prepend=0.0), np.diff(before, axis=0, prepend=0.0)
        centres.append(masses @ beads / masses.sum())
        directions.append(along[0] / lengths[0])
        rates = np.vstack([turning, cross(along, along - old) / (step * square)])
        bends = np.diff(rates, axis=0, append=rates[-1:])
        couples = cross(bends[1:] - bends[:-1], along) * damping / square
        forces = couples - np.vstack([couples[1:], np.zeros(3)])
        free = 2.0 * beads - before + step**2 * (push + forces * inverse[:, None])
        before, beads = beads, _projected(lengths, inverse, along, free)
    return np.array(centres), np.array(directions)


def _projected(lengths: Array, inverse: Array, along: Array, free: Array) -> Array:
    """The masses after a step, each a link from the one above it."""
    above = np.concatenate([[0.0], inverse[:-1]])
    tension = np.zeros(len(inverse))
    for _ in range(_PROJECTIONS):
        pulled = tension[:, None] * along
        beads = free + inverse[:, None] * (np.vstack([pulled[1:], np.zeros(3)]) - pulled)
        here = np.diff(beads, axis=0, prepend=0.0)
        off = np.einsum("ni,ni->n", here, here) - lengths**2
        if np.abs(off / lengths**2).max() < 1e-8:
            return np.asarray(beads)
        products = here @ along.T
        slope = -np.diag(np.diag(products) * (inverse + above))
        slope += np.diag(np.diag(products, 1) * inverse[:-1], 1) + np.diag(np.diag(products, -1) * above[1:], -1)
        tension = tension + np.linalg.solve(2.0 * slope, -off)
    # A link turns by more than a right angle in a step: each mass is put at its distance from the one above it.
    above_it = np.zeros(3)
    for index, length in enumerate(lengths):
        here = free[index] - above_it
        above_it = beads[index] = above_it + length / np.linalg.norm(here) * here
    return np.asarray(beads)
