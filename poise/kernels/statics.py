"""Bodies in contact: conic programs over their motions, and Newton steps of elastic contacts."""

import ctypes
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poise.kernels.arrays import address, check, contiguous
from poise.kernels.library import library
from poise.types import Array

_INT, _DOUBLE, _POINTER = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
_BODIES = ("sides", "starts", "rows", "place")
_POINTS = 55
"""Of a path, at most: ROOM in kernels/paths.c."""

Whole = NDArray[np.int64]


class _Bodies(ctypes.Structure):
    """Layout of `struct bodies` in kernels/bodies.h."""

    _fields_ = [
        *((name, _INT) for name in ("count", "pairs", "below")),
        *((name, _POINTER) for name in _BODIES),
    ]


class _Elastic(ctypes.Structure):
    """Layout of `struct elastic` in kernels/elastic.c."""

    _fields_ = [
        ("bodies", _Bodies),
        *((name, _POINTER) for name in ("springs", "wrenches", "stiffness", "friction")),
        ("catch", _DOUBLE),
        ("slack", _DOUBLE),
    ]


class _Path(ctypes.Structure):
    """Layout of `struct path` in kernels/paths.c."""

    _fields_ = [
        *((name, _POINTER) for name in ("gravity", "push", "rest", "begin", "response")),
        *((name, _DOUBLE) for name in ("factor", "compliance", "above", "tolerance", "time")),
        *((name, _POINTER) for name in ("displacements", "factors", "compliances", "steps", "end")),
        *((name, _INT) for name in ("look", "count", "ended")),
    ]


class _Factors(ctypes.Structure):
    """Layout of `struct factors` in kernels/paths.c."""

    _fields_ = [
        *((name, _POINTER) for name in ("gravity", "rest", "pushes", "above")),
        ("tolerance", _DOUBLE),
        ("time", _DOUBLE),
        ("count", _INT),
        *((name, _POINTER) for name in ("factors", "best", "earlier", "motions", "outcomes")),
    ]


class ElasticOutcome(IntEnum):
    """How following a push ended: other searches are needed; at the factor asked for; before it; at the deadline."""

    UNDECIDED, HELD, COLLAPSED, LATE = range(4)


class CompiledFactors(NamedTuple):
    """Up to which factors pushes are held.

    Args:
        factors: (Q,) at which equilibria were found.
        best, earlier, motions: (Q, 6 n) displacement there, and at a smaller factor; motion where it collapses.
        outcomes: (Q,) each an `ElasticOutcome`. Displacements are known where it is held or collapses.
    """

    factors: Array
    best: Array
    earlier: Array
    motions: Array
    outcomes: Whole


class CompiledPath(NamedTuple):
    """Equilibria on a path, the first at rest.

    Args:
        displacements: (K, 6 n). factors, compliances, steps: (K,).
        end: (6 n,) where it was left. ended: whether it collapsed, or reached what was asked.
    """

    displacements: Array
    factors: Array
    compliances: Array
    steps: Whole
    end: Array
    ended: bool


class _ConeProgram(ctypes.Structure):
    """Layout of `struct cone_program` in kernels/cones.c."""

    _fields_ = [
        ("bodies", _Bodies),
        *((name, _POINTER) for name in ("singles", "wides", "locals")),
        ("wide", _INT),
        ("equal", _INT),
        ("entries", _POINTER),
        ("shared", _POINTER),
        ("tolerance", _DOUBLE),
    ]


class CompiledBodies:
    """The pairs of bodies of a block in an order of elimination; needs `COMPILED`.

    Args:
        count: number of bodies.
        sides, starts, rows, place: see `poise.assembly.statics.elimination.Elimination`.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """

    def __init__(self, count: int, **arrays: Whole) -> None:
        self.count = count
        self._kept = {name: np.ascontiguousarray(arrays[name], dtype=np.int64) for name in _BODIES}
        self.pairs, below = len(self._kept["place"]), len(self._kept["rows"])
        pointers = {name: address(array) for name, array in self._kept.items()}
        self.layout = _Bodies(count=count, pairs=self.pairs, below=below, **pointers)


class CompiledElastic:
    """Elastic contacts of a block; see `poise.assembly.statics.elastic_contacts`. Needs `COMPILED`.

    Displacements and loads (6 n,) are in the order of elimination.

    Args:
        bodies: of the block.
        springs: (I + 1,) first spring of each pair.
        wrenches: (P, 3, 6) of unit forces on the second body, along the same three directions, which are at right
            angles, for all springs of a pair.
        stiffness, friction: (P,).
        catch, slack: stiffness that holds every body; by how much nothing presses.

    Raises:
        InputError: TYPE_MISMATCH for arrays of other shapes.
    """

    def __init__(
        self, bodies: CompiledBodies, springs: Whole, wrenches: Array, stiffness: Array, friction: Array, **holds: float
    ) -> None:
        self._size, self._count = 6 * bodies.count, int(springs[-1])
        self._bodies = bodies
        self._kept: list[NDArray[Any]] = [
            np.ascontiguousarray(springs, dtype=np.int64),
            contiguous(wrenches, self._count, 3, 6, what="wrenches"),
            contiguous(stiffness, self._count, what="stiffness"),
            contiguous(friction, self._count, what="friction"),
        ]
        pointers = dict(zip(("springs", "wrenches", "stiffness", "friction"), map(address, self._kept), strict=True))
        self._model = _Elastic(bodies=bodies.layout, **pointers, **holds)
        # A question takes a room out and puts it back, so that threads which ask at once have one each.
        self._rooms: list[int] = []
        weakref.finalize(self, _free_rooms, self._rooms)

    @contextmanager
    def _room(self) -> Iterator[int]:
        """Room for one question, kept for the next ones: a large one takes as long to get as a Newton step."""
        room = self._rooms.pop() if self._rooms else library.poise_elastic_new(ctypes.addressof(self._model))
        if not room:
            raise MemoryError("no memory for a compiled kernel")
        try:
            yield room
        finally:
            self._rooms.append(room)

    def descend(
        self, load: Array, start: Array, bounds: Array | None, enough: float, steps: int, remaining: float | None
    ) -> Array:
        """(6 n,) the displacement after damped Newton steps, as `CoulombBlock._descend`.

        Args:
            load, start: (6 n,).
            bounds: (P,) of friction; None: Coulomb's law.
            enough: what may be left of the equations. steps: at most.
            remaining: s until the deadline; None: there is none.

        Raises:
            numpy.linalg.LinAlgError: the stiffness is singular.
        """
        u, taken = np.array(start, dtype=np.float64), _INT()
        time = -1.0 if remaining is None else remaining
        arguments = address(load), address(bounds), enough, steps, time, address(u), ctypes.addressof(taken)
        with self._room() as room:
            library.poise_elastic_descend(room, *arguments)
        return u

    def reach(
        self, load: Array, push: Array, start: Array, enough: float, steps: int, remaining: float | None
    ) -> tuple[Array, float, float, float, int]:
        """An equilibrium under load + factor push, at which the push has the power that it has at the start.

        Returns:
            (6 n,) the displacement, the factor, the size of what is left of the equations, the power of the push on the
            change by it in the last step (0 without a step), and how many steps it took.
        """
        u, taken, found = np.array(start, dtype=np.float64), _INT(), np.empty(3)
        time = -1.0 if remaining is None else remaining
        arguments = enough, steps, time, address(u), address(found), ctypes.addressof(taken)
        with self._room() as room:
            library.poise_elastic_reach(room, address(load), address(push), *arguments)
        factor, left, compliance = found.tolist()
        return u, factor, left, compliance, taken.value

    def follow(
        self,
        loads: tuple[Array, Array],
        rest: Array,
        begin: tuple[Array, float, float] | None,
        response: Array | None,
        limits: tuple[float, float, float | None],
        look: bool,
    ) -> CompiledPath:
        """The path of a growing push, as `poise.assembly.statics.load_path.follow`.

        Args:
            loads: (6 n,) gravity and the push.
            rest: (6 n,) displacement without the push.
            begin: (6 n,) displacement, factor and compliance of the equilibrium to begin at; None: at rest.
            response: (6 n,) change at the beginning under a small push; None: it is found.
            limits: no more than this factor is asked; tolerance of it; s until the deadline, None: there is none.
            look: for a state beyond the end.

        Raises:
            numpy.linalg.LinAlgError: the stiffness is singular.
        """
        at, factor, compliance = (None, 0.0, 0.0) if begin is None else begin
        points, end = np.empty((_POINTS, self._size)), np.empty(self._size)
        factors, compliances, steps = np.empty(_POINTS), np.empty(_POINTS), np.empty(_POINTS, dtype=np.int64)
        above, tolerance, remaining = limits
        given = (*loads, rest, at, response)
        numbers = factor, compliance, above, tolerance, -1.0 if remaining is None else remaining
        path = _Path(
            *map(address, given), *numbers, *map(address, (points, factors, compliances, steps, end)), look, 0, 0
        )
        with self._room() as room:
            check(library.poise_elastic_follow(room, ctypes.addressof(path)))
        kept = slice(path.count)
        return CompiledPath(points[kept], factors[kept], compliances[kept], steps[kept], end, bool(path.ended))

    def factors(
        self, gravity: Array, rest: Array, pushes: Array, above: Array, limits: tuple[float, float | None]
    ) -> CompiledFactors:
        """Many pushes, each followed from rest, as `CoulombBlock.factor`; `UNDECIDED` where that needs other searches.

        Args:
            gravity, rest: (6 n,) load, and displacement under it alone.
            pushes: (Q, 6 n).
            above: (Q,) no more than this factor is asked.
            limits: tolerance of factors; s until the deadline, None: there is none.
        """
        given = contiguous(pushes, -1, self._size, what="pushes")
        count, (tolerance, remaining) = len(given), limits
        most = contiguous(above, count, what="what is asked")
        best, earlier, motions = (np.empty((count, self._size)) for _ in range(3))
        found = CompiledFactors(np.empty(count), best, earlier, motions, np.empty(count, dtype=np.int64))
        loads = contiguous(gravity, self._size, what="gravity"), contiguous(rest, self._size, what="rest")
        numbers = tolerance, -1.0 if remaining is None else remaining, count
        asked = _Factors(*map(address, (*loads, given, most)), *numbers, *map(address, found))
        with self._room() as room:
            check(library.poise_elastic_factors(room, ctypes.addressof(asked)))
        return found

    def response(self, at: Array | None, push: Array) -> Array:
        """(6 n,) the change under a small push (6 n,) at a displacement (6 n,); None: where nothing opens or slips."""
        u = np.empty(self._size)
        with self._room() as room:
            check(library.poise_elastic_response(room, address(at), address(push), address(u)))
        return u

    def left(self, u: Array, load: Array) -> Array:
        """(6 n,) what contacts and catch leave of a load, negated."""
        out = np.empty(self._size)
        with self._room() as room:
            library.poise_elastic_left(room, address(u), address(load), address(out))
        return out


def _free_rooms(rooms: list[int]) -> None:
    for room in rooms:
        library.poise_elastic_free(room)


class ConeSolutions(NamedTuple):
    """Solutions for loads.

    Args:
        value: (Q,) the most of w y. upper: (Q,) what the multipliers prove that it is at most.
        motion: (Q, 6 n) y.
        multipliers: (Q, rows), that of the shared row last.
        outcome: (Q,) 0 where this was found. steps: (Q,) taken.
    """

    value: Array
    upper: Array
    motion: Array
    multipliers: Array
    outcome: Whole
    steps: Whole


class CompiledConeProgram:
    """max w y with the slacks of pairs of bodies in cones, for any number of loads w; needs `COMPILED`.

    Args:
        bodies: of the block.
        singles, wides, locals_: (I,) cones of one row, and of `wide` rows, and unknowns, of each pair.
        wide: rows of the larger cones, 3 or 4.
        entries: (E,) the rows of each pair, (6 + its unknowns) each.
        shared: (6 n,) one row more, in the order of elimination: shared y <= 1, or = 1 if `equal`.
        tolerance: of equations, and of the gap.
    """

    def __init__(
        self,
        bodies: CompiledBodies,
        singles: Whole,
        wides: Whole,
        locals_: Whole,
        wide: int,
        entries: Array,
        shared: Array,
        equal: bool,
        tolerance: float,
    ) -> None:
        counts = [np.ascontiguousarray(each, dtype=np.int64) for each in (singles, wides, locals_)]
        rows = counts[0] + wide * counts[1]
        size = int((rows * (6 + counts[2])).sum())
        self._rows, self._size = int(rows.sum()) + 1, 6 * bodies.count
        self._entries = contiguous(np.array(entries), size, what="entries")
        self._kept = [*counts, self._entries, contiguous(shared, self._size, what="shared")]
        self._bodies = bodies
        pointers = dict(zip(("singles", "wides", "locals", "entries", "shared"), map(address, self._kept), strict=True))
        self._model = _ConeProgram(bodies=bodies.layout, wide=wide, equal=int(equal), tolerance=tolerance, **pointers)
        self._made = library.poise_cones_new(ctypes.addressof(self._model))
        if not self._made:
            raise MemoryError("no memory for a compiled kernel")
        weakref.finalize(self, library.poise_cones_free, self._made)

    def set_entries(self, entries: Array) -> None:
        """Replace the entries of the rows; they are read at the next solve."""
        self._entries[:] = entries
        library.poise_cones_renew(self._made)

    def solve(self, loads: Array, enough: Array) -> ConeSolutions:
        """Solve for loads (Q, 6 n), in the order of elimination; bounds of at most `enough` (Q,) are close enough."""
        given = contiguous(loads, -1, self._size, what="loads")
        count = len(given)
        at_most = contiguous(enough, count, what="what is enough")
        found = ConeSolutions(
            np.empty(count),
            np.empty(count),
            np.empty((count, self._size)),
            np.empty((count, self._rows)),
            np.empty(count, dtype=np.int64),
            np.zeros(count, dtype=np.int64),
        )
        library.poise_cones_solve(self._made, count, address(given), address(at_most), *map(address, found))
        return found
