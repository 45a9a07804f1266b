"""Bounds on how near pushes bring a block to collapse, for all points of a region of the surface at once."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from poise.assembly.contact import SurfacePoints
from poise.assembly.robustness.block_answers import loads_at_once
from poise.assembly.robustness.convexity import upper_planes
from poise.assembly.robustness.folded_pushes import FoldedPushes
from poise.assembly.statics import BlockAnalysis, Deadline, InverseLoadFactor, Mechanism
from poise.geometry import plane_axes, wrench_of_force
from poise.types import Array, Indices, Mask

_FLAT = 12
# Points of curved surfaces solved in one round.
_ROUND = 96
# Of more mechanisms than this, those are kept that come this near to the best at some probe.
_MANY, _NEAR = 40, 0.6
# Rows of one array operation: bounds the memory, and the time between two looks at the deadline.
ROW_CHUNK = 20_000


def chunks(count: int) -> Iterator[slice]:
    """Slices of at most `ROW_CHUNK` rows that cover `count` rows."""
    return (slice(start, min(start + ROW_CHUNK, count)) for start in range(0, count, ROW_CHUNK))


@dataclass(eq=False)
class Bounds:
    """Bounds on the inverse load factor (1 / robustness) of all points, over the blocks looked at so far.

    Args:
        lower, upper: (N,).
        block: (N,) number of the block that gives the lower bound, -1 for none.
        mechanism: (N,) number of the mechanism that does, -1 for none.
        mechanisms: all found.
    """

    lower: Array
    upper: Array
    block: Indices
    mechanism: Indices
    mechanisms: list[Mechanism] = field(default_factory=list)
    solves: int = 0

    @classmethod
    def none(cls, count: int) -> "Bounds":
        return cls(np.zeros(count), np.zeros(count), np.full(count, -1), np.full(count, -1))

    def raise_to(self, rows: Indices, lower: Array, upper: Array, block: int, mechanism: Indices) -> None:
        """A block has these inverse load factors at least and at most; the weakest block counts."""
        stronger = lower > self.lower[rows]
        self.block[rows[stronger]] = block
        self.mechanism[rows[stronger]] = mechanism[stronger]
        self.lower[rows] = np.maximum(self.lower[rows], lower)
        self.upper[rows] = np.maximum(self.upper[rows], upper)

    def give_up(self, rows: Indices) -> None:
        """Record that the deadline passed before a block was asked about these points."""
        self.upper[rows] = np.inf


@dataclass(frozen=True, eq=False)
class Programs:
    """What the programs of a block say of one load.

    Args:
        limit: limit analysis.
        resting: patches with their centres of pressure as at rest; None: there are none, or they hold as much.
    """

    limit: InverseLoadFactor
    resting: InverseLoadFactor | None = None


@dataclass(eq=False)
class Pool:
    """One block under a model, and the collapse mechanisms (cuts) it has given.

    Args:
        block: asked.
        number: of it.
        bounds: of all points.
        deadline: of the map.
        with_limit, with_patch: what is asked.
        answers: of limit analysis, and of patches, by body and load.
    """

    block: BlockAnalysis
    number: int
    bounds: Bounds
    deadline: Deadline
    with_limit: bool
    with_patch: bool
    answers: dict[tuple[int, bytes], Programs] = field(default_factory=dict)
    twists: list[Array] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    _images: dict[tuple[int, int], int] = field(default_factory=dict)

    def inverse_factors(self, body: int, wrenches: Array) -> Array:
        """(k <= n,) inverse load factors of wrenches (n, 6) on a body of the block, as far as there is time."""
        values: list[float] = []
        at_once = loads_at_once(self.block)
        for start in range(0, len(wrenches), at_once):
            if self.deadline.passed:
                break
            values += self._asked(body, wrenches[start : start + at_once])
        return np.array(values)

    def _asked(self, body: int, wrenches: Array) -> list[float]:
        """(n,) inverse load factors of wrenches (n, 6) on a body of the block; their mechanisms join the pool."""
        loads, patch = self.loads(body, wrenches), self.block.solvers.patch
        if patch is not None and not self.with_limit:
            alone = patch.resting.each(loads)
            for resting in alone:
                self._keep(resting.twist)
            return [resting.upper for resting in alone]
        found = self.programs(loads)
        for wrench, one in zip(wrenches, found, strict=True):
            self.answers[body, wrench.tobytes()] = one
            self._keep(one.limit.twist)
            if one.resting is not None:
                self._keep(one.resting.twist)
        return [one.limit.upper if one.resting is None else max(one.limit.upper, one.resting.upper) for one in found]

    def programs(self, loads: Array) -> list[Programs]:
        """What limit analysis, and patches where these are asked, say of loads (q, 6 n)."""
        limits = self.block.solvers.rough_limit.each(loads)
        patch = self.block.solvers.patch if self.with_patch else None
        if patch is None:
            return [Programs(limit) for limit in limits]
        resting = patch.at_rest(loads, limits, np.array([limit.upper for limit in limits]))
        return [Programs(*both) for both in zip(limits, resting, strict=True)]

    def loads(self, body: int, wrenches: Array) -> Array:
        """(q, 6 n) wrenches (q, 6), each on one body alone."""
        loads = np.zeros((len(wrenches), 6 * self.block.geometry.count))
        loads[:, 6 * body : 6 * body + 6] = wrenches
        return loads

    def begin(self, flat: bool, region: "Region") -> None:
        """Called before a flat or curved region is bounded."""

    def take(self, region: "Region") -> None:
        """Keep the bounds of a region for the map."""
        upper = np.maximum(region.upper, region.lower)
        self.bounds.raise_to(region.rows, region.lower, upper, self.number, self._carried_back(region))

    def _carried_back(self, region: "Region") -> Indices:
        """(n,) number of the mechanism that bounds each point, where the region has those of its image."""
        mechanisms, count = self.bounds.mechanisms, int(region.folded.max()) + 2
        pair = (region.mechanism + 1) * count + region.folded + 1
        images = np.repeat(np.arange(-1, len(mechanisms)), count)  # of each pair
        for each in np.flatnonzero(np.bincount(pair)).tolist():
            number, which = each // count - 1, each % count - 1
            if min(number, which) < 0:
                continue
            if (number, which) not in self._images:
                self._images[number, which] = len(mechanisms)
                mechanisms.append(mechanisms[number].image(self.block.solvers.symmetries[which].inverse))
            images[each] = self._images[number, which]
        return np.asarray(images[pair])

    def _keep(self, twist: Array) -> None:
        self.bounds.solves += 1
        if np.any(twist):
            self.twists.append(twist)
            self.numbers.append(len(self.bounds.mechanisms))
            self.bounds.mechanisms.append(Mechanism(self.block, twist))

    def cuts(self, body: int, wrenches: Array, start: int = 0) -> tuple[Array, Indices]:
        """Largest lower bound (n,) that mechanisms from `start` on give for wrenches (n, 6), and its number."""
        if len(self.twists) <= start:
            return np.zeros(len(wrenches)), np.full(len(wrenches), -1)
        twists = np.array([twist[6 * body : 6 * body + 6] for twist in self.twists[start:]])
        numbers = np.array(self.numbers[start:])
        if len(twists) > _MANY:  # most are of other faces: a few points show which matter here
            probes = wrenches[:: max(1, len(wrenches) // 16)] @ twists.T
            matter = np.any(probes >= _NEAR * np.abs(probes.max(axis=1, keepdims=True)), axis=0)
            matter[probes.max(axis=0).argmax()] = True
            twists, numbers = twists[matter], numbers[matter]
        best, values = np.empty(len(wrenches), dtype=np.int64), np.empty(len(wrenches))
        for part in chunks(len(wrenches)):
            power = wrenches[part] @ twists.T
            best[part] = power.argmax(axis=1)
            values[part] = power[np.arange(len(power)), best[part]]
        return np.maximum(values, 0.0), np.where(values > 0, numbers[best], -1)


@dataclass(eq=False)
class Region:
    """Points on one body of a block that are bounded together, and what is known of them.

    Args:
        pool: of the block.
        body: of the block.
        rows: (n,) numbers of the points.
        wrenches: (n, 6) of unit pushes, in the block's units.
        folded: (n,) number of the symmetry of the block that carried each push here; -1: none did.
    """

    pool: Pool
    body: int
    rows: Indices
    wrenches: Array
    folded: Indices

    def __post_init__(self) -> None:
        self._seen = 0
        self.lower = np.zeros(len(self.rows))
        self.upper = np.full(len(self.rows), np.inf)
        self.mechanism = np.full(len(self.rows), -1)
        self.solved = np.zeros(len(self.rows), dtype=bool)
        self.values = np.zeros(len(self.rows))

    @classmethod
    def of(cls, pool: Pool, pushes: FoldedPushes, rows: Indices, part: Indices) -> "Region":
        """Some of the pushes (part), on one body; `rows` are the numbers of all."""
        return cls(pool, int(pushes.body[part[0]]), rows[part], pushes.wrenches[part], pushes.folded[part])

    def learn(self) -> None:
        """Raise the lower bounds by the mechanisms that joined the pool since."""
        values, numbers = self.pool.cuts(self.body, self.wrenches, self._seen)
        self._seen = len(self.pool.twists)
        better = values > self.lower
        self.lower[better], self.mechanism[better] = values[better], numbers[better]

    def open(self, tolerance: float, floor: float) -> Mask:
        """(n,) whether the bounds are still too far apart for the tolerance."""
        known = np.maximum(self.lower, self.pool.bounds.lower[self.rows])
        return (self.upper > (1 + tolerance) * known) & (self.upper > floor) & ~self.solved

    def solve(self, points: Indices) -> Array:
        """Solve points (k,) as far as there is time, and give their values; the solver's tolerance is left between."""
        values = self.pool.inverse_factors(self.body, self.wrenches[points])
        done = points[: len(values)]
        self.solved[done], self.values[done] = True, values
        self.upper[done] = np.minimum(self.upper[done], values)
        return values


def bound_flat(
    region: Region, plane: Array, corners: Array, corner_wrenches: Array, tolerance: float, floor: float
) -> bool:
    """Bound points that lie in one plane and are pushed in one direction.

    Args:
        region: the points.
        plane: (n, 2) their coordinates.
        corners: (4, 2) of a rectangle around them.
        corner_wrenches: (4, 6) of pushes there, in the block's units.
        tolerance, floor: see `Region.open`.

    Returns:
        Whether all are bounded to the tolerance before the deadline.
    """
    places, values = corners, region.pool.inverse_factors(region.body, corner_wrenches)
    if len(values) < len(corners):
        return False
    region.learn()
    while True:
        planes = None  # on the verge of moving nothing is known between points
        if np.isfinite(values).all():
            planes = upper_planes(places, values)
            for part in chunks(len(plane)):
                region.upper[part] = np.minimum(region.upper[part], _heights(planes, plane[part]).max(axis=0))
        rows = np.flatnonzero(region.open(tolerance, floor))
        if not len(rows):
            return True
        facet = rows % _ROUND
        if planes is not None:
            for part in chunks(len(rows)):
                facet[part] = _heights(planes, plane[rows[part]]).argmax(axis=0)
        wanted = _widest(region, rows, facet)
        found = region.solve(wanted)
        region.learn()
        if len(found) < len(wanted):
            return False
        places, values = np.concatenate([places, plane[wanted]]), np.append(values, found)


def _heights(planes: Array, points: Array) -> Array:
    """(F, n) of planes (F, 3) at points (n, 2)."""
    a, b, c = planes.T[:, :, None]
    heights = np.asarray(a * points[:, 0])
    heights += b * points[:, 1]
    heights += c
    return heights


def _widest(region: Region, rows: Indices, facet: Indices) -> Indices:
    """For each facet (r,) of the upper bound with points (r,) still open, the one with the widest gap."""
    gap = region.upper[rows] - np.maximum(region.lower[rows], region.pool.bounds.lower[region.rows[rows]])
    widest = np.full(int(facet.max()) + 1, -np.inf)
    np.maximum.at(widest, facet, gap)
    some = np.flatnonzero(gap == widest[facet])
    _, first = np.unique(facet[some], return_index=True)
    return rows[some[first]]


def bound_curved(region: Region, tolerance: float, floor: float) -> bool:
    """Bound points of a curved surface, each pushed in its own direction; see `bound_flat`.

    Solved points bound their neighbours from above: the inverse load factor f is sublinear. A load that is a
    combination a_k w_k + d of neighbours therefore has at most a_k f(w_k) + f(d), and d is small.
    """
    count = len(region.rows)
    wanted = np.unique(np.linspace(0, count - 1, min(count, _ROUND)).astype(int))
    axes = np.repeat(np.eye(6), 2, axis=0) * np.tile([1.0, -1.0], 6)[:, None]
    along = region.pool.inverse_factors(region.body, axes)
    if len(along) < len(axes):
        return False
    rest = along.reshape(6, 2)
    while True:
        found = region.solve(wanted)
        region.learn()
        if len(found) < len(wanted):
            return False
        _between(region, rest)
        rows = np.flatnonzero(region.open(tolerance, floor))
        if not len(rows):
            return True
        gap = region.upper[rows] / np.maximum(region.lower[rows], floor)
        order = rows[np.argsort(-gap)][: 4 * _ROUND]
        wanted = np.sort(order[:: max(1, len(order) // _ROUND)])


def _between(region: Region, rest: Array) -> None:
    """Lower the upper bounds of points by the three solved points nearest in load."""
    known = np.flatnonzero(region.solved & np.isfinite(region.values))
    if len(known) < 3 or not np.all(np.isfinite(rest)):
        return
    tree = cKDTree(region.wrenches[known])
    for part in chunks(len(region.rows)):
        if region.pool.deadline.passed:
            return
        wrenches = region.wrenches[part]
        near = known[tree.query(wrenches, k=3)[1]]
        base = region.wrenches[near]  # (n, 3, 6)
        square = base @ base.transpose(0, 2, 1) + 1e-9 * np.eye(3)
        weights = np.linalg.solve(square, base @ wrenches[:, :, None])[:, :, 0]
        weights = np.maximum(weights, 0.0)
        left = wrenches - np.einsum("ij,ijk->ik", weights, base)
        bound = np.einsum("ij,ij->i", weights, region.values[near])
        bound += np.maximum(left, 0) @ rest[:, 0] + np.maximum(-left, 0) @ rest[:, 1]
        region.upper[part] = np.minimum(region.upper[part], bound)


def bound_block(
    pool: Pool, surface: SurfacePoints, rows: Indices, wrenches: Array, tolerance: float, floor: float
) -> bool:
    """Bound all points (rows) whose pushes load a block; wrenches (N, 6) of all points, N and N m.

    Returns:
        Whether all are bounded to the tolerance before the deadline.
    """
    if not len(rows):
        return True
    if pool.deadline.passed:
        pool.bounds.give_up(rows)
        return False
    units, pushes = pool.block.geometry.units, FoldedPushes.of(pool.block, surface, rows, wrenches)
    complete, curved = True, np.zeros(len(rows), dtype=bool)
    for part in pushes.split(units.length):
        if len(part) < _FLAT:
            curved[part] = True
            continue
        region, direction = Region.of(pool, pushes, rows, part), pushes.directions[part[0]]
        pool.begin(True, region)
        plane, corners, places = _rectangle(pushes.points[part], direction)
        corner_wrenches = units.of_wrench(wrench_of_force(direction, places))
        complete &= bound_flat(region, plane, corners, corner_wrenches, tolerance, floor)
        pool.take(region)
    for number in np.unique(pushes.body[curved]):
        region = Region.of(pool, pushes, rows, np.flatnonzero(curved & (pushes.body == number)))
        pool.begin(False, region)
        complete &= bound_curved(region, tolerance, floor)
        pool.take(region)
    return complete


def _rectangle(points: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Coordinates (n, 2) of points in a plane, and the corners (4, 2), (4, 3) of a rectangle around them."""
    axes = plane_axes(direction)
    origin = points.mean(axis=0)
    plane = (points - origin) @ axes.T
    columns = np.ascontiguousarray(plane.T)  # of rows this short, the least takes ten times as long
    low, high = columns.min(axis=1), columns.max(axis=1)
    slack = 1e-6 * max(float((high - low).max()), 1e-6)
    low, high = low - slack, high + slack
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return plane, corners, origin + corners @ axes
