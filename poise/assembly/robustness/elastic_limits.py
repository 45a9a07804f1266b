"""Acceleration limits of a block whose contact forces have a choice: elastic contacts confirm each direction.

What contact forces within friction cones hold is a convex set of accelerations. Elastic contacts hold a part of it that
is convex, too, as far as measured (benchmarks/level_limits.py). So few directions around the level plane are followed
from rest; the others begin at states between those of their neighbours, which is often one equilibrium at collapse.
Of directions that symmetries of the block carry into each other one is asked; its state is carried on, and checked.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly.robustness.patch_answers import patch_factor
from poise.assembly.robustness.plane_curve import Chord, PlaneCurve
from poise.assembly.statics import (
    FACTOR_TOLERANCE,
    BlockAnalysis,
    Deadline,
    ElasticFactor,
    InverseLoadFactor,
    Mechanism,
    Symmetry,
)
from poise.geometry import cross
from poise.types import Array, Indices, Mask

_NEARLY, _CLOSE, _LARGE = 0.02, 0.01, 20
"""In blocks of more bodies than that, limits this near to what limit analysis holds are near enough; or this near to
what convexity holds, where ... In others, the tolerance of factors is."""
_GAP = 0.03
"""... convexity leaves no more room than this above it."""
_FEW, _SMALL = 12, 5
"""Up to so many directions in the level plane, or of so many bodies, are all followed from rest until they collapse."""
_COARSE = np.pi / 4 - 1e-6
"""rad between the directions that are followed from rest first, at least."""
_MENDED = 3
"""Times that all limits are looked through for those below what convexity says."""
_LEVEL = 1e-12
_SAME = 1e-8
"""Entries of directions, azimuths in rad and shares of factors that differ by less are equal."""


@dataclass(eq=False)
class ElasticLimits:
    """Limits of one block in some directions, m/s2.

    Args:
        block: in which contact forces have a choice.
        loads: (6 n, 3) on it, in its units, per m/s2 along x, y and z.
        directions: (D, 3) unit vectors.
        most: (D,) no more than this is asked.
        deadline: for all.
        patches: whether limits are lowered to what patches hold.
        limits: (D,) what elastic contacts and patches hold; the forces of elastic contacts are within their friction
            cones, so that limit analysis holds as much.
        known: (D,) for which that was found in time, up to collapse; otherwise more may be held.
        falls: what moves, by row.
        from_rest: directions that were followed from rest.
    """

    block: BlockAnalysis
    loads: Array
    directions: Array
    most: Array
    deadline: Deadline
    patches: bool = True
    limits: Array = field(init=False)
    known: Mask = field(init=False)
    falls: dict[int, Mechanism] = field(default_factory=dict)
    from_rest: int = 0
    _elastic: PlaneCurve = field(default_factory=PlaneCurve)
    _patches: PlaneCurve = field(default_factory=PlaneCurve)
    _states: dict[float, ElasticFactor] = field(default_factory=dict)
    _cuts: list[Array] = field(default_factory=list)
    _whole: set[int] = field(default_factory=set)
    _found: dict[int, ElasticFactor] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.limits = np.zeros(len(self.directions))
        self.known = np.ones(len(self.directions), dtype=bool)
        large = self.block.geometry.count > _LARGE
        self._nearly, self._close = (_NEARLY, _CLOSE) if large else (FACTOR_TOLERANCE, FACTOR_TOLERANCE)
        self._symmetries = tuple(one for one in self.block.solvers.symmetries if one.carries(self.loads))

    def solve(self) -> "ElasticLimits":
        """Fill in the limits."""
        same, first = _alike(self.directions, np.flatnonzero(self.most > 0))
        images, first = _images(self.directions, first, self._symmetries)
        asked = self.most
        self.most = asked.copy()
        for row, (other, _) in images.items():
            self.most[other] = max(self.most[other], asked[row])
        level = np.abs(self.directions[first, 2]) <= _LEVEL
        azimuths = np.arctan2(*self.directions[first[level], 1::-1].T) % (2 * np.pi)
        rows = first[level][np.argsort(azimuths)]
        around = len(rows) * (len(self._symmetries) + 1) > _FEW and self.block.geometry.count > _SMALL
        for row in (first[~level] if around else first).tolist():
            self.from_rest += 1
            self._note(
                row, None, self.block.solvers.coulomb.factor(self._load(row), float(self.most[row]), self.deadline)
            )
        if around:
            self._solve_around(rows, np.sort(azimuths).tolist())
        for row, (other, symmetry) in images.items():
            self._carry(row, other, symmetry)
        for row, other in same.items():
            self.limits[row], self.known[row] = self.limits[other], self.known[other]
            if other in self.falls:
                self.falls[row] = self.falls[other]
        self.limits = np.minimum(self.limits, asked)
        return self

    def _carry(self, row: int, other: int, symmetry: Symmetry) -> None:
        """Take the limit of a direction from one that a symmetry carries into it, if its state is an equilibrium."""
        found, load, most = self._found[other], self._load(row), float(self.most[row])
        state = None if found.displacement is None else symmetry.of_bodies(found.displacement)
        if state is not None and self.block.solvers.coulomb.held_at(load, state) < (1 - _SAME) * found.value:
            self._note(row, None, self.block.solvers.coulomb.factor(load, most, self.deadline))
            return
        self.limits[row], self.known[row] = self.limits[other], self.known[other]
        if other in self.falls:
            self.falls[row] = self.falls[other].image(symmetry)

    def _solve_around(self, rows: Indices, azimuths: Sequence[float]) -> None:
        """The limits in many directions of the level plane, ascending by azimuth."""
        count = len(rows)
        coarse = list(_far_apart(azimuths))
        for k in coarse:
            self._note(int(rows[k]), azimuths[k], self._from_rest(int(rows[k]), np.inf))
        arcs = [(k, after) for k, after in zip(coarse, [*coarse[1:], coarse[0] + count], strict=True)]
        while arcs:
            begin, end = arcs.pop(0)
            between = [k % count for k in range(begin + 1, end)]
            if not between:
                continue
            close = all(self._is_close(int(rows[k]), azimuths[k]) for k in between)
            middle = (begin + end) // 2
            for k in between if close else [middle % count]:
                self._note(int(rows[k]), azimuths[k], self._beside(int(rows[k]), azimuths[k], close))
            arcs += [] if close else [(begin, middle), (middle, end)]
        for _ in range(_MENDED):
            if not sum(self._mend(int(rows[k]), azimuths[k]) for k in range(count)):
                break

    def _is_close(self, row: int, azimuth: float) -> bool:
        chord = self._elastic.chord(azimuth)
        return chord is not None and self._room(row, azimuth) <= (1 + _GAP) * chord.reach

    def _room(self, row: int, azimuth: float) -> float:
        """What convexity and the mechanisms found allow at most."""
        return min(self._elastic.beyond(azimuth), self._upper(row))

    def _beside(self, row: int, azimuth: float, close: bool) -> ElasticFactor:
        """What elastic contacts hold in a direction between known ones; if `close`, what convexity allows is enough."""
        chord = self._elastic.chord(azimuth)
        enough = (1 - self._close) * chord.reach if chord is not None and close else np.inf
        found = None if chord is None else self._between(row, chord, enough)
        return self._from_rest(row, enough) if found is None else found

    def _between(self, row: int, chord: Chord, enough: float) -> ElasticFactor | None:
        """Followed from an equilibrium near those of both neighbours; None: none holds as much as convexity says."""
        starts = [start for earlier in (False, True) if (start := self._mixed(chord, earlier)) is not None]
        if not starts:
            return None
        load, most = self._load(row), float(self.most[row])
        least = (1 - self._close) * min(chord.reach, most)
        enough = min(enough, (1 - self._nearly) * self._upper(row))
        return self.block.solvers.coulomb.beside(load, starts, least, most, enough, self.deadline)

    def _mixed(self, chord: Chord, earlier: bool) -> Array | None:
        """(6 n,) the displacement between those of both neighbours, or those earlier on the way to them."""
        states = [self._states[azimuth] for azimuth in chord.azimuths]
        first, second = (state.earlier if earlier else state.displacement for state in states)
        return None if first is None or second is None else chord.weights[0] * first + chord.weights[1] * second

    def _from_rest(self, row: int, enough: float) -> ElasticFactor:
        """Up to where elastic contacts, followed from rest, hold; `enough`, or nearly what limit analysis holds, is."""
        self.from_rest += 1
        load = self._load(row)
        if not (np.isfinite(enough) or self.deadline.passed):
            self._whole.add(row)
            cut = self.block.solvers.limit.inverse_factor(load).twist
            self._cuts += [cut, *(symmetry.of_bodies(cut) for symmetry in self._symmetries)]
        enough = min(enough, (1 - self._nearly) * self._upper(row))
        return self.block.solvers.coulomb.factor(load, float(self.most[row]), self.deadline, enough)

    def _mend(self, row: int, azimuth: float) -> bool:
        """Ask again where a way had ended early: below what convexity says, or beside a neighbour with room above it.

        Returns:
            Whether more was found.
        """
        chord, found = self._elastic.chord(azimuth), self._states.get(azimuth)
        if chord is None or found is None or self.deadline.passed:
            return False
        held = found.value >= (1 - self._close) * min(chord.reach, float(self.most[row]))
        if held and (row in self._whole or self._room(row, azimuth) <= (1 + _GAP) * found.value):
            return False
        better = None if held else self._between(row, chord, np.inf)
        if better is None and row not in self._whole:
            better = self._from_rest(row, np.inf)
        if better is None or better.value < found.value or (better.value == found.value and found.known):
            return False
        self._note(row, azimuth, better)
        return True

    def _note(self, row: int, azimuth: float | None, found: ElasticFactor) -> None:
        """Keep what elastic contacts hold in a direction, as far as patches hold it, too."""
        load = self._load(row)
        self.limits[row], self.known[row], self._found[row] = found.value, found.known, found
        self.falls.pop(row, None)
        if azimuth is not None and found.known:
            self._elastic.add(azimuth, found.value)
            if found.earlier is None and (chord := self._elastic.chord(azimuth)) is not None:
                found = replace(found, earlier=self._mixed(chord, True))
            self._states[azimuth] = found
            for symmetry, image in self._azimuths(azimuth):
                self._elastic.add(image, found.value)
                self._states[image] = _image(found, symmetry)
        twist = found.twist
        if twist is None and found.displacement is not None and found.value < self.most[row]:
            twist = self.block.solvers.coulomb.motion(found.displacement, load)
        if twist is not None:
            self.falls[row] = Mechanism.elastic(self.block, twist)
        if not self.patches or (azimuth is not None and self._patches_hold(azimuth, found.value)):
            return
        patch = patch_factor(self.block, load, found)
        if patch is None:
            return
        self._keep_patch(azimuth, patch)
        if patch.upper * found.value > 1:
            self.limits[row], self.falls[row] = 1 / patch.upper, Mechanism(self.block, patch.twist)
            self.known[row] = True

    def _patches_hold(self, azimuth: float, wanted: float) -> bool:
        """Whether patches hold as much as is wanted, as what they hold in other directions shows."""
        chord = self._patches.chord(azimuth)
        return chord is not None and chord.reach >= wanted

    def _keep_patch(self, azimuth: float | None, patch: InverseLoadFactor) -> None:
        if azimuth is not None and patch.upper > 0 and np.isfinite(patch.upper):
            for one in (azimuth, *(image for _, image in self._azimuths(azimuth))):
                self._patches.add(one, 1 / patch.upper)

    def _azimuths(self, azimuth: float) -> Iterator[tuple[Symmetry, float]]:
        """The other azimuths into which symmetries carry one."""
        known = [azimuth]
        for symmetry in self._symmetries:
            x, y, _ = symmetry.vectors(np.array([np.cos(azimuth), np.sin(azimuth), 0.0])).tolist()
            image = float(np.arctan2(y, x) % (2 * np.pi))
            if all(abs(np.sin((image - one) / 2)) > _SAME for one in known):
                known.append(image)
                yield symmetry, image

    def _load(self, row: int) -> Array:
        return np.asarray(self.loads @ self.directions[row])

    def _upper(self, row: int) -> float:
        """What limit analysis holds at most, as far as the mechanisms found show."""
        load = self._load(row)
        inverse = max((float(cut @ load) for cut in self._cuts), default=0.0)
        return min(float(self.most[row]), 1 / inverse if inverse > 0 else np.inf)


def inertial_loads(block: BlockAnalysis) -> Array:
    """(6 n, 3) loads on a block, in its units, per m/s2 of acceleration of the base along x, y and z."""
    objects, members = block.structure.assembly.objects, block.block.members
    places = [place for group in members for place in group]
    forces = np.array([objects[place].mass for place in places])[:, None, None] * -np.eye(3)
    com = np.array([objects[place].com_in_world for place in places])
    wrenches = np.concatenate([forces, cross(com[:, None], forces)], axis=2)
    loads = np.zeros((len(members), 3, 6))
    np.add.at(loads, np.repeat(np.arange(len(members)), [len(group) for group in members]), wrenches)
    return np.asarray(block.geometry.units.of_wrench(loads).transpose(1, 0, 2).reshape(3, -1).T)


def _image(found: ElasticFactor, symmetry: Symmetry) -> ElasticFactor:
    """What a symmetry makes of a state."""
    states = (None if state is None else symmetry.of_bodies(state) for state in (found.displacement, found.earlier))
    return ElasticFactor(found.value, found.known, None, *states)


def _images(
    directions: Array, rows: Indices, symmetries: Sequence[Symmetry]
) -> tuple[dict[int, tuple[int, Symmetry]], Indices]:
    """Rows into whose directions a symmetry carries that of another row, with both; and the rows that are left.

    Of directions that are carried into each other the one is left that reaches farthest along x, then y, then z.
    """
    given = directions[rows]
    orbits = np.round([given, *(symmetry.vectors(given) for symmetry in symmetries)], 8) + 0.0
    farthest = [max(map(tuple, orbit)) for orbit in orbits.swapaxes(0, 1).tolist()]
    left: dict[tuple[float, ...], int] = {}
    for k in np.lexsort(-orbits[0].T[::-1]).tolist():
        left.setdefault(farthest[k], k)
    images = {}
    for k, orbit in enumerate(farthest):
        for symmetry in symmetries if left[orbit] != k else ():
            if np.abs(symmetry.vectors(given[left[orbit]]) - given[k]).max() <= _SAME:
                images[int(rows[k])] = int(rows[left[orbit]]), symmetry
                break
    return images, np.array([row for row in rows.tolist() if row not in images], dtype=np.int64)


def _far_apart(azimuths: Sequence[float]) -> Iterator[int]:
    """Of ascending azimuths the first, and each that is far from the one before."""
    last = -np.inf
    for k, azimuth in enumerate(azimuths):
        if azimuth - last >= _COARSE and (k == 0 or azimuths[0] + 2 * np.pi - azimuth >= _COARSE):
            last = azimuth
            yield k


def _alike(directions: Array, rows: Indices) -> tuple[dict[int, int], Indices]:
    """Rows whose direction an earlier row has, with that row; and the rows that are left."""
    _, first, number = np.unique(np.round(directions[rows], 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    of = rows[first[number.ravel()]].tolist()
    same = {row: other for row, other in zip(rows.tolist(), of, strict=True) if row != other}
    return same, np.sort(rows[first])
