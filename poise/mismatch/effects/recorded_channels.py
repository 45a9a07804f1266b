"""A residual in the channels that were recorded, a wrench or joint efforts, where forces on the load are searched."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from poise.geometry import cross_matrix
from poise.mismatch.effects.part_wrench import beside_states, error_states
from poise.mismatch.recorded import RecordedMotion, efforts_alone
from poise.types import Array, Mask

_LOOSE = 1e-3
"""Precision of the place of a force, relative to what the channels say of it on average."""


@dataclass(frozen=True, eq=False)
class RecordedChannels:
    """A residual beside other errors, each channel in units of its size.

    The noise of joint efforts is that of each joint: in the wrench that explains them it has another size in every
    configuration.

    Args:
        few: the motion.
        shows: (N, C, 6) the channels by a wrench; None where they are the wrench.
        left: (N, 6) the wrench that is unexplained, of efforts the least that explains them.
        wanted: (N, C) the unexplained channels beside other errors, weighed.
        weight: (C,) of the channels.
        errors: (N, 10) states of other errors, see `error_states`.
    """

    few: RecordedMotion
    shows: Array | None
    left: Array
    wanted: Array
    weight: Array
    errors: Array

    @classmethod
    def of(cls, few: RecordedMotion, left: Array) -> Self:
        """The channels of a residual (N, 6)."""
        shows = efforts_alone(few)
        channels = left if shows is None else np.einsum("nci,ni->nc", shows, left)
        weight = 1.0 / np.maximum(np.sqrt(np.mean(channels**2, axis=0)), 1e-9)
        errors = error_states(few)
        return cls(few, shows, left, beside_states(errors, channels) * weight, weight, errors)

    def at(self, rows: Mask) -> Self:
        """Some samples of it; the errors are those of all."""
        shows = None if self.shows is None else self.shows[rows]
        few, left, wanted, errors = self.few.select(rows), self.left[rows], self.wanted[rows], self.errors[rows]
        return replace(self, few=few, shows=shows, left=left, wanted=wanted, errors=errors)

    def beside(self, wrenches: Array) -> Array:
        """(N C, k) the channels of wrenches (N, 6, k) beside other errors, weighed."""
        seen = wrenches if self.shows is None else self.shows @ wrenches
        left = beside_states(self.errors, seen)
        return np.asarray((left * self.weight[:, None]).reshape(-1, seen.shape[2]))

    def by_size_and_place(self, pull: Array) -> tuple[Array, Array]:
        """(K, 4, 4) and (K, 4), the normal equations of the size of a force (K, 3, N) and of size times place."""
        normal, right = self._of_wrench(pull) if self.shows is None else self._of_efforts(pull, self.shows)
        loose = np.einsum("kii->k", normal[:, 1:, 1:])
        normal[:, 1:, 1:] += (_LOOSE * loose + 1e-12)[:, None, None] * np.eye(3)
        normal[:, 0, 0] += 1e-12
        return normal, right

    def _of_wrench(self, pull: Array) -> tuple[Array, Array]:
        """Forces act in three channels, and their torques in the others: channels have no products."""
        weight = self.weight**2
        besides, along = pull @ self.errors, pull @ (self.wanted * self.weight)
        squares = pull @ pull.swapaxes(1, 2) - besides @ besides.swapaxes(1, 2)
        levers = cross_matrix(np.eye(3))  # e_i x f
        normal = np.zeros((len(pull), 4, 4))
        normal[:, 0, 0] = np.einsum("kii,i->k", squares, weight[:3])
        normal[:, 1:, 1:] = np.einsum("ica,kab,jcb,c->kij", levers, squares, levers, weight[3:], optimize=True)
        size, place = np.einsum("kii->k", along[:, :, :3]), np.einsum("ica,kac->ki", levers, along[:, :, 3:])
        return normal, np.concatenate([size[:, None], place], axis=1)

    def _of_efforts(self, pull: Array, shows: Array) -> tuple[Array, Array]:
        levers = [shows[:, :, 3:] @ lever for lever in cross_matrix(np.eye(3))]
        by_force = np.stack([shows[:, :, :3], *levers], axis=1) * self.weight[:, None]  # (N, 4, C, 3)
        normal, right = np.empty((len(pull), 4, 4)), np.empty((len(pull), 4))
        for k, force in enumerate(pull):
            columns = (by_force @ force.T[:, None, :, None])[..., 0]  # (N, 4, C)
            flat, besides = columns.swapaxes(0, 1).reshape(4, -1), np.tensordot(self.errors, columns, (0, 0))
            own = besides.swapaxes(0, 1).reshape(4, -1)
            normal[k], right[k] = flat @ flat.T - own @ own.T, flat @ self.wanted.ravel()
        return normal, right
