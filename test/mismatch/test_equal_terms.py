"""Hypotheses are compared on equal terms: under the same noise, and with priors of the size of what was measured."""

import pytest
from field_robots import Recorded, read

from poise.mismatch.effects import all_effects, effect_named
from poise.mismatch.inference import (
    FittedEffect,
    HypothesisSearch,
    Problem,
    TimeLimit,
    effort_problem,
    fit,
    improved,
    names,
    replacements,
    residual_of,
    screening,
)
from poise.mismatch.inference.added_effect import refine

VISCOUS = effect_named("viscous_friction")


@pytest.fixture(scope="module")
def problem() -> Problem:
    """An arm whose wrist needs little torque for anything but friction, with noisy efforts."""
    reading = read(Recorded(damping=4.0, effort_noise=2.0).joints())
    return effort_problem(reading.recorded, reading.model)


def start(problem: Problem) -> FittedEffect:
    assert VISCOUS is not None
    return FittedEffect(VISCOUS, {p.name: 0.0 for p in VISCOUS.parameters(problem.recorded)})


def test_an_effect_gives_way_to_a_better_one_in_its_place(problem: Problem) -> None:
    """Coulomb friction was taken first, and the joints have viscous friction."""
    known = {each.name: each for each in all_effects()}
    library = tuple(known[name] for name in ("coulomb_friction", "viscous_friction", "motor_inertia"))
    state, coulomb = HypothesisSearch(problem, library=library), library[0]
    wrong = FittedEffect(
        coulomb, {p.name: 0.0 if p.linear else p.from_unit(0.5) for p in coulomb.parameters(problem.recorded)}
    )
    found = state.fitted(problem, [wrong], 4)
    instead = replacements(state, found)
    assert instead[0]["viscous_friction"].gain > instead[0]["coulomb_friction"].gain
    better = improved(state, found, instead)
    assert better is not None
    assert names(better) == ("viscous_friction",)
    assert improved(state, better, replacements(state, better)) is None


def test_at_the_deadline_rivals_are_not_fitted_and_count_as_equal(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = {each.name: each for each in all_effects()}
    library = tuple(known[name] for name in ("coulomb_friction", "viscous_friction", "motor_inertia", "gear_ripple"))
    state = HypothesisSearch(problem, library=library)
    found = state.fitted(problem, [start(problem)], 4)
    fits: list[str] = []
    monkeypatch.setattr(screening, "refine", lambda *args: fits.append(args[3].name) or refine(*args))
    complete = replacements(state, found)[0]
    assert fits
    assert complete["coulomb_friction"].gain < complete["viscous_friction"].gain - 20.0
    fits.clear()
    state.limit = TimeLimit(0.0)
    cut = replacements(state, found)[0]
    assert not fits
    assert state.limit.cut
    assert cut["viscous_friction"].gain == pytest.approx(complete["viscous_friction"].gain, rel=0.01)
    assert cut["coulomb_friction"].gain == cut["viscous_friction"].gain
    assert "gear_ripple" not in cut


def test_a_later_limit_began_with_the_first_one_and_remembers_that_it_was_cut() -> None:
    limit = TimeLimit(0.0)
    assert limit.over()
    later = limit.extended(2.0)
    assert later.cut
    assert not TimeLimit(1e6).extended(2.0).over()


def test_the_prior_does_not_shrink_the_friction_of_a_wrist_that_needs_little_torque(problem: Problem) -> None:
    (found,) = fit(problem, [start(problem)]).parts
    assert found.values["damping_3"] == pytest.approx(4.0, rel=0.05)


def test_the_noise_under_which_a_hypothesis_was_judged_is_kept_for_its_rivals(problem: Problem) -> None:
    """A noise model that was fitted to a worse residual may give more evidence: rivals are judged under it, too."""
    state = HypothesisSearch(problem)
    first = state.fitted(problem, [start(problem)], 4)
    quieter = problem.with_noise(problem.fitted_noise(residual_of(problem, first)))
    second = state.fitted(quieter, first.parts, 2)
    assert second.log_evidence > first.log_evidence
    assert state.judged(first) is quieter
    state.fitted(problem, first.parts, 2)
    assert state.judged(first) is quieter
