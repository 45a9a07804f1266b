"""When the payload of a recording changed: splits of its blocks, judged by the evidence for another payload."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from poise.inertia.pipeline.block_means import (
    CAP,
    MEDIAN_OF_SIX,
    BlockFit,
    BlockMeans,
    agreeing,
    fit,
    local_errors,
    payload_terms,
)
from poise.inertia.pipeline.block_sums import Normals, NormalSums
from poise.types import Array, Indices, Mask

_CERTAIN = 14.0
"""Log of the odds of a change against none: a million to one, as in the live change watch."""

_BETTER = 3.0
"""Log of the odds by which a change of the payload has to exceed another explanation."""

_LEAST_BLOCKS, _LEAST_SPAN, _LEAST_BETWEEN = 5, 400_000_000, 1_200_000_000
"""Blocks, and ns, that a segment has at least; between two changes it would otherwise be part of a spill."""

_LEAST_CHANGE, _LEAST_SHARE, _SURELY = 0.01, 0.03, 5.0
"""kg, share of the mass, and standard deviations by which payloads differ that count as two."""

_EXPLAINED = 0.7
"""Share of the blocks of a segment that one payload has to explain."""

_CLOSE = 0.05
"""Share of the change of the wrench that may be left of a block that counts as explained: sensors are good to a percent
or two, and the error of a heavy load is far above the noise."""

_LEFT, _ROUGHER = 0.25, 2.5
"""Share of the change of the wrench that a payload may leave unexplained in the segments beside it; and what it may
leave in any case, in units of what payloads of their own leave of two seconds each."""

_TRANSITION = 1_500_000_000
"""ns beside a change in which blocks that neither payload explains belong to the grasp or the release."""

_EVENLY = 0.1
"""Share of the whole loss that a payload that leaks loses from each quarter of the time to the next."""

_MOST_CUTS, _ROUNDS = 40, 8

_STRETCH, _OVERLAP, _NEIGHBOURS = 600, 150, 8
"""Blocks that are searched together, those that two of these have in common, and segments that share a bias."""


@dataclass(frozen=True, eq=False)
class PayloadChanges:
    """What the blocks show.

    Args:
        labels: (B,) number of the segment; -1 in transitions, and where no payload explains the wrench.
        edges: (K - 1,) first block of every segment but the first.
        log_odds: of each change against none there.
        masses: (K,) kg.
        biases: for every segment the bias (6,) that its neighbours show, N and N m, and its deviations (2,).
        slope: of a payload that becomes lighter steadily, half the change of mass and first moment (4,), kg and kg m,
            and (4, 4) covariance; None: it does not.
    """

    labels: Indices
    edges: tuple[int, ...]
    log_odds: tuple[float, ...]
    masses: Array
    biases: tuple[tuple[Array, Array], ...]
    slope: tuple[Array, Array] | None = None

    @property
    def count(self) -> int:
        """Of segments."""
        return len(self.edges) + 1


@dataclass(frozen=True, eq=False)
class _Found:
    """Changes within a stretch: (K - 1,) first blocks and log odds; (B,) transitions and explained blocks; (B, 6)."""

    edges: list[int]
    odds: list[float]
    transitions: Mask
    keep: Mask
    scale: Array
    correlated: float


def find_changes(blocks: BlockMeans) -> PayloadChanges | None:
    """Changes of the payload, of which each is certain and of which each segment is explained by one payload.

    The payload is compared with other explanations of the same blocks: one payload and a bias that steps at the same
    instants or changes steadily, and a payload that leaks. A long recording is searched in stretches of a minute that
    overlap, so that a bias that drifts for hours does not matter.

    Args:
        blocks: of a whole recording.

    Returns:
        None where one payload explains the blocks, or none does.
    """
    if len(blocks) < 2 * _LEAST_BLOCKS:
        return None
    count = len(blocks)
    edges: list[int] = []
    odds: list[float] = []
    transitions, keep, scale = np.zeros(count, dtype=bool), np.ones(count, dtype=bool), np.ones((count, 6))
    correlated = 1.0
    for begin in range(0, max(count - _OVERLAP, 1), _STRETCH - _OVERLAP):
        end = count if begin + _STRETCH + _OVERLAP > count else begin + _STRETCH
        found = _found(blocks.select(slice(begin, end)))
        first = begin + _OVERLAP // 2 if begin else 0
        last = end if end == count else end - _OVERLAP // 2
        inside = [number for number, edge in enumerate(found.edges) if first <= begin + edge < last]
        edges += [begin + found.edges[number] for number in inside]
        odds += [found.odds[number] for number in inside]
        some, own = slice(first, last), slice(first - begin, last - begin)
        transitions[some], keep[some], scale[some] = found.transitions[own], found.keep[own], found.scale[own]
        correlated = max(correlated, found.correlated)
        if end == count:
            break
    if not edges:
        return _Search(blocks).leak()
    sums = Normals.of(blocks, scale).sums(keep & ~transitions)
    masses, biases = _known_of_each(sums, [0, *edges, count], correlated)
    number = np.searchsorted(np.array(edges), np.arange(count), "right")
    return PayloadChanges(np.where(transitions, -1, number), tuple(edges), tuple(odds), masses, biases)


def _found(blocks: BlockMeans) -> _Found:
    """Search one stretch."""
    search = _Search(blocks)
    search.split()
    search.merge()
    search.prune()
    if not search.is_best():
        search.edges, search.odds = [], []
    fitted = search.fit
    return _Found(search.edges, search.odds, search.transitions(), fitted.keep, fitted.scale, fitted.correlated)


def _known_of_each(
    sums: NormalSums, bounds: list[int], correlated: float
) -> tuple[Array, tuple[tuple[Array, Array], ...]]:
    """(K,) masses, kg, and the bias and its deviations that the neighbours of each of K segments show."""
    masses: list[float] = []
    biases: list[tuple[Array, Array]] = []
    for number in range(len(bounds) - 1):
        first = max(number - _NEIGHBOURS, 0)
        near = bounds[first : number + _NEIGHBOURS + 2]
        masses.append(float(sums.solved(near)[0][number - first, 0]))
        spans = [span for span in pairwise(near) if span[0] != bounds[number]]
        biases.append(sums.bias(spans, correlated))
    return np.array(masses), tuple(biases)


class _Search:
    """The state of one search: first blocks of the segments after the first one, and the fit of that.

    Args:
        blocks: of a whole recording.
    """

    def __init__(self, blocks: BlockMeans) -> None:
        self.blocks = blocks
        self.edges: list[int] = []
        self._scale, self._correlated = local_errors(blocks)
        self._normal = Normals.of(blocks, self._scale)
        self._all = np.ones(len(blocks), dtype=bool)

    # -- splitting and merging -------------------------------------------------------------------------------

    def split(self) -> None:
        """Cut segments where least squares gain most as long as that is much."""
        while len(self.edges) < _MOST_CUTS:
            counted = self._counted()
            cuts = self._best_cuts(counted)
            edges = self._moved(sorted([*self.edges, *cuts]), counted) if cuts else []
            if len(edges) <= len(self.edges):
                return
            self.edges = edges

    def merge(self) -> None:
        """Join neighbours, first those that differ least, where the blocks that are explained need no change."""
        while self.edges:
            losses = self._normal.sums(self._explained_blocks()).losses([0, *self.edges, len(self.blocks)])
            least = int(np.argmin(losses))
            if losses[least] / self._correlated > 2 * _CERTAIN:
                break
            self.edges = self._moved(_without_edge(self.edges, least))

    def _counted(self) -> Mask:
        """(B,) all blocks but those that no payload explains in so short a row that it may be a push."""
        counted = self._explained_blocks()
        edges = np.flatnonzero(np.diff(counted, prepend=True, append=True))
        for begin, end in edges.reshape(-1, 2):
            counted[begin:end] = end - begin >= _LEAST_BLOCKS
        return counted

    def _best_cuts(self, counted: Mask) -> list[int]:
        """In each segment the block before which a cut lets the squared errors fall most, where that is much."""
        sums = self._normal.sums(counted)
        spans = list(pairwise([0, *self.edges, len(self.blocks)]))
        found: list[int] = []
        for begin, end in spans:
            where = np.arange(begin + _LEAST_BLOCKS, end - _LEAST_BLOCKS + 1)
            gains = sums.gains(begin, where, end, [span for span in spans if span[0] != begin]) if len(where) else where
            if len(where) and gains.max() > 2 * _CERTAIN * self._correlated:
                found.append(int(where[gains.argmax()]))
        return found

    def _moved(self, edges: list[int], counted: Mask | None = None) -> list[int]:
        """The same edges where each separates the blocks of its two payloads best, as far as there is room.

        With the blocks that are counted (B,) errors may be of any size; without, those of pushes are limited.
        """
        for _ in range(4 if edges else 0):
            if counted is None:
                errors = np.minimum(self._errors(edges, self._explained_blocks(edges)), CAP)
            else:
                errors = self._errors(edges, counted) * counted
            moved: list[int] = []
            for number, (begin, end) in enumerate(zip([0, *edges[:-1]], [*edges[1:], len(self.blocks)], strict=True)):
                begin = max(begin, moved[-1] if moved else 0)
                left = np.concatenate([[0.0], np.cumsum(errors[number, begin:end])])
                right = np.concatenate([[0.0], np.cumsum(errors[number + 1, begin:end][::-1])])[::-1]
                cost = (left + right)[_LEAST_BLOCKS : len(left) - _LEAST_BLOCKS]
                best = begin + _LEAST_BLOCKS + int(cost.argmin()) if len(cost) else edges[number]
                here = edges[number] - begin
                stays = 0 <= here < len(left) and not (left + right)[here] > (left + right)[best - begin] + 1.0
                moved.append(edges[number] if stays else best)
            if moved == edges:
                break
            edges = moved
        return edges

    def _errors(self, edges: list[int], keep: Mask) -> Array:
        """(K, B) squared errors of every block with every payload, in units of their scale."""
        phi, bias = self._normal.sums(keep).solved([0, *edges, len(self.blocks)])
        left = self.blocks.wrench - bias - np.einsum("bip,kp->kbi", self.blocks.matrix, phi)
        return np.asarray(np.sum((left / self._scale) ** 2, axis=2))

    def _explained_blocks(self, edges: list[int] | None = None) -> Mask:
        """(B,) blocks that agree with the payload of their segment when those that do not are left out."""
        edges = self.edges if edges is None else edges
        labels, keep = self._labels(edges), self._all
        for _ in range(_ROUNDS):
            before, agree = keep, agreeing(self._errors(edges, keep)[labels, np.arange(len(labels))])
            keep = agree if agree.any() else keep
            if np.array_equal(before, keep):
                break
        return keep.copy()

    # -- judging ---------------------------------------------------------------------------------------------

    def _fitted(self, edges: list[int], leak: bool = False) -> BlockFit:
        """One payload between two edges, one bias."""
        return fit(self.blocks, payload_terms(self.blocks, self._labels(edges), leak=leak), self._scale, widen=True)

    def _labels(self, edges: list[int]) -> Indices:
        return np.searchsorted(np.array(edges, dtype=np.int64), np.arange(len(self.blocks)), "right")

    def _gain(self, number: int) -> float:
        """Log odds of a change against none there, by its two segments and their neighbours; the bias may drift."""
        bounds = [0, *self.edges, len(self.blocks)]
        begin, end = bounds[max(number - 1, 0)], bounds[min(number + 3, len(bounds) - 1)]
        some, correlated = slice(begin, end), self.fit.correlated
        blocks, scale = self.blocks.select(some), self.fit.scale[some]
        fine, coarse = (self._labels(edges)[some] for edges in (self.edges, _without_edge(self.edges, number)))
        fine, coarse = fine - fine[0], coarse - coarse[0]
        finer = fit(blocks, payload_terms(blocks, fine), scale)
        starts = [None, self.fit.keep[some] & (fine == np.bincount(fine).argmax())]
        others = [fit(blocks, payload_terms(blocks, coarse), scale, start=start) for start in starts]
        others.append(fit(blocks, payload_terms(blocks, coarse, drift=True), scale))
        return finer.log_evidence(correlated) - max(each.log_evidence(correlated) for each in others)

    def prune(self) -> None:
        """Drop changes that are not certain, that hardly change the mass, or whose segments no payload explains."""
        self.fit = self._fitted(self.edges)
        self.odds: list[float] = []
        while self.edges:
            change = np.array([self._change(number) for number in range(len(self.edges))])
            explained = np.array([self._is_explained(number) for number in range(len(self.edges))])
            weak = (change < 1.0) | ~explained
            if weak.any():
                worst = int(np.where(weak, change, np.inf).argmin())
            else:
                self.odds = [self._gain(number) for number in range(len(self.edges))]
                worst = int(np.argmin(self.odds))
                if self.odds[worst] >= _CERTAIN:
                    return
            self.edges = self._moved(_without_edge(self.edges, worst))
            self.fit = self._fitted(self.edges)

    def _change(self, number: int) -> float:
        """How much the mass changes, in units of what counts; 0 where no payload has one of the masses."""
        masses = self.fit.unknowns[: 10 * len(self.edges) + 10 : 10]
        if self._is_lifted(number) or self._is_lifted(number + 1):
            return 0.0
        contrast = np.zeros(len(self.fit.unknowns))
        contrast[[10 * number, 10 * number + 10]] = -1.0, 1.0
        deviation = np.sqrt(float(contrast @ self.fit.covariance @ contrast) * self.fit.correlated)
        least = max(_LEAST_CHANGE, _LEAST_SHARE * float(np.abs(masses[number : number + 2]).max()), _SURELY * deviation)
        return abs(float(contrast @ self.fit.unknowns)) / float(least)

    def _is_lifted(self, label: int) -> bool:
        """The mass of a segment is negative: something else carries the load there."""
        mass, variance = self.fit.unknowns[10 * label], self.fit.covariance[10 * label, 10 * label]
        return bool(mass < -max(_LEAST_CHANGE, _SURELY * float(np.sqrt(variance * self.fit.correlated))))

    def _is_explained(self, number: int) -> bool:
        """A payload each explains most blocks of the two segments beside a change, but for those of the transition."""
        labels, inside = self._labels(self.edges), ~self.transitions()
        step = (
            self.fit.unknowns[10 * number + 10 : 10 * number + 20] - self.fit.unknowns[10 * number : 10 * number + 10]
        )
        for label in (number, number + 1):
            own = (labels == label) & inside
            effect = np.sum((self.blocks.matrix @ step / self._scale) ** 2, axis=1)
            left = np.sum((self.fit.residual / self._scale) ** 2, axis=1)
            kept = own & (self.fit.keep | (left < _CLOSE**2 * effect))
            if kept.sum() < max(_LEAST_BLOCKS, _EXPLAINED * own.sum()):
                return False
            least = _LEAST_BETWEEN if 0 < label < len(self.edges) else _LEAST_SPAN
            if self.blocks.end[kept][-1] - self.blocks.start[kept][0] < least:
                return False
            if np.median(left[own]) > max(_LEFT**2 * float(np.median(effect[own])), _ROUGHER**2 * MEDIAN_OF_SIX):
                return False
        return True

    def transitions(self) -> Mask:
        """(B,) the block before and the one after each edge, and unexplained ones in a row with them."""
        found = np.zeros(len(self.blocks), dtype=bool)
        for edge in self.edges:
            middle = int(self.blocks.start[edge])
            for step, block in ((-1, edge - 1), (1, edge)):
                first = block
                while 0 <= block < len(self.blocks) and abs(int(self.blocks.start[block]) - middle) < _TRANSITION:
                    if block != first and self.fit.keep[block]:
                        break
                    found[block] = True
                    block += step
        return found

    # -- answers ---------------------------------------------------------------------------------------------

    def is_best(self) -> bool:
        """Changes of the payload explain the blocks better than a bias that steps, or a payload that leaks."""
        if not self.edges:
            return False
        scale, correlated = self.fit.scale, self.fit.correlated
        labels = self._labels(self.edges)
        one = np.zeros_like(labels)
        evidence = self.fit.log_evidence(correlated) - _BETTER
        others = (payload_terms(self.blocks, one, labels), payload_terms(self.blocks, one, leak=True))
        return all(fit(self.blocks, terms, scale).log_evidence(correlated) < evidence for terms in others)

    def leak(self) -> PayloadChanges | None:
        """A payload that becomes lighter steadily, where that is certain."""
        one = np.zeros(len(self.blocks), dtype=np.int64)
        leaking = self._fitted([], leak=True)
        scale, correlated = leaking.scale, leaking.correlated
        plain = [fit(self.blocks, payload_terms(self.blocks, one, drift=drift), scale) for drift in (False, True)]
        odds = leaking.log_evidence(correlated) - max(each.log_evidence(correlated) for each in plain)
        lost, mass = -2 * float(leaking.unknowns[16]), abs(float(leaking.unknowns[0]))
        deviation = 2 * np.sqrt(float(leaking.covariance[16, 16]) * correlated)
        if odds < _CERTAIN or lost < max(_LEAST_CHANGE, _LEAST_SHARE * mass, _SURELY * deviation):
            return None
        quarters = self._fitted([len(one) * quarter // 4 for quarter in (1, 2, 3)]).unknowns[:40:10]
        if np.diff(quarters).max() > -_EVENLY * lost:
            return None
        slope = leaking.unknowns[16:20], leaking.covariance[16:20, 16:20] * correlated
        return PayloadChanges(one, (), (odds,), leaking.unknowns[:1], ((np.zeros(6), np.full(2, np.inf)),), slope)


def _without_edge(edges: list[int], number: int) -> list[int]:
    return edges[:number] + edges[number + 1 :]
