"""Whether a pose is a placement: nothing overlaps, it touches, the assembly stands, and what else is asked of it."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.assembly.contact import way_out
from poise.assembly.statics import rolling
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.placement.balance import BALANCE_ROUNDING, unbalanced_weight
from poise.placement.settling import settle
from poise.placement.uncertainty import Uncertainty, stands_disturbed
from poise.types import Array

PlacementTest = Callable[[Analysis, RigidObject], bool]
"""A condition on a placement, asked when the assembly with the object in it is known to stand."""
PoseTest = Callable[[RigidObject], bool]
"""A condition on the object at its pose alone, asked before contacts are looked for."""

OVERLAPS, APART, FALLS, ROLLS = "overlaps", "touches nothing", "does not stand", "may roll: no chock or lip holds it"
ENCLOSED = "no straight way leads there"
UNDECIDED, SENSITIVE = "could not be decided", "stands, but not robustly"
"""Why a pose is rejected; undecided when a solver fails."""
_LOOSE = 3e-4
"""m: wider gaps, which the tolerance of scans would let pass as contact, carry no placement that is planned."""
_DEEP = 3e-4
"""m: deeper overlaps, which the tolerance of scans would let pass as contact, push a placed object away."""
_LEAST_MARGIN = 1e-3
"""Of the object's weight: a placement on the verge of moving is none."""
_TALL = 10.0
"""m over an object that is kept free."""
_ALMOST = 0.15
"""Of the object's weight unbalanced_weight: what is more is too far off to sink to where it stands."""


def require_new(objects: Iterable[RigidObject], item: RigidObject) -> None:
    """Check that an object can join others.

    Raises:
        InputError: BAD_INPUT when it is fixed, or one of them has its id.
    """
    if item.fixed or item.id in [other.id for other in objects]:
        raise InputError(
            ErrorCode.BAD_INPUT, f"object {item.id}: give it a mass and an id that is not in the scene yet"
        )


@dataclass(frozen=True, eq=False)
class KeptFree:
    """A pose test that keeps a region free, for example where the next objects will be picked up.

    Args:
        low, high: (3,) m, corners of the room in the world.

    Raises:
        InputError: BAD_INPUT when that is no room.
    """

    low: Array
    high: Array

    def __post_init__(self) -> None:
        if not np.all(np.isfinite([*self.low, *self.high])) or not np.all(np.less(self.low, self.high)):
            region = f"{np.asarray(self.low).tolist()} to {np.asarray(self.high).tolist()} m"
            raise InputError(ErrorCode.BAD_INPUT, f"room to be kept free, {region}: give the lower corner first")

    def __call__(self, item: RigidObject) -> bool:
        corners = item.vertices
        return bool(np.any((corners.min(axis=0) >= self.high) | (corners.max(axis=0) <= self.low)))


def kept_free(assembly: Assembly, names: Sequence[str], gone: Collection[str] = ()) -> tuple[tuple[str, PoseTest], ...]:
    """For `Options.looks`: nothing is placed over objects of these names.

    Args:
        assembly: that has the objects.
        names: of objects.
        gone: names that the assembly had before, and may lack.

    Raises:
        InputError: OBJECT_UNKNOWN for a name that the assembly lacks, with those that it has.
    """
    looks: list[tuple[str, PoseTest]] = []
    for name in names:
        if name in assembly.index:
            corners = assembly.objects[assembly.place_of(name)].vertices
            low, high = corners.min(axis=0), corners.max(axis=0) + np.array([0.0, 0.0, _TALL])
            looks.append((f"is over {name}, which is kept free", KeptFree(low, high)))
        elif name not in gone:
            there = ", ".join(item.id for item in assembly.objects)
            raise InputError(
                ErrorCode.OBJECT_UNKNOWN, f"keep_free: the assembly has no object {name!r}; it has {there}", object=name
            )
    return tuple(looks)


@dataclass(eq=False)
class Validator:
    """Tests poses of one object, the cheap tests first, and counts what turned each away.

    Args:
        analysis: of the assembly without the object.
        item: the object, at any pose.
        tests: further conditions by name (clearance, reach), asked last.
        looks: cheap conditions by name on the pose alone, asked first.
        uncertainty: what the placement has to survive; None: nothing beyond standing.
        settling: let poses that do not stand sink to where they do.
    """

    analysis: Analysis
    item: RigidObject
    tests: Sequence[tuple[str, PlacementTest]] = ()
    looks: Sequence[tuple[str, PoseTest]] = ()
    uncertainty: Uncertainty | None = None
    settling: bool = True
    rejected: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._size = float(np.linalg.norm(np.ptp(self.item.vertices, axis=0)))
        self._weight = self.item.mass * float(np.linalg.norm(self.analysis.assembly.gravity))

    def accept(self, pose: Pose, settling: bool = True) -> tuple[Analysis, RigidObject] | None:
        """The assembly with the object at this pose, or near it where it settled; None when a test turns it away.

        `settling` False: poses that do not stand are turned away, although the validator lets them settle.
        """
        there = replace(self.item, pose=pose)
        if (why := self._looks_wrong(there)) is not None:
            return self._reject(why)
        try:
            analysis = self.analysis.with_object(there)
        except InputError as error:
            known = {ErrorCode.INTERPENETRATION: OVERLAPS, ErrorCode.FLOATING: APART}
            return self._reject(known.get(error.code, error.code.name.lower()))
        if _overlaps(analysis, there):
            return self._reject(OVERLAPS)
        try:
            standing = self._standing(_without_gaps(analysis, there), there, settling and self.settling)
            if isinstance(standing, str):
                return self._reject(standing)
            if any(self.item.id in found.objects for found in rolling(standing[0])):
                return self._reject(ROLLS)
            if standing[1] is not there and (why := self._looks_wrong(standing[1])) is not None:
                return self._reject(why)
            if standing[1] is not there and _overlaps(*standing):
                return self._reject(OVERLAPS)
            if not _is_open(*standing):
                return self._reject(ENCLOSED)
            if self.uncertainty is not None and not stands_disturbed(*standing, self.uncertainty):
                return self._reject(SENSITIVE)
            failed = next((name for name, test in self.tests if not test(*standing)), None)
        except NoAnswerError:
            return self._reject(UNDECIDED)
        return standing if failed is None else self._reject(failed)

    def _looks_wrong(self, item: RigidObject) -> str | None:
        return next((name for name, look in self.looks if not look(item)), None)

    def _reject(self, why: str) -> tuple[Analysis, RigidObject] | None:
        self.rejected[why] += 1
        return None

    def _standing(self, analysis: Analysis, item: RigidObject, settling: bool) -> tuple[Analysis, RigidObject] | str:
        """As it is where it stands, or settled; or why neither stands safely."""
        left = unbalanced_weight(analysis, item)
        why: str | None = FALLS
        if left < BALANCE_ROUNDING and (why := self._danger(analysis, item)) is None:
            return analysis, item
        if not settling or left > _ALMOST:
            return why or FALLS
        settled = settle(analysis, item, self._size)
        if settled is None:
            return why or FALLS
        settled = _without_gaps(*settled), settled[1]
        return self._danger(*settled) or settled

    def _danger(self, analysis: Analysis, item: RigidObject) -> str | None:
        """Why it does not stand with something to spare, or may roll or swivel freely. The cheap questions come first.

        None when it stands.
        """
        place = analysis.assembly.index[item.id]
        blocks = sorted(analysis.blocks, key=lambda block: place not in block.body_of)
        # Objects elsewhere may be far lighter than this one: their margins are shares of their own weight.
        least = [_LEAST_MARGIN * min(self._weight / block.geometry.units.weight, 1.0) for block in blocks]
        everywhere = True
        for block, share in zip(blocks, least, strict=True):
            held = block.solvers.held(share)
            if held.margin < share:
                return FALLS
            everywhere &= held.everywhere
        if not everywhere:
            return ROLLS
        if analysis.structure.floating:
            return FALLS
        if not all(block.solvers.stands_by(share) for block, share in zip(blocks, least, strict=True)):
            return FALLS
        return None


def _without_gaps(analysis: Analysis, item: RigidObject) -> Analysis:
    """The analysis without what only nearly touches an object: it would sink by the gap, and perhaps keep moving."""
    structure, place = analysis.structure, analysis.assembly.index[item.id]
    kept = tuple(i for i in structure.interfaces if place not in (i.first, i.second) or i.gap <= _LOOSE)
    return analysis if len(kept) == len(structure.interfaces) else Analysis(replace(structure, interfaces=kept))


def _is_open(analysis: Analysis, item: RigidObject) -> bool:
    """Whether the object can be moved there, or away, along a straight line."""
    structure, place = analysis.structure, analysis.assembly.index[item.id]
    return way_out(analysis.assembly, structure.interfaces, place, structure.margin).direction is not None


def _overlaps(analysis: Analysis, item: RigidObject) -> bool:
    """Whether an object is in another one by more than rounding."""
    place = analysis.assembly.index[item.id]
    return any(place in (i.first, i.second) and i.gap < -_DEEP for i in analysis.structure.interfaces)
