"""Where to put an object so that it stays: contact places first, pose second (thesis Algorithm 5), any time."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.assembly.statics import Deadline
from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.geometry import Pose, unit
from poise.notebooks import html_table
from poise.placement.balance import SupportCheck
from poise.placement.chocks import Chocks
from poise.placement.choice import best_confirmed
from poise.placement.features import ContactFeatures
from poise.placement.level_room import LevelRoom
from poise.placement.matching import SupportPoint, over_three, poses_on_one, poses_on_two, same_plane
from poise.placement.orientation import Upright
from poise.placement.refinement import refine
from poise.placement.refusals import NO_FIT, NO_ROOM, no_placement
from poise.placement.scoring import PlacementScore, check_criterion, estimate_score, evaluate
from poise.placement.supports import Supports, carriers, find_supports
from poise.placement.uncertainty import Uncertainty
from poise.placement.validation import ROLLS, UNDECIDED, KeptFree, PlacementTest, PoseTest, Validator, require_new
from poise.threads import in_one_thread

SUPPORT_KINDS = ("any", "objects", "fixed")
SUPPORT_PLACES = 400
_AS_DRAWN = 30
"""Poses that are tested as they are drawn: settling takes thirty tests, and is seldom needed where there is room."""
_UNAIDED = 10
"""Poses drawn from support points alone; later every other draw looks for room on level surfaces."""
_ROLLED, _LEAST_TRUST, _ALIKE = 0.5, 0.002, 0.05
"""What is left of the weight of a face on which the object may roll, and of faces whose area differs by less."""
_TRIES, _TESTED = 24, 3
"""Pairs of features tried on each pair of places, and poses of each draw that get the full test."""


@dataclass(frozen=True)
class PackingOptions:
    """How a container is packed (planner `packing`).

    Args:
        into: id of the fixed body that carries the load; None: the largest room that fixed bodies enclose.
        height: m, of a lid over the container's floor; None: no lid.
        gap: m, between objects side by side and to walls. Above 1.5 mm, what is side by side does not touch.
    """

    into: str | None = None
    height: float | None = None
    gap: float = 2e-3

    def __post_init__(self) -> None:
        if self.height is not None and not (np.isfinite(self.height) and self.height > 0):
            raise InputError(ErrorCode.BAD_INPUT, f"height {self.height} m: give a positive height over the floor")
        if not (np.isfinite(self.gap) and self.gap >= 0):
            raise InputError(ErrorCode.BAD_INPUT, f"gap {self.gap} m: give 0 or more")


@dataclass(frozen=True)
class Options:
    """What is wanted.

    Args:
        attempts: poses tested at most.
        deadline: s for the whole plan; None: only `attempts` ends it.
        candidates: placements to find before the best is taken; the deadline may end it with fewer.
        criterion: least, median (robustness), volume or compactness.
        on: what may carry the object: any, objects (not the fixed supports), fixed.
        guide: limit, approx, thesis or uniform, see `find_supports`.
        uncertainty: what the placement has to survive.
        tests: further conditions by name.
        looks: further conditions by name on the object at its pose alone (`KeptFree`); the cheap ones.
        refining: move a placement that was found as long as its score grows.
        packing: for the planner `packing`.
    """

    attempts: int = 500
    deadline: float | None = None
    candidates: int = 3
    criterion: str = "least"
    on: str = "any"
    guide: str = "limit"
    uncertainty: Uncertainty | None = None
    tests: Sequence[tuple[str, PlacementTest]] = ()
    refining: bool = False
    looks: Sequence[tuple[str, PoseTest]] = ()
    packing: PackingOptions = PackingOptions()

    def __post_init__(self) -> None:
        check_criterion(self.criterion)
        if self.on not in SUPPORT_KINDS:
            raise InputError(ErrorCode.BAD_INPUT, f"on {self.on!r}: choose one of {', '.join(SUPPORT_KINDS)}")
        if self.attempts < 1 or self.candidates < 1:
            raise InputError(ErrorCode.BAD_INPUT, "attempts and candidates start at 1")
        if self.deadline is not None and not (np.isfinite(self.deadline) and self.deadline > 0):
            raise InputError(ErrorCode.BAD_INPUT, f"deadline {self.deadline} s: give a positive time")

    def deadline_from(self, start: float) -> Deadline:
        """The deadline of a request that came at `start`, s on the monotonic clock."""
        return Deadline(None if self.deadline is None else start + self.deadline)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the object stays.

    Args:
        item: the object at its pose.
        analysis: of the assembly with it.
        iterations: poses that were tested.
        seconds: of planning.
        rejected: how many poses each test turned away.
    """

    item: RigidObject
    analysis: Analysis
    iterations: int
    seconds: float
    rejected: dict[str, int]

    def __repr__(self) -> str:
        pose = ", ".join(f"{value:.4f}" for value in self.pose.vector)
        return f"Placement({self.item.id} at [{pose}], {self.iterations} poses tested in {self.seconds:.2f} s)"

    def _repr_html_(self) -> str:
        """The pose, and what was rejected on the way, for notebooks."""
        pose = ", ".join(f"{value:.4f}" for value in self.pose.vector)
        rows = [("pose (x y z, quaternion)", pose), ("poses tested", self.iterations), *self.rejected.items()]
        return html_table(f"{self.item.id} is placed", ("", ""), rows)

    @cached_property
    def score(self) -> PlacementScore:
        """Of the assembly with the object, certified; computed when first used.

        Raises:
            NoAnswerError: SOLVER_FAILED.
        """
        return evaluate(self.analysis)

    @property
    def pose(self) -> Pose:
        """Of the object frame, in the assembly's frame."""
        return self.item.pose


@dataclass(frozen=True, eq=False)
class PlacementProgress:
    """Reported after every pose: how many were tested, and the best placement so far."""

    iteration: int
    best: RigidObject | None
    score: PlacementScore | None


class CancelledError(PoiseError):
    """The caller gave up; nothing was changed."""


@in_one_thread
def plan_placement(
    assembly: Assembly | Analysis,
    item: RigidObject,
    options: Options = Options(),
    seed: int = 0,
    progress: Callable[[PlacementProgress], bool] | None = None,
) -> Placement:
    """Find a pose of an object that keeps the assembly, with it, standing.

    Args:
        assembly: what is there; it has to stand.
        item: the object to place; its pose is ignored, its id must be new.
        options: what is wanted.
        seed: same seed, same answer (unless a deadline cuts it short).
        progress: called after every pose; returning False cancels.

    Raises:
        InputError: BAD_INPUT, OBJECT_INVALID, INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE when the assembly does not stand as it is; NO_PLACEMENT with how many poses each test
            turned away (data `rejected`), DEADLINE when the time was over before the first pose.
        CancelledError: CANCELLED.
    """
    start = time.monotonic()
    require_new(_objects(assembly), item)
    analysis = Analysis.of(assembly, deadline=options.deadline_from(start))
    analysis.require_stable(options.deadline_from(start))
    rng = np.random.default_rng(seed)
    features = ContactFeatures.of(item.shape, item.com)
    size = float(np.linalg.norm(np.ptp(item.shape.polyhedron.vertices, axis=0)))
    supports = find_supports(analysis, options.on, options.guide, SUPPORT_PLACES, size, rng)
    supports = supports.outside([(look.low, look.high) for _, look in options.looks if isinstance(look, KeptFree)])
    validator = Validator(analysis, item, options.tests, options.looks, options.uncertainty)
    search = _Search(supports, features, validator, options, size, start, progress)
    found = search.run(rng)
    if not found:
        looks = [name for name, _ in options.looks]
        raise no_placement(item, validator.rejected, search.iteration, search.late, looks)
    best, there = search.best_of(found)
    if options.refining:
        refined = refine(validator, best, there, options.criterion, lambda: search.late)
        if refined[1] is not there:
            best, there = search.best_of([(best, there, None), (*refined, None)])
    return Placement(there, best, search.iteration, time.monotonic() - start, dict(validator.rejected))


_Candidate = tuple[Analysis, RigidObject, PlacementScore | None]
"""A placement, and the estimate of its score when more than one is wanted."""


class _Search:
    """The loop of Algorithm 5, and what it knows so far."""

    def __init__(
        self,
        supports: Supports,
        features: ContactFeatures,
        validator: Validator,
        options: Options,
        size: float,
        start: float,
        progress: Callable[[PlacementProgress], bool] | None,
    ) -> None:
        self._supports, self._features, self._validator = supports, features, validator
        self._options, self._size, self._start, self._progress = options, size, start, progress
        self.iteration = 0
        assembly, shape = validator.analysis.assembly, validator.item.shape.polyhedron
        self._up = -unit(assembly.gravity)
        friction = assembly.largest_friction
        self._fit = SupportCheck(shape.vertices, features.com, shape.convex, friction, -self._up)

        wanted = [look for _, look in options.looks if isinstance(look, Upright)]
        name = validator.item.id
        self._wanted_faces = [f for f in features.faces if all(look.allows(name, -f.normal) for look in wanted)]
        self._steady_faces = [face for face in self._wanted_faces if face.steady]
        self._aided, self._trust = False, np.ones(len(self._steady_faces))

    @cached_property
    def _chocks(self) -> Chocks:
        """What keeps a lying cylinder from rolling."""
        assembly = self._validator.analysis.assembly
        chosen = carriers(assembly.objects, self._options.on)
        return Chocks(assembly, chosen, self._validator.item, self._features.com)

    @cached_property
    def _room(self) -> LevelRoom:
        """Room on level surfaces; found when draws of support points have failed."""
        assembly = self._validator.analysis.assembly
        kept = [look for _, look in self._options.looks if isinstance(look, KeptFree)]
        chosen = carriers(assembly.objects, self._options.on)
        return LevelRoom(assembly, chosen, self._validator.item, self._features.com, self._steady_faces, kept)

    @property
    def late(self) -> bool:
        limit = self._options.deadline
        return limit is not None and time.monotonic() - self._start >= limit

    def run(self, rng: np.random.Generator) -> list[_Candidate]:
        """The first `candidates` placements found."""
        found: list[_Candidate] = []
        best: _Candidate | None = None
        while self.iteration < self._options.attempts and not self.late:
            for pose in self._poses(rng):
                self.iteration += 1
                accepted = None if pose is None else self._accept(pose)
                if pose is None:
                    self._validator.rejected[NO_ROOM if self._aided else NO_FIT] += 1
                elif accepted is None:
                    self._supports.distrust(pose.apply(self._features.com) - self._size / 2 * self._up, self._size / 4)
                elif (candidate := self._judged((*accepted, None), self._options.candidates > 1)) is not None:
                    found.append(candidate)
                    best = self._better(best, candidate)
                self._report(best)
                if len(found) >= self._options.candidates or self.iteration >= self._options.attempts or self.late:
                    break
            if len(found) >= self._options.candidates:
                break
        return found

    def _accept(self, pose: Pose) -> tuple[Analysis, RigidObject] | None:
        """As the validator; faces on which the object may roll are tried less often afterwards."""
        before = self._validator.rejected[ROLLS]
        accepted = self._validator.accept(pose, self.iteration > _AS_DRAWN)
        if self._validator.rejected[ROLLS] > before and self._steady_faces:
            under = np.array([face.normal for face in self._steady_faces]) @ (pose.rotation.T @ self._up)
            areas = np.array([face.area for face in self._steady_faces])
            alike = np.abs(areas / areas[int(under.argmin())] - 1) < _ALIKE  # the other facets of a round side
            self._trust[alike] = np.maximum(self._trust[alike] * _ROLLED, _LEAST_TRUST)
        return accepted

    def best_of(self, found: list[_Candidate]) -> tuple[Analysis, RigidObject]:
        """The best placement whose robustness elastic contacts confirm."""
        judged = [one for one in (self._judged(one, len(found) > 1) for one in found) if one is not None] or found[:1]
        estimates = [score for _, _, score in judged if score is not None]
        if len(judged) == 1:
            return judged[0][:2]
        deadline = self._options.deadline_from(self._start)
        analyses = [analysis for analysis, *_ in judged]
        return judged[best_confirmed(analyses, estimates, self._options.criterion, deadline)][:2]

    def _judged(self, candidate: _Candidate, comparing: bool) -> _Candidate | None:
        """A candidate, with its estimate when it will be compared; None when no solver finds that."""
        analysis, item, score = candidate
        if score is not None or not comparing:
            return candidate
        try:
            return analysis, item, estimate_score(analysis, self._options.criterion == "median")
        except NoAnswerError:
            self._validator.rejected[UNDECIDED] += 1
            return None

    def _better(self, best: _Candidate | None, new: _Candidate) -> _Candidate:
        if best is None or best[2] is None or new[2] is None:
            return new
        return new if new[2].better_than(best[2], self._options.criterion) else best

    def _report(self, best: _Candidate | None) -> None:
        if self._progress is None:
            return
        item, score = (None, None) if best is None else best[1:]
        if not self._progress(PlacementProgress(self.iteration, item, score)):
            raise CancelledError(
                ErrorCode.CANCELLED, f"placing {self._validator.item.id} was cancelled; nothing was changed"
            )

    def _poses(self, rng: np.random.Generator) -> Iterator[Pose | None]:
        """Poses for one draw of places that its planes could carry; None when there is none."""
        self._aided = self.iteration >= _UNAIDED and not self._aided
        if self._aided and self._chocks and rng.random() < 0.5:
            yield next(self._chocks.poses(rng), None)
            return
        drawn = self._on_level(rng) if self._aided else self._drawn(rng)
        fitting = (pose for pose, contacts in drawn if self._fit.allows(pose, contacts))
        first = next(fitting, None)
        yield first
        if first is not None:
            yield from islice(fitting, _TESTED - 1)

    def _on_level(self, rng: np.random.Generator) -> Iterator[tuple[Pose, tuple[SupportPoint, ...]]]:
        return ((pose, (contact,)) for pose, contact in self._room.poses(rng, self._trust))

    def _drawn(self, rng: np.random.Generator) -> Iterator[tuple[Pose, tuple[SupportPoint, ...]]]:
        """Poses for one draw of places: over three of them, on two, and on one alone, each with its planes."""
        numbers = self._supports.draw(rng)
        a, *others = (self._supports.contact(number) for number in numbers)
        sharp = bool(self._supports.sharp[numbers[0]])
        faces = self._features.faces
        steady = self._steady_faces or list(self._wanted_faces) or list(faces)
        trusted = steady is self._steady_faces and self._trust.min() < 1
        shares = self._trust / self._trust.sum() if trusted else None
        face = steady[int(rng.integers(len(steady)) if shares is None else rng.choice(len(steady), p=shares))]
        top = (
            over_three(a, others[0], others[1], self._up)
            if len(others) == 2 and (sharp or rng.random() < 0.5)
            else None
        )
        if top is not None:
            yield from ((pose, (top,)) for pose in poses_on_one(top, face, self._features.com, self._yaw(rng)))
        if sharp:  # nothing stands on one ridge or peak
            return
        if top is None and others:
            pair = a, others[0]
            flat = same_plane(*pair)
            found = poses_on_two(*pair, self._features, rng, 1 if flat else _TRIES)
            yield from ((pose, pair[:1] if flat else pair) for pose in found)
        yield from ((pose, (a,)) for pose in poses_on_one(a, face, self._features.com, self._yaw(rng)))

    def _yaw(self, rng: np.random.Generator) -> np.ndarray:
        """Along the axes or at random, with equal probability: aligned objects leave more room for the next."""
        square = rng.integers(4) * np.pi / 2
        return np.array([square if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)])


def _objects(assembly: Assembly | Analysis) -> tuple[RigidObject, ...]:
    return assembly.assembly.objects if isinstance(assembly, Analysis) else assembly.objects
