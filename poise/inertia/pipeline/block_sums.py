"""Normal equations of payloads and one bias over spans of blocks, and what cutting or joining spans changes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poise.inertia.pipeline.block_means import BIAS_SPREAD, PHI_SPREAD, BlockMeans
from poise.types import Array, Indices, Mask


@dataclass(frozen=True, eq=False)
class Normals:
    """Normal equations of phi and bias, of every block, weighted by the scale of its errors.

    Args:
        information: (B, 16, 16).
        vector: (B, 16).
    """

    information: Array
    vector: Array

    @classmethod
    def of(cls, blocks: BlockMeans, scale: Array) -> "Normals":
        """For errors of a scale (B, 6), N and N m."""
        rows = np.concatenate([blocks.matrix, blocks.bias_matrix], axis=2) / scale[:, :, None]
        back = rows.swapaxes(1, 2)
        return cls(back @ rows, (back @ (blocks.wrench / scale)[:, :, None])[:, :, 0])

    def sums(self, keep: Mask) -> "NormalSums":
        """Over the blocks `keep` (B,)."""
        information, vector = self.information * keep[:, None, None], self.vector * keep[:, None]
        return NormalSums(
            np.concatenate([np.zeros((1, 16, 16)), np.cumsum(information, axis=0)]),
            np.concatenate([np.zeros((1, 16)), np.cumsum(vector, axis=0)]),
        )


@dataclass(frozen=True, eq=False)
class NormalSums:
    """Normal equations summed from the first block to each.

    Args:
        information: (B + 1, 16, 16).
        vector: (B + 1, 16).
    """

    information: Array
    vector: Array

    def solved(self, bounds: Sequence[int]) -> tuple[Array, Array]:
        """(K, 10) phi between every two of K + 1 bounds, and (6,) the bias that they have in common."""
        edges = np.asarray(bounds)
        solved, information, vector, _ = self._reduced(edges[:-1], edges[1:])
        bias = np.linalg.solve(information.sum(axis=0) + np.diag(BIAS_SPREAD**-2.0), vector.sum(axis=0))
        return solved[:, :, 6] - solved[:, :, :6] @ bias, bias

    def bias(self, spans: Sequence[tuple[int, int]], correlated: float) -> tuple[Array, Array]:
        """The bias (6,) that the payloads of some spans leave, N and N m, and its largest deviations (2,)."""
        begin, end = np.array(spans).T
        _, information, vector, _ = self._reduced(begin, end)
        covariance = np.linalg.inv(information.sum(axis=0) / correlated + np.diag(BIAS_SPREAD**-2.0))
        mean = covariance @ vector.sum(axis=0) / correlated
        return mean, np.sqrt(np.diag(covariance)).reshape(2, 3).max(axis=1)

    def gains(self, begin: int, where: Indices, end: int, others: Sequence[tuple[int, int]]) -> Array:
        """(C,) by how much squared errors fall, when the span from begin to end is cut at each of `where` (C,).

        Args:
            begin, where, end: blocks.
            others: all other spans, which share the bias.
        """
        rest = [self._reduced(np.array([one]), np.array([other]))[1:] for one, other in others]
        left, right = self._reduced(np.full_like(where, begin), where), self._reduced(where, np.full_like(where, end))
        whole = self._reduced(np.array([begin]), np.array([end]))
        return _explained([left[1:], right[1:], *rest]) - _explained([whole[1:], *rest])

    def losses(self, bounds: Sequence[int]) -> Array:
        """(K - 1,) by how much squared errors rise, when each two neighbours of K spans become one."""
        edges = np.asarray(bounds)
        _, information, vector, squares = self._reduced(edges[:-1], edges[1:])
        merged = self._reduced(edges[:-2], edges[2:])[1:]
        whole = (information.sum(axis=0)[None], vector.sum(axis=0)[None], squares.sum()[None])
        less = [
            total - part[:-1] - part[1:] + joined
            for total, part, joined in zip(whole, (information, vector, squares), merged, strict=True)
        ]
        return _explained([whole]) - _explained([(less[0], less[1], less[2])])

    def _reduced(self, begin: Indices, end: Indices) -> tuple[Array, Array, Array, Array]:
        """The payload of spans integrated out.

        Returns:
            (C, 10, 7) slopes of phi along the bias, and phi without one; (C, 6, 6) and (C, 6) about the bias; (C,) the
            squares that the payload explains.
        """
        information = self.information[end] - self.information[begin]
        vector = self.vector[end] - self.vector[begin]
        own = information[:, :10, :10] + np.diag(PHI_SPREAD**-2.0)
        cross = information[:, :10, 10:]
        solved = np.linalg.solve(own, np.concatenate([cross, vector[:, :10, None]], axis=2))
        back = cross.swapaxes(1, 2) @ solved
        squares = np.sum(vector[:, :10] * solved[:, :, 6], axis=1)
        return solved, information[:, 10:, 10:] - back[:, :, :6], vector[:, 10:] - back[:, :, 6], squares


def _explained(parts: Sequence[tuple[Array, Array, Array]]) -> Array:
    """(C,) squares explained by payloads and one bias; parts are what `_reduced` gives, but for the first."""
    information = sum((part[0] for part in parts), np.diag(BIAS_SPREAD**-2.0))
    vector = sum((part[1] for part in parts), np.zeros(6))
    bias = np.linalg.solve(information, vector[:, :, None])[:, :, 0]
    return np.asarray(sum((part[2] for part in parts), np.sum(vector * bias, axis=1)))
