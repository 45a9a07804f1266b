"""What every format gives and takes: bodies with solids, friction and inertia; and the registry's contract."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from poise.assembly import Assembly
from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.geometry import STANDARD_GRAVITY, Pose
from poise.inertia import InertialParameters
from poise.types import Array


@dataclass(frozen=True, eq=False)
class WorldSolid:
    """One shape of a body.

    Args:
        shape: about its own frame.
        pose: of that frame, in the body's.
        friction: Coulomb coefficient of its surface; None: the file has none.
    """

    shape: Shape
    pose: Pose
    friction: float | None = None


@dataclass(frozen=True, eq=False)
class WorldBody:
    """A rigid body of a world.

    Args:
        name: in the file.
        pose: of the body's frame, in the world.
        solids: what it consists of; at least one.
        fixed: it does not move.
        inertial: in the body's frame, with NaN for what the file does not have; None: it has no mass.
    """

    name: str
    pose: Pose
    solids: tuple[WorldSolid, ...]
    fixed: bool
    inertial: InertialParameters | None = None


def without_friction_of_its_own(first: float, second: float) -> float:
    """For formats that have no coefficients of surfaces."""
    return max(first, second)


@dataclass(frozen=True, eq=False)
class WorldContent:
    """A world of another program.

    Args:
        bodies: in the order of the file.
        gravity: (3,) m/s2.
        combine: the coefficient of two surfaces from that of each.
        pairs: coefficients that the file gives for two bodies by name.
        notes: what was assumed and left out, one sentence each.
        friction: of surfaces that have none in the file.
        friction_note: what was assumed of friction; empty for nothing.
    """

    bodies: tuple[WorldBody, ...]
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    combine: Callable[[float, float], float] = without_friction_of_its_own
    pairs: Mapping[tuple[str, str], float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    friction: float = 0.5
    friction_note: str = ""


class WorldFormat(ABC):
    """A format for worlds. Its file is in `poise/worlds`.

    Attributes:
        name: of the format, and of its file.
        description: one sentence for help and docs.
        suffixes: endings of its files, in lower case.
        needs, extra: modules that reading needs, and the extra that has them.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    needs: ClassVar[tuple[str, ...]] = ()
    extra: ClassVar[str] = ""

    @abstractmethod
    def recognises(self, head: bytes) -> bool:
        """Whether a file with one of the suffixes is of this format, by its first bytes."""

    @abstractmethod
    def read(self, path: Path) -> WorldContent:
        """The bodies of a file.

        Raises:
            InputError: FILE_CORRUPT, BAD_INPUT, UNSUPPORTED, or what a mesh file raises.
        """

    def written(self, assembly: Assembly, path: Path) -> tuple[bytes, tuple[str, ...]]:
        """The content of a file, and what it cannot express, one sentence each; meshes are written beside it.

        Raises:
            InputError: UNSUPPORTED when this format is only read.
        """
        del assembly
        raise InputError(ErrorCode.UNSUPPORTED, f"{path}: {self.name} files are read, and not written")
