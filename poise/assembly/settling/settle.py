"""From poses as a camera sees them to the most likely poses that touch and do not overlap."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtri

from poise.assembly.contact import CONTACT_MARGIN, overlapping
from poise.assembly.scene import Assembly, RigidObject
from poise.assembly.settling.belief import POINTS, SeenBodies, most_likely
from poise.assembly.settling.candidates import edges_and_points, find_candidates
from poise.assembly.settling.contact_choice import Choice, choose
from poise.assembly.settling.refusals import moved_too_far, not_carried, still_overlapping
from poise.assembly.settling.rows import DistanceRows, steps_between
from poise.assembly.settling.separation import keep_apart
from poise.errors import InputError
from poise.geometry import Pose
from poise.threads import in_one_thread
from poise.types import Array, Indices

_THREE_SIGMA = 0.0027
"""Probability beyond three sigma."""
_APART = CONTACT_MARGIN + 2e-4
"""m between neighbours that do not touch."""
_MOST_STRAIN = 2.0
"""Largest move over what is likely."""
_YIELDS = 3e-4
"""m by which that may be less where it would move other bodies much."""
_COARSE, _FINE, _LOOSE = (1e-4, 2e-5, 2e-5), (1e-6, 1e-6), (2e-5, 2e-5)
"""m, one sigma of the distances at contacts, iteration by iteration: at first, and then where all contacts close, or
where some do not. Sizes that are off by tenths of a millimetre, fitted exactly, would tilt bodies by degrees."""
_CLOSES = 3e-5
"""m: contacts close where no distance is larger after the first iterations."""
_ROUNDS = 3
_OVERLAPPING = 2e-4
"""m; if bodies overlap more, the planes between them are chosen again, in at most so many rounds."""
_OVERLAPS = 2e-5
"""m by which bodies may overlap where it would."""
_TOUCHED = 2e-4
"""m: distances up to which bodies that were settled touch."""


@dataclass(frozen=True, eq=False)
class Move:
    """How far one object was moved.

    Args:
        id: of the object.
        translation: (3,) m, in the assembly's frame.
        rotation: (3,) rotation vector, rad, in the assembly's axes.
        sigmas: the largest of its six independent errors, in standard deviations.
    """

    id: str
    translation: Array
    rotation: Array
    sigmas: float


@dataclass(frozen=True, eq=False)
class Settled:
    """Poses that touch.

    Args:
        assembly: the objects at the most likely poses; these have no covariance any more.
        seen: the objects as they were given.
        moves: of the objects whose poses are uncertain.
        doubtful_pairs: ids of neighbours side by side, with the probability that they touch, where it is neither
            below 2 % nor above 98 %.
        accepted: sigmas that are likely for the largest of all moves: three for the scene as a whole. Where a move is
            larger, poses are as much less sure than stated (`strain`).
    """

    assembly: Assembly
    seen: Assembly
    moves: tuple[Move, ...]
    doubtful_pairs: dict[tuple[str, str], float]
    accepted: float
    _problem: "_Problem | None" = field(repr=False)

    @property
    def worst(self) -> Move | None:
        """The largest move, in sigmas."""
        return max(self.moves, key=lambda move: move.sigmas, default=None)

    @property
    def strain(self) -> float:
        """The largest move over what is accepted, and at least 1: the covariance of samples grows by its square."""
        return max(1.0, self.worst.sigmas / self.accepted) if self.worst else 1.0

    @property
    def sentences(self) -> list[str]:
        """What was moved, whether that is likely, and which neighbours may touch or not."""
        if (worst := self.worst) is None:
            return []
        length = max(float(np.linalg.norm(move.translation)) for move in self.moves)
        angle = max(float(np.linalg.norm(move.rotation)) for move in self.moves)
        found = [
            f"{len(self.moves)} poses settled: moved by up to {length * 1e3:.2f} mm and {np.degrees(angle):.2f} "
            f"degrees ({worst.sigmas:.1f} sigma, {worst.id})"
        ]
        if self.strain > 1:
            found.append(self.strained)
        if self.doubtful_pairs:
            pairs = [f"{a} and {b} ({chance:.0%})" for (a, b), chance in list(self.doubtful_pairs.items())[:3]]
            more = f" and {len(self.doubtful_pairs) - 3} more" if len(self.doubtful_pairs) > 3 else ""
            found.append(f"neighbours that may touch or not: {', '.join(pairs)}{more}")
        return found

    @property
    def strained(self) -> str:
        """That the largest move is larger than is likely; empty without moves."""
        if (worst := self.worst) is None:
            return ""
        return (
            f"{worst.id} was moved by {worst.sigmas:.1f} sigma, and up to {self.accepted:.1f} are likely here: the "
            "stated uncertainty is too small, or a pose or a size is wrong; intervals are as much wider"
        )

    def samples(self, rng: np.random.Generator) -> Iterator[Assembly]:
        """Other poses that touch, drawn from what is known, without end.

        Which neighbours touch is drawn by its probability; the poses from the Gaussian of those seen, conditioned on
        the contacts (Matheron's rule: a draw of all poses, settled onto the same contacts).
        """
        while True:
            yield self.assembly if self._problem is None else self._problem.drawn(rng, self.strain)


@in_one_thread
def settle(assembly: Assembly, before: Assembly | None = None) -> Settled:
    """Find the most likely poses that touch and do not overlap.

    Objects with a `pose_covariance` are moved; the others stay. What rests on what, and which neighbours touch, is
    decided from the bottom to the top (`contact_choice`). The poses are then the most likely ones at which these
    contacts hold and nothing overlaps (`belief.most_likely`).

    Errors are likely up to three sigma for the scene as a whole: the largest of all coordinates of all objects is
    beyond it in 0.27 % of scenes (3.5 sigma for one object, 4.3 for thirty). Up to twice that are settled, too, with
    samples that spread as much farther.

    Args:
        assembly: the objects as they were seen.
        before: the assembly as it was settled from poses seen before (a tracker's): the same contacts are kept between
            bodies that are still there, as long as they explain what is seen now.

    Raises:
        InputError: FLOATING for an object with nothing under it that errors of three sigma explain, naming what is
            nearest; FLOATING or INTERPENETRATION, naming the pair, where an object would have to move too far, or
            overlaps another at the most likely poses.
    """
    if not any(_uncertain(item) for item in assembly.objects):
        return Settled(assembly, assembly, (), {}, 0.0, None)
    problem = _Problem(assembly, before)
    poses = problem.settled(problem.choice, problem.bodies)
    moves = _moves(problem, poses)
    worst = max(moves, key=lambda move: move.sigmas)
    if worst.sigmas > _MOST_STRAIN * problem.limit:
        raise problem.refusal(worst)
    placed = problem.placed(poses)
    for *pair, depth in overlapping(placed):
        if np.any(problem.bodies.slot[pair] >= 0):
            raise still_overlapping(assembly.objects[pair[0]], assembly.objects[pair[1]], depth)
    pairs = {}
    for number, chance in problem.choice.chances.items():
        if 0.02 < chance < 0.98 and not problem.candidates.in_line[number]:
            first, second = problem.candidates.pair(number)
            pairs[assembly.objects[first].id, assembly.objects[second].id] = chance
    return Settled(placed, assembly, moves, pairs, problem.limit, problem)


class _Problem:
    """An assembly with uncertain poses, its candidates of contacts, and which of them touch."""

    def __init__(self, assembly: Assembly, before: Assembly | None) -> None:
        self.assembly, self.before = assembly, before
        items = assembly.objects
        poses = Pose(
            np.array([item.pose.rotation for item in items]), np.array([item.pose.translation for item in items])
        )
        moving = [i for i, item in enumerate(items) if _uncertain(item)]
        slot = np.full(len(items), -1)
        slot[moving] = np.arange(len(moving))
        covariance = np.array([items[i].pose_covariance for i in moving], dtype=np.float64).reshape(-1, 6, 6)
        self.bodies = SeenBodies(poses, slot, covariance)
        self.limit = float(-ndtri(_THREE_SIGMA / 2 / max(1, covariance[..., 0].size)))
        self.candidates = find_candidates(items, self.bodies, self.limit)
        self.up = -assembly.gravity / np.linalg.norm(assembly.gravity)
        self.choice = self.chosen(None)
        if self._not_held():
            self._hold_by_edges()

    def chosen(self, rng: np.random.Generator | None) -> Choice:
        """The contacts: the most likely, or drawn."""
        lowest = np.array([(item.vertices @ self.up).min() for item in self.assembly.objects])
        return choose(self.candidates, self.bodies, self.up, lowest, rng, self._known())

    def _known(self) -> Indices | None:
        """(C,) which candidates touched before, as `choose` takes it; 0 where a body is new, or has moved since."""
        if self.before is None:
            return None
        items = [
            self.before.objects[self.before.index[item.id]] if item.id in self.before.index else item
            for item in self.assembly.objects
        ]
        poses = Pose(
            np.array([item.pose.rotation for item in items]), np.array([item.pose.translation for item in items])
        )
        moved = self.bodies.sigmas(steps_between(poses, self.bodies.poses))
        there = np.array([item.id in self.before.index for item in self.assembly.objects]) & (moved <= 2 * self.limit)
        distances = np.abs(self.candidates.rows.linearised(poses)[0]).reshape(-1, POINTS)
        touched = np.where(np.all(distances < _TOUCHED, axis=1), 1, -1)
        return np.where(there[self.candidates.first] & there[self.candidates.second], touched, 0)

    def settled(self, choice: Choice, bodies: SeenBodies) -> Pose:
        """The most likely poses at which these contacts hold, of bodies seen at other poses than here, too."""
        fixed, beside = self.candidates.of(*choice.rows), self.candidates.of(*choice.beside)
        none = DistanceRows.joined([])
        poses = most_likely(bodies, self.bodies.poses, fixed, none, np.zeros(0), np.zeros(0), _COARSE)
        touching = {(min(pair), max(pair)) for pair in map(self.candidates.pair, choice.contacts)}
        closes = np.all(np.abs(fixed.linearised(poses)[0]) <= _CLOSES)
        parted = none
        for round_ in range(_ROUNDS):
            more = keep_apart(self.assembly.objects, poses, bodies.slot >= 0, _APART, touching, self.up)
            if round_ and np.all(more.linearised(poses)[0] > -_OVERLAPPING):
                break
            parted = DistanceRows.joined([parted, more])
            bounds, slack = (
                np.repeat(values, [len(beside), len(parted)]) for values in ([_APART, 0.0], [_YIELDS, _OVERLAPS])
            )
            poses = most_likely(
                bodies, poses, fixed, DistanceRows.joined([beside, parted]), bounds, slack, _FINE if closes else _LOOSE
            )
        return poses

    def drawn(self, rng: np.random.Generator, strain: float) -> Assembly:
        """The assembly at poses drawn from what is known."""
        choice = self.chosen(rng) if self.choice.chances else self.choice
        steps = strain * np.einsum("mij,mj->mi", self.bodies.roots, rng.normal(size=(self.bodies.count, 6)))
        bodies = replace(self.bodies, poses=self.bodies.stepped(self.bodies.poses, steps.ravel()))
        return self.placed(self.settled(choice, bodies))

    def placed(self, poses: Pose) -> Assembly:
        """The assembly at other poses, which are no longer uncertain."""
        objects = [
            replace(item, pose=Pose(poses.rotation[i], poses.translation[i]), pose_covariance=None)
            if self.bodies.slot[i] >= 0
            else item
            for i, item in enumerate(self.assembly.objects)
        ]
        return replace(self.assembly, objects=tuple(objects))

    def _not_held(self) -> list[int]:
        """Places of bodies that may move and that no contacts lead from to one that may not."""
        held = self.bodies.slot < 0
        ends = np.array([self.candidates.pair(number) for number in self.choice.contacts])
        for _ in ends:
            reached = held[ends].any(axis=1)
            if held[ends[reached]].all():
                break
            held[ends[reached]] = True
        return np.flatnonzero(~held).tolist()

    def _hold_by_edges(self) -> None:
        """Let bodies without a flat face on another one stand on edges, corners and round sides.

        Raises:
            InputError: FLOATING.
        """
        items = self.assembly.objects
        loose = self._not_held()
        for place in loose:
            more = edges_and_points(items, self.bodies, place, self.limit)
            if more is None:
                raise not_carried(items, place, loose, self.limit)
            self.candidates = self.candidates.and_also(more)
        self.choice = self.chosen(None)
        if loose := self._not_held():
            raise not_carried(items, loose[0], loose, self.limit)

    def refusal(self, move: Move) -> InputError:
        """The error for an object that would have to move too far."""
        contacts = self.candidates.of(*self.choice.contacts)
        parted = keep_apart(self.assembly.objects, self.bodies.poses, self.bodies.slot >= 0, _APART, set(), self.up)
        rows = DistanceRows.joined([contacts, parted])
        lacking = -rows.linearised(self.bodies.poses)[0]
        lacking[len(contacts) :] = np.maximum(lacking[len(contacts) :], 0.0)
        accepted = _MOST_STRAIN * self.limit
        return moved_too_far(self.assembly.objects, self.bodies, rows, lacking, (move.id, move.sigmas), accepted)


def _uncertain(item: RigidObject) -> bool:
    return not item.fixed and item.pose_covariance is not None and bool(np.any(item.pose_covariance))


def _moves(problem: _Problem, poses: Pose) -> tuple[Move, ...]:
    steps = steps_between(problem.bodies.poses, poses)
    sigmas = problem.bodies.sigmas(steps)
    return tuple(
        Move(problem.assembly.objects[place].id, steps[place, :3], steps[place, 3:], float(sigmas[place]))
        for place in np.flatnonzero(problem.bodies.slot >= 0).tolist()
    )
