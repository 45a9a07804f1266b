"""Which of the places where bodies may touch do touch: what carries a body first, then neighbours side by side."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from poise.assembly.contact import CONTACT_MARGIN
from poise.assembly.settling.belief import MIDDLE, POINTS, Belief, SeenBodies
from poise.assembly.settling.candidates import Candidates
from poise.types import Array, Indices, Mask

_CARRIES = 0.5
"""Least cosine between the normal of a face and up, for what lies on it."""
_CONSISTENT = 1.5e-4
"""m, one sigma: by how much distances that contacts already fix may miss zero."""
_MOST = 54.0
"""Largest squared Mahalanobis distance of three distances at which a body rests on another: both off by 3 sigma."""
_ASIDE, _TURNED = 0.04, 0.02
"""m: distances between neighbours that do not touch, and by how much they are longer at one end, are as likely
everywhere up to this."""
_PARALLEL = 0.5
"""Share of neighbours that are parallel, among those that do not touch: as they are mostly put on shelves."""
_SURE = 50.0
"""Logarithm of odds."""
_AHEAD = 4
"""Candidates whose probability is asked together after a contact that changed them: that costs little more than one."""
_STAYS = 0.04
"""Probability below which a contact of before is given up; one that was none becomes one above 1 minus it."""
_STAYS_OFF = 0.5
"""Share of `_MOST` above which a face that did not carry a body before does not carry it now."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Numbers of candidates: contacts, and faces side by side that do not touch.

    Args:
        contacts: in the order in which they were accepted.
        rows: those of them, and of faces in line, that do not follow from the ones before.
        beside: faces of neighbours that are apart, as far as the contacts leave a choice.
        resting: (N,) whether each body has a contact that carries it.
        chances: probability by the number of the candidate, of faces side by side to touch and of others to be in line.
    """

    contacts: tuple[int, ...]
    rows: tuple[int, ...]
    beside: tuple[int, ...]
    resting: Mask
    chances: dict[int, float]


def choose(
    candidates: Candidates,
    bodies: SeenBodies,
    up: Array,
    lowest: Array,
    rng: np.random.Generator | None = None,
    before: Indices | None = None,
) -> Choice:
    """Decide from the bottom to the top what carries each body, and then which neighbours touch.

    Each accepted contact conditions the Gaussian of all poses, so that the next is judged by what is known then: on
    the highest face under it a body rests; a lower one that contacts already hold away is rejected.
    Faces side by side touch if that is more likely than any distance up to `_ASIDE`. Faces of equally large bodies that
    touch are in line if that is more likely than any such offset. Contacts of before stay as long as they explain what
    is seen, and others are accepted only when it shows them clearly, so that noise does not switch between the two.

    Args:
        candidates: of contacts.
        bodies: where they were seen.
        up: (3,) against gravity.
        lowest: (N,) m, height of the lowest point of each body.
        rng: draws by their probability which neighbours touch; None: the more likely.
        before: (C,) 1 for candidates that touched (or were in line) before, -1 for those that did not, 0 where that is
            not known; None: for none.
    """
    level, most = _levels(len(candidates.normal), before)
    belief = Belief(bodies, candidates.rows)
    steepness = candidates.normal @ up
    carries = (np.abs(steepness) > _CARRIES) & ~candidates.in_line
    contacts: list[int] = []
    resting = bodies.slot < 0
    carriers = _carriers(candidates, carries, steepness, len(bodies.slot))
    for place in np.argsort(lowest, kind="stable").tolist():
        own = carriers[place]
        for narrow in (False, True):
            some = own[candidates.narrow[own] == narrow]
            if narrow and resting[place]:
                break
            heights = [_height(belief, candidates, bodies, number, place, up) for number in some.tolist()]
            accepted = _resting_on(belief, some[np.argsort(heights, kind="stable")[::-1]], most)
            resting[place] |= len(accepted) > 0
            contacts += accepted
    sides = np.flatnonzero(~carries & ~candidates.in_line & ~candidates.narrow)
    touching, beside, chances = _likely(belief, candidates, sides, level, rng)
    contacts += touching
    pairs = {candidates.pair(number) for number in contacts}
    numbers = [number for number in np.flatnonzero(candidates.in_line).tolist() if candidates.pair(number) in pairs]
    chances |= _likely(belief, candidates, np.array(numbers, dtype=np.int64), level, rng)[2]
    return Choice(tuple(contacts), tuple(belief.accepted), tuple(beside), resting, chances)


def _levels(count: int, before: Indices | None) -> tuple[Array, Array]:
    """(C,) probabilities from which candidates touch, and (C,) squared distances up to which they carry a body."""
    known = np.zeros(count, dtype=np.int64) if before is None else before
    return np.array([0.5, _STAYS, 1 - _STAYS])[known], _MOST * np.array([1.0, 1.0, _STAYS_OFF])[known]


def _carriers(candidates: Candidates, carries: Mask, steepness: Array, count: int) -> list[Indices]:
    """For each of N bodies the numbers of the candidates that may carry it."""
    carriers = [np.flatnonzero((candidates.second == place) & carries & (steepness > 0)) for place in range(count)]
    for number in np.flatnonzero(carries & (steepness < 0)).tolist():
        place = int(candidates.first[number])
        carriers[place] = np.append(carriers[place], number)
    return carriers


def _resting_on(belief: Belief, numbers: Indices, most: Array) -> list[int]:
    """Those of the faces under (or over) a body, the highest first, that carry it; most: (C,) squared distances."""
    accepted = []
    for number in numbers.tolist():
        mean, covariance = belief.expected(np.array([number]))
        if _square(mean[0], covariance[0]) <= most[number]:
            belief.accept(number)
            accepted.append(number)
    return accepted


def _height(belief: Belief, candidates: Candidates, bodies: SeenBodies, number: int, place: int, up: Array) -> float:
    """m, height of the face of the other body under (or over) a body, as far as contacts show it."""
    rows = candidates.of(number)
    second = rows.second[0]
    points = rows.point @ bodies.poses.rotation[second].T + bodies.poses.translation[second]
    if place == second:  # the points are those of the body itself: down to the other
        distance = belief.distance[POINTS * number : POINTS * number + POINTS]
        return float(np.mean(points @ up - distance - belief.shift(number, of_first=True)))
    return float(np.mean(points @ up - belief.shift(number, of_first=False)))


def _likely(
    belief: Belief, candidates: Candidates, numbers: Indices, level: Array, rng: np.random.Generator | None
) -> tuple[list[int], list[int], dict[int, float]]:
    """Faces that touch or are in line, those that are not, and all probabilities; the surest are decided first.

    level: (C,) probabilities above which they are, if nothing is drawn.
    """
    in_line = candidates.in_line
    numbers = numbers[np.argsort(-_chances(belief, numbers, in_line[numbers]), kind="stable")]
    accepted, rejected, chances = [], [], {}
    ahead, count = np.zeros(0), _AHEAD
    for place, number in enumerate(numbers.tolist()):
        # Many follow from those before and change nothing: then more of the next are asked together.
        if not len(ahead):
            some = numbers[place : place + count]
            ahead, count = _chances(belief, some, in_line[some]), 2 * count
        chance = chances[number] = float(ahead[0])
        ahead = ahead[1:]
        if chance > (level[number] if rng is None else rng.random()):
            accepted.append(number)
            if belief.accept(number):
                ahead, count = ahead[:0], _AHEAD
        else:
            rejected.append(number)
    return accepted, rejected, chances


def _chances(belief: Belief, numbers: Indices, in_line: Mask) -> Array:
    """(K,) probabilities that faces side by side touch, or are in line, before any other evidence as likely as not.

    If they are not, all gaps from `CONTACT_MARGIN` to `_ASIDE` are equally likely (offsets to both sides, half as far).
    All angles up to some degrees are equally likely then, but a share of neighbours, `_PARALLEL`, is as parallel as if
    they touched.

    Args:
        belief: what is known.
        numbers: (K,) of the candidates. in_line: (K,) whether the question is that.
    """
    if not len(numbers):
        return np.zeros(0)
    mean, covariance = belief.expected(numbers)
    covariance += _CONSISTENT**2 * np.eye(POINTS)
    gap, along = mean @ MIDDLE, covariance @ MIDDLE
    variance = np.maximum(along @ MIDDLE, _CONSISTENT**2 * (MIDDLE @ MIDDLE))  # rounding may go below
    values, axes = np.linalg.eigh(covariance - along[:, :, None] * along[:, None, :] / variance[:, None, None])
    turned = np.einsum("kij,ki->kj", axes, mean - along * (gap / variance)[:, None])
    turned, values = turned[:, 1:], values[:, 1:]  # the first is the gap itself, which leaves no variance
    odds = -np.sum(turned**2 / values, axis=1) / 2
    # In directions that contacts already fix, distances other than zero are not as likely as zero.
    free = values > 4 * _CONSISTENT**2
    odds += np.sum(np.log(_TURNED / np.sqrt(2 * np.pi * np.where(free, values, 1.0))) * free, axis=1)
    # Neighbours that are apart may be parallel, too, so that parallel faces are no more than a hint of contact.
    odds = np.where(in_line, odds, -np.logaddexp(np.log(_PARALLEL), np.log(1 - _PARALLEL) - odds))
    std = np.sqrt(variance)
    near = np.where(in_line, -_ASIDE / 2, CONTACT_MARGIN)
    far = np.where(in_line, _ASIDE / 2, _ASIDE)
    apart = (ndtr((far - gap) / std) - ndtr((near - gap) / std)) / _ASIDE
    uncertain = -(gap**2) / (2 * variance) - np.log(np.maximum(apart, 1e-30) * std * np.sqrt(2 * np.pi))
    odds += np.where(std > 4 * _CONSISTENT, uncertain, np.where(np.abs(gap) < CONTACT_MARGIN, _SURE, -_SURE))
    return np.asarray(1 / (1 + np.exp(-np.clip(odds, -_SURE, _SURE))))


def _square(mean: Array, covariance: Array) -> float:
    return float(mean @ np.linalg.solve(covariance + _CONSISTENT**2 * np.eye(len(mean)), mean))
