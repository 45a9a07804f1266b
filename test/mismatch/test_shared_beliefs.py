"""Explanations that share the belief with a name: unknown effects, and similar effects of the same answer."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest
from cases import make_case

from poise.mismatch.answer.belief import EffectBelief, beliefs, rival_odds
from poise.mismatch.answer.named import equals
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import EffectCandidate, EffectProof, FittedEffect, HypothesisFit, ProvenModel, Variation
from poise.mismatch.inference.effort_curves import EffortCurve


def beliefs_of(
    names: tuple[str, ...],
    excess: float,
    equals: tuple[str, ...] = (),
    instead: dict[str, EffectCandidate] | None = None,
    suspects: frozenset[str] = frozenset(),
) -> tuple[EffectBelief, ...]:
    """Of an answer with ample evidence and no rivals but those that may stand instead of each part."""
    parts = tuple(FittedEffect(effect, {}) for effect in map(effect_named, names) if effect is not None)
    proof = EffectProof(6, 6, 1.2, 1.0, 4500.0, 0.3, 0.0, 40.0, 4700.0, excess, 0.0)
    fit = cast(HypothesisFit, SimpleNamespace(parts=parts))
    model = ProvenModel(fit, (proof,) * len(parts), (), {})
    steady = [Variation("time", 0.0)] * len(parts)
    return beliefs(model, [instead or {} for _ in parts], steady, 0.04, [equals] * len(parts), suspects)


@pytest.mark.parametrize("rival", ["unknown:time", "cable"])
def test_a_rival_that_is_as_likely_by_rule_shares_with_a_name(rival: str) -> None:
    (alone,), (found,) = beliefs_of(("contact",), 20.0), beliefs_of(("contact",), 20.0, (rival,))
    assert alone.probability > 0.9
    assert found.probability < 0.5
    assert found.rivals[:1] == ((rival, found.probability),)


@pytest.mark.parametrize(("name", "shares"), [("contact", True), ("sensor_bias", False)])
def test_an_event_that_follows_anything_is_as_likely_as_the_unknown_effect_beside_it(name: str, shares: bool) -> None:
    effect, recorded = effect_named(name), make_case(3, duration=5.0).recorded()
    assert effect is not None
    values = {p.name: p.from_unit(0.5) if not p.linear else 0.0 for p in effect.parameters(recorded)}
    assert (equals(FittedEffect(effect, values), recorded, "time") == {"unknown:time"}) == shares


@pytest.mark.parametrize(("excess", "shares"), [(-0.03, True), (12.0, False)])
def test_similar_names_share_where_the_residual_without_one_is_within_the_noise(excess: float, shares: bool) -> None:
    filtered, late = beliefs_of(("low_pass", "clock_offset"), excess)
    assert (max(filtered.probability, late.probability) < 0.5) == shares
    assert (filtered.alike == ("clock_offset",)) == shares


@pytest.mark.parametrize(("name", "shares"), [("effort_offset", True), ("viscous_friction", False)])
def test_a_name_on_the_efforts_shares_with_what_the_wrench_supports_without_proof(name: str, shares: bool) -> None:
    """A joint offset and a tilted base that cancel in the wrench load the joints as constant errors do."""
    (found,) = beliefs_of((name,), 20.0, suspects=frozenset({"joint_offset", "base_tilt"}))
    assert (found.probability < 0.5) == shares
    assert ("joint_offset" in found.alike) == shares


def test_a_rival_that_explains_hardly_anything_is_none_however_much_the_answer_leaves() -> None:
    assert rival_odds(1587.0, 6.9, 1.0) < 1e-6


@pytest.mark.parametrize(("more", "shares"), [(0.001, False), (0.1, True)])
def test_a_free_curve_is_a_rival_where_its_shape_is_not_that_of_the_law(more: float, shares: bool) -> None:
    """With splines in place of a line the evidence is equal, because they cost more, but they explain more."""
    law = effect_named("viscous_friction")
    assert law is not None
    line = EffectCandidate(law, {}, 4700.0, 9420.0, 4700.0)
    splines = replace(line, drop=9420.0 / (1.0 - more))
    ((alone,), (found,)) = (
        beliefs_of((law.name,), 20.0, instead=instead)
        for instead in ({law.name: line}, {law.name: line, "unknown:joint_velocity": splines})
    )
    assert (found.probability < 0.92 * alone.probability) == shares


@pytest.mark.parametrize(("more", "shares"), [(1.2, False), (6.0, True)])
def test_a_name_in_whose_place_a_free_curve_wins_far_more_evidence_is_no_likelier_than_it(
    more: float, shares: bool
) -> None:
    law = effect_named("cable")
    assert law is not None
    own = EffectCandidate(law, {}, 140.0, 300.0, 140.0)
    curve = replace(own, gain=more * own.gain, drop=more * own.drop)
    (found,) = beliefs_of((law.name,), 20.0, instead={law.name: own, "unknown:joint_velocity": curve})
    assert (found.probability < 0.5) == shares
    assert (found.rivals[:1] == (("unknown:joint_velocity", found.probability),)) == shares


@pytest.mark.parametrize(
    ("name", "rival", "shares"),
    [("low_pass", "clock_offset", True), ("low_pass", "slosh", False), ("gain_drift", "mass_leak", True)],
)
def test_of_a_delay_and_a_filter_with_equal_evidence_none_is_preferred_and_a_rare_cause_not_either(
    name: str, rival: str, shares: bool
) -> None:
    one, other = effect_named(name), effect_named(rival)
    assert one is not None
    assert other is not None
    instead = {name: EffectCandidate(one, {}, 40.0, 90.0, 40.0), rival: EffectCandidate(other, {}, 39.8, 90.0, 39.8)}
    (found,) = beliefs_of((name,), 20.0, instead=instead)
    assert (found.probability < 0.55) == shares
    assert found.rivals[0][0] == rival


@pytest.mark.parametrize(
    ("name", "state", "gain", "shares"),
    [
        ("contact", "joint_position", 2630.0, True),
        ("contact", "time", 2630.0, False),
        ("contact", "joint_position", 1600.0, False),
        ("air_drag", "joint_position", 2630.0, False),
    ],
)
def test_a_curve_over_a_state_that_explains_as_much_as_an_event_of_free_course_is_as_likely(
    name: str, state: str, gain: float, shares: bool
) -> None:
    """A cable chain that bends with a joint acts whenever the joint returns; a hand pushes once."""
    law = effect_named(name)
    assert law is not None
    own = EffectCandidate(law, {}, 2631.0, 5478.0, 2631.0)
    curve = EffectCandidate(EffortCurve(state), {}, gain, 5478.0, gain)
    (found,) = beliefs_of((name,), 20.0, instead={name: own, curve.effect.name: curve})
    assert (found.probability < 0.5) == shares
