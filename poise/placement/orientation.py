"""Which axes of an object may point up when it is placed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.types import Array

_SIGNED = dict(zip(("x", "y", "z", "-x", "-y", "-z"), np.concatenate([np.eye(3), -np.eye(3)]), strict=True))
TURNED = "another axis than allowed points up"
"""Why `Upright` rejects a pose."""
_TOLERANCE = 5.0
"""Degrees."""


@dataclass(frozen=True, eq=False)
class Upright:
    """A pose test: one of some axes of the object points up.

    Args:
        axes: of the object frame, as x, y, z, -x, -y or -z; none: any.
        of: axes of single objects, by id, in place of `axes`.
        up: (3,) unit vector in the world.
        tolerance: degrees between the axis and up.

    Raises:
        InputError: BAD_INPUT for an unknown axis.
    """

    axes: Sequence[str] = ("z",)
    of: Mapping[str, Sequence[str]] = field(default_factory=dict)
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    tolerance: float = _TOLERANCE

    def __post_init__(self) -> None:
        for axis in [*self.axes, *(axis for axes in self.of.values() for axis in axes)]:
            if axis not in _SIGNED:
                raise InputError(ErrorCode.BAD_INPUT, f"axis {axis!r}: choose from {', '.join(_SIGNED)}")

    def __call__(self, item: RigidObject) -> bool:
        return self.allows(item.id, item.pose.rotation.T @ self.up)

    def allows(self, name: str, up_in_object: Array) -> bool:
        """Whether a direction (3,) of an object may point up."""
        axes = self.of.get(name, self.axes)
        least = np.cos(np.radians(self.tolerance))
        return not axes or any(float(_SIGNED[axis] @ up_in_object) >= least for axis in axes)
