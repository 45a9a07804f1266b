"""Whether a pose is a placement: nothing overlaps, it touches, the assembly stands, and what else is asked of it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly.analysis import Analysis
from poise.assembly.geometry import Array, Pose, unit
from poise.assembly.scene import RigidObject
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement.settling import settle
from poise.placement.uncertainty import Uncertainty, stands_anyway

Test = Callable[[Analysis, RigidObject], bool]
"""A condition on a placement, asked when the assembly with the object in it is known to stand."""

LEAST_MARGIN = 1e-3
"""Of the object's weight: a placement on the verge of moving is none."""


@dataclass(eq=False)
class Validator:
    """Tests poses of one object, the cheap tests first, and counts what turned each away.

    Args:
        analysis: of the assembly without the object.
        item: the object, at any pose.
        tests: further conditions by name (clearance, reach), asked last.
        uncertainty: what the placement has to survive; None: nothing beyond standing.
        settling: let poses that do not stand sink to where they do.
    """

    analysis: Analysis
    item: RigidObject
    tests: Sequence[tuple[str, Test]] = ()
    uncertainty: Uncertainty | None = None
    settling: bool = True
    rejected: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._size = float(np.linalg.norm(np.ptp(self.item.vertices, axis=0)))
        self._up = -unit(self.analysis.assembly.gravity)
        self._weight = self.item.mass * float(np.linalg.norm(self.analysis.assembly.gravity))

    def accept(self, pose: Pose) -> tuple[Analysis, RigidObject] | None:
        """The assembly with the object at this pose, or near it where it settled; None when a test turns it away."""
        there = replace(self.item, pose=pose)
        try:
            analysis = self.analysis.with_object(there)
        except InputError as error:
            known = {ErrorCode.INTERPENETRATION: "overlaps", ErrorCode.FLOATING: "touches nothing"}
            return self._reject(known.get(error.code, error.code.name.lower()))
        try:
            standing = self._standing(analysis, there)
            if standing is None:
                return self._reject("does not stand")
            if self.uncertainty is not None and not stands_anyway(*standing, self.uncertainty):
                return self._reject("stands, but not robustly")
        except NoAnswerError:
            return self._reject("could not be decided")
        for name, test in self.tests:
            if not test(*standing):
                return self._reject(name)
        return standing

    def _reject(self, why: str) -> tuple[Analysis, RigidObject] | None:
        self.rejected[why] += 1
        return None

    def _standing(self, analysis: Analysis, item: RigidObject) -> tuple[Analysis, RigidObject] | None:
        """As it is where it stands, or settled; None when neither stands safely."""
        if self._is_safe(analysis):
            return analysis, item
        settled = settle(analysis, item, self._size) if self.settling and self._nearly(analysis, item) else None
        return settled if settled is not None and self._is_safe(settled[0]) else None

    def _is_safe(self, analysis: Analysis) -> bool:
        """It stands with something to spare, and nothing may roll or swivel freely."""
        if analysis.stability().margin < LEAST_MARGIN * self._weight:
            return False
        held = (block.geometry.grasp.toarray() for block in analysis.blocks)
        return all(np.linalg.matrix_rank(grasp) == len(grasp) for grasp in held)

    def _nearly(self, analysis: Analysis, item: RigidObject) -> bool:
        """Whether sinking could help: the object touches something below its centre of mass."""
        place = analysis.assembly.index[item.id]
        points: list[Array] = [i.points for i in analysis.structure.interfaces if place in (i.first, i.second)]
        if not points:
            return False
        offset = np.concatenate(points).mean(axis=0) - item.com_in_world
        across = offset - (offset @ self._up) * self._up
        return bool(offset @ self._up < 0 and np.linalg.norm(across) < self._size / 4)
