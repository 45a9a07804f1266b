"""Robustness when poses, masses and friction are uncertain: the answer at the most likely poses, and its interval."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly.robustness.assess import Assessment, assess
from poise.assembly.robustness.uncertainty import drawn_moments, friction_varies, with_friction_drawn
from poise.assembly.scene import Assembly, RigidObject
from poise.assembly.settling import Settled
from poise.assembly.statics import Analysis, Deadline, Push
from poise.errors import PoiseError
from poise.threads import in_one_thread
from poise.types import Array

SAMPLES = 59
"""Drawn if nothing else is asked: the least and the greatest of them hold the truth in 58 of 60 cases."""
_LEAST_MASS = 1e-6
_STATED = {
    "masses": "state mass_std for the scene, or a covariance of an object",
    "friction": "state friction_deviation for the scene, or a deviation of a friction pair",
}
_ACCURACY = 1e-3
"""By which share intervals are widened: equal scenes at other poses differ by the tolerance of the solvers."""


@dataclass(frozen=True, eq=False)
class UncertainAssessment:
    """Answers about an assembly whose poses are uncertain.

    Args:
        settled: at the most likely poses.
        lower, upper: (Q,) N, the interval of each robustness: bounds at the settled poses and over all samples.
        samples: how many were drawn, stood, and could be assessed.
        fallen: how many others did not stand. They are left out: the scene was seen at rest.
        refused: how many others could not be assessed.
        complete: all samples were drawn before the deadline.
        taken_as_exact: what samples have in common because nothing says how uncertain it is: masses, friction, or both.
    """

    settled: Assessment
    lower: Array
    upper: Array
    samples: int
    fallen: int
    refused: int
    complete: bool
    taken_as_exact: tuple[str, ...]

    @property
    def coverage(self) -> float:
        """How probably the interval holds the robustness of one more such sample: (n - 1) / (n + 1) for n samples."""
        return max(0.0, (self.samples - 1) / (self.samples + 1))

    @property
    def reservation(self) -> str:
        """That the intervals leave out errors of masses or friction; empty where they do not, or without samples."""
        if not self.samples or not (exact := self.taken_as_exact):
            return ""
        return f"intervals leave out errors of {' and '.join(exact)}: {'; '.join(_STATED[name] for name in exact)}"


@in_one_thread
def assess_settled(
    scene: Settled,
    pushes: Sequence[Push | Sequence[Push]],
    model: str | None = None,
    deadline: float | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    analysis: Analysis | None = None,
) -> UncertainAssessment:
    """Robustness at the settled poses, and at other poses, masses and friction that agree with what is known.

    The samples are drawn from the poses' uncertainty given the contacts (`Settled.samples`), the covariances of masses
    and centres of mass, and the deviations of friction, one draw for each pair of objects. The same seed gives the same
    answer, unless the deadline ends it. Points of pushes move with their objects.

    Args:
        scene: as `settle` returns it.
        pushes: with points on the objects as they were seen, give or take three sigma of these.
        model: a name in `ROBUSTNESS_MODELS`; None: default.
        deadline: s for all of it.
        samples: how many to draw.
        seed: of the samples.
        analysis: of the settled assembly, if it is prepared already.

    Raises:
        InputError, NoAnswerError: as `assess`.
    """
    clock = Deadline.after(deadline)
    analysis = analysis or Analysis.of(scene.assembly, deadline=clock)
    tolerance = analysis.structure.margin + 3 * _largest_std(scene.seen)
    at_settled = assess(analysis, carried(pushes, scene.seen, scene.assembly), model, deadline, tolerance)
    ends = [(result.lower, result.upper) for result in at_settled.results]
    if not (scene.moves or len(_exact(scene.assembly)) < len(_STATED)) or not at_settled.stable:
        samples = 0
    rng = np.random.default_rng(seed)
    draws = scene.samples(rng)
    drawn = fallen = refused = 0
    while drawn + fallen + refused < samples and not clock.passed:
        found = _assessed(scene, _weighed_all(next(draws), rng), pushes, model, clock, tolerance, rng)
        if found is None:
            refused += 1
        elif not found.stable:
            fallen += 1
        else:
            drawn += 1
            pairs = zip(ends, found.results, strict=True)
            ends = [(min(low, result.lower), max(high, result.upper)) for (low, high), result in pairs]
    complete = at_settled.complete and drawn + fallen + refused == samples
    lower, upper = np.array(ends).reshape(-1, 2).T * ([[1 - _ACCURACY], [1 + _ACCURACY]] if samples else 1)
    return UncertainAssessment(at_settled, lower, upper, drawn, fallen, refused, complete, _exact(scene.assembly))


def _largest_std(assembly: Assembly) -> float:
    """m, one sigma of the coordinate that is known least, of any object that may move."""
    variances = [
        float(np.max(np.diag(item.pose_covariance)[:3]))
        for item in assembly.objects
        if not item.fixed and item.pose_covariance is not None
    ]
    return float(np.sqrt(max(variances, default=0.0)))


def _assessed(
    scene: Settled,
    sample: Assembly,
    pushes: Sequence[Push | Sequence[Push]],
    model: str | None,
    clock: Deadline,
    tolerance: float,
    rng: np.random.Generator,
) -> Assessment | None:
    """Answers about a sample, with friction drawn; None where it overlaps, no solver answered, or time ran out."""
    try:
        analysis, moved = Analysis.of(sample, deadline=clock), carried(pushes, scene.seen, sample)
        if friction_varies(sample):
            analysis = Analysis(with_friction_drawn(analysis.structure, rng))
        found = assess(analysis, moved, model, clock.remaining, tolerance)
    except PoiseError:
        return None
    return None if found.doubtful else found


def carried(pushes: Sequence[Push | Sequence[Push]], before: Assembly, now: Assembly) -> list[Push | list[Push]]:
    """Pushes whose points have moved with the objects, from where these were to where they are now."""

    def one(push: Push) -> Push:
        place = before.index.get(push.object)
        if place is None:
            return push
        local = before.objects[place].pose.undo(np.asarray(push.point, dtype=np.float64))
        return replace(push, point=now.objects[place].pose.apply(local))

    return [one(entry) if isinstance(entry, Push) else [one(push) for push in entry] for entry in pushes]


def _exact(assembly: Assembly) -> tuple[str, ...]:
    """Of masses and friction, those whose uncertainty is not stated."""
    masses = () if any(item.covariance is not None for item in assembly.objects) else ("masses",)
    return masses if friction_varies(assembly) else (*masses, "friction")


def _weighed_all(assembly: Assembly, rng: np.random.Generator) -> Assembly:
    """The assembly with masses and centres of mass drawn."""
    return replace(assembly, objects=tuple(_weighed(item, rng) for item in assembly.objects))


def _weighed(item: RigidObject, rng: np.random.Generator) -> RigidObject:
    if item.fixed or item.covariance is None:
        return item
    mass, *moment = drawn_moments(item, rng, 1)[0]
    mass = max(float(mass), _LEAST_MASS)
    return replace(item, mass=mass, com=np.array(moment) / mass)
