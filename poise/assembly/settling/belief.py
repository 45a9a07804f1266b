"""What is known about where bodies are: a Gaussian of small steps, conditioned on contacts that hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular
from scipy.linalg.blas import dgemm
from scipy.optimize import nnls

from poise.assembly.settling.rows import DistanceRows, moved, steps_between
from poise.geometry import Pose
from poise.types import Array, Indices

POINTS = 3
"""Distances at each place where two bodies may touch."""
MIDDLE = np.array([0.25, 0.25, 0.5])
"""Weights of these distances for that in the middle."""
_FIT = 1e-4
"""m, one sigma: how exactly distances at contacts become zero where bodies are still tilted. There the linearised
distances of contacts that follow from others disagree by some hundredths of a millimetre."""
_KNOWN = 4e-4
"""m, one sigma of distances that follow from others."""
_EXACT = 1e-6
"""m and rad, one sigma of what is known exactly."""
_LACKING = 1e-9
"""m by which a distance may be below its bound."""
_REACH = 4e-3
"""m: distances that are larger than their bound by more than this are not looked at in one iteration."""


@dataclass(frozen=True, eq=False)
class SeenBodies:
    """Where bodies were seen, and how well that is known.

    Args:
        poses: N poses.
        slot: (N,) the number of each body among the M that may move; -1 for others.
        covariance: (M, 6, 6) of steps, as in `DistanceRows.linearised`.
    """

    poses: Pose
    slot: Indices
    covariance: Array

    @property
    def count(self) -> int:
        """M."""
        return len(self.covariance)

    def spread(self, rows: DistanceRows) -> tuple[Array, Array]:
        """(M,) m: one sigma of each distance, and how far it may be off if all independent errors are one sigma."""
        _, *blocks = rows.linearised(self.poses)
        square, largest = np.zeros(len(rows)), np.zeros(len(rows))
        for places, block in zip((rows.first, rows.second), blocks, strict=True):
            slot = self.slot[places]
            by_error = np.where(slot[:, None] >= 0, np.einsum("mi,mij->mj", block, self.roots[slot]), 0.0)
            square, largest = square + np.sum(by_error**2, axis=1), largest + np.abs(by_error).sum(axis=1)
        return np.sqrt(square), largest

    @cached_property
    def roots(self) -> Array:
        """(M, 6, 6) of the covariances: columns are the independent errors, one sigma each."""
        variances, axes = self._independent
        return np.asarray(axes * np.sqrt(np.maximum(variances, 0.0))[:, None])

    @cached_property
    def _independent(self) -> tuple[Array, Array]:
        """(M, 6) variances of the independent errors, and (M, 6, 6) their directions, as columns."""
        return np.linalg.eigh(self.covariance)

    def sigmas(self, steps: Array) -> Array:
        """(N,) the largest of the independent errors in steps (N, 6), in standard deviations; of all that may move."""
        variances, axes = self._independent
        errors = np.einsum("nij,ni->nj", axes[self.slot], steps) / np.sqrt(np.maximum(variances, _EXACT**2))[self.slot]
        return np.where(self.slot >= 0, np.abs(errors).max(axis=1), 0.0)

    def jacobian(self, rows: DistanceRows, poses: Pose) -> tuple[Array, Array]:
        """Distances (R,) and their derivatives (R, 6 M)."""
        distance, *blocks = rows.linearised(poses)
        jacobian = np.zeros((len(rows), self.count, 6))
        for places, block in zip((rows.first, rows.second), blocks, strict=True):
            own = np.flatnonzero(self.slot[places] >= 0)
            jacobian[own, self.slot[places[own]]] += block[own]
        return distance, jacobian.reshape(len(rows), 6 * self.count)

    def by_errors(self, jacobian: Array) -> Array:
        """(R, 6 M) derivatives by the independent errors, one sigma each, of those by steps (R, 6 M)."""
        blocks = jacobian.reshape(len(jacobian), self.count, 6).transpose(1, 0, 2) @ self.roots
        return np.asarray(blocks.transpose(1, 0, 2).reshape(len(jacobian), 6 * self.count))

    def steps_of(self, errors: Array) -> Array:
        """(6 M,) steps that independent errors (6 M,), in sigmas, are."""
        return np.asarray((self.roots @ errors.reshape(self.count, 6, 1)).ravel())

    def stepped(self, poses: Pose, steps: Array) -> Pose:
        """The N poses after steps (6 M,) of those that may move."""
        every = np.zeros((len(self.slot), 6))
        every[self.slot >= 0] = steps.reshape(-1, 6)[self.slot[self.slot >= 0]]
        return moved(poses, every)


class Belief:
    """The Gaussian of all steps from where the bodies were seen, conditioned on one contact after the other.

    Args:
        bodies: where they were seen.
        rows: of all places where they may touch, `POINTS` each.
    """

    def __init__(self, bodies: SeenBodies, rows: DistanceRows) -> None:
        self.distance, self.of_first, self.of_second = rows.linearised(bodies.poses)
        self._slots = bodies.slot[rows.first[::POINTS]], bodies.slot[rows.second[::POINTS]]
        self._sides = (self.of_first, self._slots[0]), (self.of_second, self._slots[1])
        self.accepted: list[int] = []
        self.mean = np.zeros(6 * bodies.count)
        self.covariance = block_diag(*bodies.covariance)

    def shift(self, number: int, of_first: bool) -> Array:
        """(POINTS,) m by which the mean of one body alone changes the distances of a place."""
        slot = int(self._slots[0 if of_first else 1][number])
        rows = slice(POINTS * number, POINTS * number + POINTS)
        block = (self.of_first if of_first else self.of_second)[rows]
        return np.asarray(block @ self.mean[6 * slot : 6 * slot + 6] if slot >= 0 else np.zeros(POINTS))

    def expected(self, numbers: Indices) -> tuple[Array, Array]:
        """Means (K, POINTS), m, and covariances (K, POINTS, POINTS) of the distances of K places."""
        rows = POINTS * numbers[:, None] + np.arange(POINTS)
        blocks = [np.where(slot[numbers] >= 0, 1.0, 0.0)[:, None, None] * of[rows] for of, slot in self._sides]
        slots = [slot[numbers] for _, slot in self._sides]
        mean, each = self.mean.reshape(-1, 6), self.covariance.reshape(len(self.mean) // 6, 6, -1, 6)
        distance = self.distance[rows]
        for block, slot in zip(blocks, slots, strict=True):
            distance = distance + (block @ mean[slot][:, :, None])[:, :, 0]
        own = [
            block @ each[slot, :, slot] @ block.transpose(0, 2, 1) for block, slot in zip(blocks, slots, strict=True)
        ]
        across = blocks[0] @ each[slots[0], :, slots[1]] @ blocks[1].transpose(0, 2, 1)
        return distance, own[0] + own[1] + across + across.transpose(0, 2, 1)

    def accept(self, number: int) -> bool:
        """Condition on distances of zero, to within `_FIT`; False if they follow from those before: nothing changes."""
        distance, jacobian, columns = self._local(number)
        across = self.covariance[:, columns] @ jacobian.T
        expected = jacobian @ across[columns]
        if np.trace(expected) < _KNOWN**2:
            return False
        self.accepted.append(number)
        expected += _FIT**2 * np.eye(POINTS)
        gain = across @ np.linalg.inv(expected)
        self.mean -= gain @ (distance + jacobian @ self.mean[columns])
        # In place: covariance - gain across', both of which are symmetric.
        dgemm(-1.0, across, gain, 1.0, self.covariance.T, trans_b=True, overwrite_c=True)
        return True

    def _local(self, number: int) -> tuple[Array, Array, Indices]:
        """Distances of a place, and their derivatives for the columns of its bodies alone."""
        rows = slice(POINTS * number, POINTS * number + POINTS)
        blocks = self.of_first[rows], self.of_second[rows]
        own = [side for side in (0, 1) if self._slots[side][number] >= 0]
        columns = np.concatenate([6 * self._slots[side][number] + np.arange(6) for side in own])
        return self.distance[rows], np.concatenate([blocks[side] for side in own], axis=1), columns


def most_likely(
    bodies: SeenBodies,
    start: Pose,
    contacts: DistanceRows,
    apart: DistanceRows,
    bounds: Array,
    slack: Array,
    fits: Sequence[float],
) -> Pose:
    """The most likely poses at which all contacts touch and other distances keep their bounds (Gauss-Newton).

    In each iteration the Gaussian is conditioned on the contacts (a Kalman update, in the space of the independent
    errors: contacts outnumber them), and then moved by as little as the bounds need (Lawson, Hanson 1974, on the dual).

    Args:
        bodies: where they were seen.
        start: poses to linearise at first.
        contacts: distances that become zero.
        apart: distances that become at least `bounds` (R,), m, as exactly as `slack` (R,), m, says.
        fits: m, one sigma of the distances at contacts, in each iteration: from coarse to fine.
    """
    poses = start
    seen = bodies.slot >= 0
    order = np.argsort(bodies.slot[seen])
    for fit in fits:
        steps = steps_between(poses, bodies.poses)[seen][order].ravel()
        distance, jacobian = bodies.jacobian(contacts, poses)
        by_errors = bodies.by_errors(jacobian)
        # What is left of the covariance is fit^2 times the inverse of this.
        root = cholesky(by_errors.T @ by_errors + fit**2 * np.eye(len(steps)), lower=True)
        half = solve_triangular(root, by_errors.T @ (distance + jacobian @ steps), lower=True)
        steps = steps - bodies.steps_of(solve_triangular(root, half, lower=True, trans=1))
        height, slopes = bodies.jacobian(apart, poses)
        lacking = bounds - height - slopes @ steps
        close = np.flatnonzero(lacking > -_REACH)
        slopes, lacking, inexact = slopes[close], lacking[close], slack[close] ** 2
        needed, moves = np.zeros(len(close), dtype=bool), np.zeros_like(steps)
        # Few bounds push: only those that lack something, one after the other, are part of the program.
        while np.any(lacks := ~needed & (lacking - slopes @ moves > _LACKING)):
            needed |= lacks
            free = fit * solve_triangular(root, bodies.by_errors(slopes[needed]).T, lower=True)
            stiff = cholesky(free.T @ free + np.diag(inexact[needed]), lower=True)
            push = free @ nnls(stiff.T, solve_triangular(stiff, lacking[needed], lower=True))[0]
            moves = bodies.steps_of(fit * solve_triangular(root, push, lower=True, trans=1))
        steps = steps + moves
        poses = bodies.stepped(poses, steps)
    return poses
