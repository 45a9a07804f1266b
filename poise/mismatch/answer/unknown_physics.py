"""Physics that an answer does not name: outside the library, or not to be distinguished from other effects."""

from collections.abc import Sequence
from dataclasses import dataclass

from poise.mismatch.answer.named import NamedEffect
from poise.mismatch.answer.residual_test import ResidualTest
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import (
    Dependence,
    DependenceCurve,
    HypothesisFit,
    Problem,
    allowed_excess,
    dependence_curve,
    state_description,
)

_LEAST_NAMED = 0.45
"""Probability below which an effect is not named: all other causes together are likelier."""
_LISTED = 5
"""Times of an event that a sentence lists."""
_NEGLIGIBLE = 0.1
"""Probability of an effect and all its rivals below which they explain nothing, if the rest is noise without them."""


@dataclass(frozen=True, eq=False)
class UnknownPhysics:
    """What no name explains: physics outside the library, or one of several effects.

    Args:
        depends_on: states that it correlates with.
        shape: its curve if there is one.
        candidates: effects of which one acts, with their probabilities, the likeliest first.
    """

    depends_on: tuple[str, ...]
    sentence: str
    shape: DependenceCurve | None
    candidates: tuple[tuple[str, float], ...] = ()


def unclear(named: Sequence[NamedEffect]) -> list[NamedEffect]:
    """The effects of an answer that other causes explain too often to be named."""
    return [each for each in named if each.belief.probability < _LEAST_NAMED or _unknown_as_likely(each)]


def pieces_of_a_course(named: Sequence[NamedEffect], unnamed: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Other events that explain less than one of the unclear effects which would have to vary with time."""
    varying = [each.proof.share for each in unnamed if each.belief.varies_with == "time" and each.proof is not None]
    largest = max(varying, default=0.0)
    events = [each for each in named if each not in unnamed and not each.effect.transfers]
    return [each for each in events if each.proof is not None and each.proof.share < largest]


def undetermined(problem: Problem, unnamed: Sequence[NamedEffect]) -> list[NamedEffect]:
    """The effects without a name that show that something acts: possible ones, and those that leave more than noise."""
    within = 1.0 + allowed_excess(problem)
    return [
        each
        for each in unnamed
        if _possible(each) >= _NEGLIGIBLE or each.proof is None or each.proof.error_without**2 > within
    ]


def _candidates(each: NamedEffect) -> list[tuple[str, float]]:
    """The probability of an effect, and those of its rivals."""
    return [(each.effect.name, each.belief.probability), *each.belief.rivals]


def _possible(each: NamedEffect) -> float:
    """Probability of an effect and of its rivals together."""
    return sum(chance for _, chance in _candidates(each))


def _unknown_as_likely(each: NamedEffect) -> bool:
    """Whether a cause outside the library is as likely as a name."""
    return any(effect_named(name) is None and chance >= each.belief.probability for name, chance in each.belief.rivals)


def likelihoods(effect: NamedEffect) -> str:
    """The probability of an effect and of its likeliest rivals, and what speaks against it."""
    state = effect.belief.varies_with
    doubt = f" ({effect.effect.name} would have to vary with {state.replace('_', ' ')})" if state else ""
    return ", ".join(f"{name} {100 * chance:.0f} %" for name, chance in _candidates(effect)[:4]) + doubt


def doubts(unnamed: Sequence[NamedEffect], pieces: Sequence[NamedEffect]) -> dict[str, str]:
    """Why unclear effects, and pieces of a course, are not named, by the names of the effects."""
    unclear_ones = {each.effect.name: f"other causes are likelier: {likelihoods(each)}" for each in unnamed}
    return unclear_ones | {each.effect.name: "it may be a piece of a cause that varies with time" for each in pieces}


def unknown_physics(
    problem: Problem, best: HypothesisFit, rest: ResidualTest, unnamed: Sequence[NamedEffect] = ()
) -> UnknownPhysics | None:
    """What no name of an answer explains; None where nothing is left.

    Args:
        problem, best: the signal and the fit of the answer.
        rest: the test of its residual.
        unnamed: effects of the fit that are not named.
    """
    parts = [part for part in best.parts if isinstance(part.effect, Dependence)]
    if not parts and not rest.structured:
        said = "; ".join(likelihoods(each) for each in unnamed)
        sentence = f"Something acts that this recording does not determine; it may be {said}."
        candidates = sorted((pair for each in unnamed for pair in _candidates(each)), key=lambda pair: -pair[1])
        return UnknownPhysics((), sentence, None, tuple(candidates)) if unnamed else None
    depends = list(dict.fromkeys(part.effect.state for part in parts if isinstance(part.effect, Dependence)))
    depends += [state for state in rest.depends_on if state not in depends and not parts]
    first = parts[0] if parts else None
    if first is not None and isinstance(first.effect, Dependence):
        return UnknownPhysics(
            tuple(depends),
            first.effect.sentence(problem.recorded, first.values),
            dependence_curve(first.effect, problem.recorded, first.values),
        )
    if rest.louder:
        return UnknownPhysics(
            tuple(depends),
            "An effect outside the library remains: the sample-to-sample noise is larger while the robot moves fast "
            "than while it moves slowly, unlike the noise of a sensor.",
            None,
        )
    if rest.bursts:
        times = ", ".join(f"{time:.1f} s" for time in rest.bursts[:_LISTED])
        more = f" and {len(rest.bursts) - _LISTED} more times" if len(rest.bursts) > _LISTED else ""
        sentence = f"Something outside the library acts for a short while, at {times}{more}."
        return UnknownPhysics(tuple(depends), sentence, None)
    what = " and ".join(state_description(state) for state in depends) or "no recorded state"
    where = f" of {rest.channel}" if rest.channel else ""
    sentence = (
        f"An effect outside the library remains: the residual{where} has {100 * rest.of_channel:.0f} % more energy "
        f"than the sensor's noise may have; it correlates with {what}."
    )
    return UnknownPhysics(tuple(depends), sentence, None)
