"""Which of the places where bodies may touch do touch: what carries a body first, then neighbours side by side."""

from dataclasses import dataclass

import numpy as np

from poise.assembly.settling.belief import POINTS, Belief, SeenBodies
from poise.assembly.settling.candidates import Candidates
from poise.types import Array, Indices, Mask

_CARRIES = 0.5
"""Least cosine between the normal of a face and up, for what lies on it."""
_CONSISTENT = 1.5e-4
"""m, one sigma: by how much distances that contacts already fix may miss zero."""
_MOST = 54.0
"""Largest squared Mahalanobis distance of three distances at which a body rests on another: both off by 3 sigma."""
_ASIDE = 0.04
"""m: distances between neighbours that do not touch are as likely everywhere up to this."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Numbers of candidates: contacts, and faces side by side that do not touch.

    Args:
        contacts: in the order in which they were accepted.
        beside: faces of neighbours that are apart, as far as the contacts leave a choice.
        resting: (N,) whether each body has a contact that carries it.
        chances: probability that they touch for all pairs of faces side by side, by the number of the candidate.
    """

    contacts: tuple[int, ...]
    beside: tuple[int, ...]
    resting: Mask
    chances: dict[int, float]


def choose(
    candidates: Candidates, bodies: SeenBodies, up: Array, lowest: Array, rng: np.random.Generator | None = None
) -> Choice:
    """Decide from the bottom to the top what carries each body, and then which neighbours touch.

    Each accepted contact conditions the Gaussian of all poses, so that the next is judged by what is known then: on
    the highest face under it a body rests; a lower one that contacts already hold away is rejected.
    Faces side by side touch if that is more likely than any distance up to `_ASIDE`.

    Args:
        candidates: of contacts.
        bodies: where they were seen.
        up: (3,) against gravity.
        lowest: (N,) m, height of the lowest point of each body.
        rng: draws by their probability which neighbours touch; None: the more likely.
    """
    belief = Belief(bodies, candidates.rows)
    steepness = candidates.normal @ up
    contacts: list[int] = []
    resting = bodies.slot < 0
    carriers = [
        np.flatnonzero((candidates.second == place) & (steepness > _CARRIES)) for place in range(len(bodies.slot))
    ]
    for number in np.flatnonzero(steepness < -_CARRIES).tolist():
        place = int(candidates.first[number])
        carriers[place] = np.append(carriers[place], number)
    for place in np.argsort(lowest, kind="stable").tolist():
        own = carriers[place]
        for narrow in (False, True):
            some = own[candidates.narrow[own] == narrow]
            if narrow and resting[place]:
                break
            heights = [_height(belief, candidates, bodies, number, place, up) for number in some.tolist()]
            accepted = _resting_on(belief, some[np.argsort(heights, kind="stable")[::-1]])
            resting[place] |= len(accepted) > 0
            contacts += accepted
    beside, chances, touching = _side_by_side(belief, candidates, np.abs(steepness) <= _CARRIES, rng)
    return Choice(tuple(contacts + touching), beside, resting, chances)


def _resting_on(belief: Belief, numbers: Indices) -> list[int]:
    """Those of the faces under (or over) a body, the highest first, that carry it."""
    accepted = []
    for number in numbers.tolist():
        mean, covariance = belief.expected(number)
        if _square(mean, covariance) <= _MOST:
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


def _side_by_side(
    belief: Belief, candidates: Candidates, beside: Mask, rng: np.random.Generator | None
) -> tuple[tuple[int, ...], dict[int, float], list[int]]:
    """Faces apart, the probability of each to touch, and those that touch; the surest are decided first."""
    numbers = np.flatnonzero(beside & ~candidates.narrow).tolist()
    order = sorted(numbers, key=lambda number: -_chance(belief, number))
    apart, touching, chances = [], [], {}
    for number in order:
        chance = _chance(belief, number)
        chances[number] = chance
        if chance > (0.5 if rng is None else rng.random()):
            belief.accept(number)
            touching.append(number)
        else:
            apart.append(number)
    return tuple(apart), chances, touching


def _chance(belief: Belief, number: int) -> float:
    """Probability that two faces side by side touch, before any other evidence as likely as not."""
    mean, covariance = belief.expected(number)
    values, axes = np.linalg.eigh(covariance + _CONSISTENT**2 * np.eye(len(mean)))
    square = float(np.sum((axes.T @ mean) ** 2 / values))
    # In directions that contacts already fix, distances other than zero are not as likely as zero.
    free = values > 4 * _CONSISTENT**2
    if not free.any():
        return float(square <= _MOST)
    odds = float(np.sum(np.log(_ASIDE / np.sqrt(2 * np.pi * values[free])))) - square / 2
    return float(1 / (1 + np.exp(-np.clip(odds, -50, 50))))


def _square(mean: Array, covariance: Array) -> float:
    return float(mean @ np.linalg.solve(covariance + _CONSISTENT**2 * np.eye(len(mean)), mean))
