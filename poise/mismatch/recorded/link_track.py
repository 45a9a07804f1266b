"""What each link adds to the joint efforts, and the base parameters that these efforts can show."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from poise.types import Array, Mask

LINK_PARAMETERS = ("mass", "moment_x", "moment_y", "moment_z", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")
"""Of a link, in the axes of its joint and about that joint's origin, in pinocchio's order."""

_ROWS = 600
"""Samples that decide which parameters are independent."""
_VISIBLE = 0.02
"""Least response to a change of a parameter by its typical size, in units of the rms effort of the joints."""
_LEAST_SIZE = 0.05
"""Least rms effort that counts for a joint, in units of the largest one; forces and torques have no common unit."""


@dataclass(frozen=True, eq=False)
class LinkTrack:
    """The links at the stamps of an `EffortTrack` (M), of J joints; L links, from the base outwards.

    Args:
        numbers: (L) of the joint that carries each link; 1 is the first joint of the arm.
        efforts: (M, J, L) N m that each link needs as modelled; their sum is the effort of the arm without payload.
        by_parameter: (M, J, L, 10) response to each of `LINK_PARAMETERS` by its typical size: the link's mass, mass
            times reach, mass times reach squared.
        slides: (J,) the joints that slide: their efforts are forces.
    """

    numbers: tuple[int, ...]
    efforts: Array
    by_parameter: Array
    slides: tuple[bool, ...]

    def __getitem__(self, rows: Mask | slice) -> "LinkTrack":
        return replace(self, efforts=self.efforts[rows], by_parameter=self.by_parameter[rows])

    def of_joints(self, keep: Mask) -> "LinkTrack":
        """Of a part of the joints, (J) bool."""
        slides = tuple(slide for slide, kept in zip(self.slides, keep.tolist(), strict=True) if kept)
        return LinkTrack(self.numbers, self.efforts[:, keep], self.by_parameter[:, keep], slides)

    @cached_property
    def base_parameters(self) -> tuple[tuple[str, ...], Array]:
        """Names and columns (M, J, B) of parameters that act independently (Gautier 1991: QR with pivoting).

        The most visible parameter of a dependent set represents the set.
        """
        count, joints = self.efforts.shape[:2]
        names = [f"{name}_{number}" for number in self.numbers for name in LINK_PARAMETERS]
        wide = self.by_parameter.reshape(count, joints, -1)
        rows = wide[:: max(count // _ROWS, 1)]
        size = np.sqrt(np.mean(self.efforts.sum(axis=2) ** 2, axis=0))
        slides = np.array(self.slides, dtype=bool)
        for alike in (slides, ~slides):
            size[alike] = np.maximum(size[alike], _LEAST_SIZE * size[alike].max(initial=1e-9))
        flat = (rows / size[:, None]).reshape(-1, wide.shape[2])
        if not flat.size:
            return (), np.zeros((count, joints, 0))
        triangle, order = qr(flat, mode="r", pivoting=True)
        left = np.abs(np.diag(triangle)) / np.sqrt(len(flat) / joints)
        kept = sorted(order[: int((left > _VISIBLE).sum())].tolist())
        return tuple(names[i] for i in kept), wide[:, :, kept]
