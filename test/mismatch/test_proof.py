"""No name without proof: physical bounds, blocks that no fit sees, and the error on held-out samples."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import make_case

from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.effects import Effect, EffectParameter, Values, effect_named
from poise.mismatch.inference import (
    EffectProof,
    FittedEffect,
    HypothesisSearch,
    TimeLimit,
    fit,
    names,
    proven,
    replacements,
    search,
    wrench_problem,
)
from poise.mismatch.inference.proof import allowed_excess, elsewhere, faint, immaterial
from poise.mismatch.inference.unknown import dependences
from poise.mismatch.reading import NominalModel
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class Pull(Effect):
    """A force along the sensor's x that grows from zero, at most `most`."""

    name = "pull"
    layer = "sensor"
    equation = source = excited_by = separating_motion = "of a test"

    def __init__(self, most: float) -> None:
        self._most = most

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return (EffectParameter("force", "N", 2.0, low=0.0, high=self._most),)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        out = np.zeros((len(recorded), 6, 1))
        out[:, 0, 0] = np.sin(recorded.seconds)
        return out

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return f"{values['force']:.1f} N"


@cache
def pulled(force: float, until: float = np.inf) -> tuple[RecordedMotion, NominalModel]:
    """A recording in which something pulls until some time, and its model."""

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        return Pull(np.inf).simulate(exact, {"force": force}) * (exact.seconds < until)[:, None]

    case = make_case(5, duration=8.0, spoil=spoil)
    return case.recorded(), case.model


@pytest.mark.parametrize(("force", "most", "found"), [(3.0, 5.0, ("pull",)), (3.0, 1.0, ()), (-3.0, 5.0, ())])
def test_a_fit_outside_the_physical_bounds_is_no_answer(force: float, most: float, found: tuple[str, ...]) -> None:
    _, best = search(wrench_problem(*pulled(force)), [Pull(most)])
    assert tuple(name for name in names(best) if not name.startswith("unknown")) == found


IMPOSSIBLE = {
    "sensor_gain": {"gain_fx_fx": 0.7},
    "sensor_nonlinearity": {"cubic_fz": -0.1},
    "sensor_creep": {"fraction": -0.8},
    "joint_offset": {"offset_2": 0.6},
    "base_tilt": {"rotation_x": 0.49999},
    "sensor_rotation": {"rotation_z": -3.99999},
    "payload_parameters": {"mass": -9.0},
    "mass_step": {"moment_y": 20.0},
    "mass_step at the start": {"time": 0.4},
    "mass_leak": {"rate": 9.0},
}


def values_of(effect: Effect, recorded: RecordedMotion) -> dict[str, float]:
    """Typical values: linear ones a tenth of their size, others in the middle of their range."""
    return {
        p.name: 0.1 * p.scale if p.linear else p.from_unit(0.5 if np.isfinite(p.low + p.high) else 0.0)
        for p in effect.parameters(recorded)
    }


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_bounds_hold_for_impossible_values_alone(name: str) -> None:
    recorded, effect = pulled(3.0)[0], effect_named(name.split()[0])
    assert effect is not None
    usual = values_of(effect, recorded)
    assert effect.implausible(recorded, usual) == ""
    assert effect.implausible(recorded, usual | IMPOSSIBLE[name])


def test_an_effect_of_the_whole_recording_is_named_with_its_proof() -> None:
    found = diagnose(*pulled(3.0), library=[Pull(9.0)])
    (named,) = found.findings
    assert named.proof is not None
    assert named.proof.improved_blocks == named.proof.blocks
    assert named.proof.error_with < 1.1 < named.proof.error_without
    assert found.unproven == {}
    assert found.complete


def test_an_effect_that_acts_in_one_part_alone_is_not_named() -> None:
    problem = wrench_problem(*pulled(6.0, until=2.0))
    state, _ = search(problem, [])
    fitted = state.fitted(problem, [FittedEffect(Pull(9.0), {"force": 0.0})], 4)
    assert fitted.log_evidence > state.fits[()].log_evidence + 100.0
    model = proven(state, fitted)
    assert model.fit.parts == ()
    assert "parts of the recording" in model.dropped["pull"]


@pytest.mark.parametrize(
    ("proof", "words"),
    [
        (EffectProof(6, 6, 1.2, 1.0, 40.0, 1.0, 0.0, 9.0, 40.0, 2.0, 0.0), ""),
        (EffectProof(6, 6, 1.2, 1.2, 2.0, 1.0, 0.0, 9.0, 40.0, 2.0, 0.0), "does not fall"),
        (EffectProof(6, 4, 1.2, 1.0, 40.0, 1.0, 0.0, 9.0, 40.0, 2.0, 0.0), "in 4 of 6 parts"),
        (EffectProof(6, 6, 5.0, 4.9, 40.0, 1.0, 33.0, 9.0, 40.0, 2.0, 0.0), "33 times"),
        (EffectProof(6, 6, 1.2, 1.0, 40.0, 1.0, 0.0, 9.0, 4.0, 2.0, 0.0), "as likely without it"),
    ],
)
def test_what_a_proof_lacks_is_said(proof: EffectProof, words: str) -> None:
    assert words in proof.lacking
    assert bool(words) == bool(proof.lacking)


def test_evidence_counts_no_more_than_what_is_won_outside_the_fits() -> None:
    """As on a real UR10: the noise is a hundredth of the error that stays, and a payload imitates a part of it."""
    assert EffectProof(6, 6, 5.9, 5.5, 240.0, 0.1, 1.7, 7.0, 8900.0, 19.0, 0.0).support == 240.0
    assert EffectProof(6, 6, 1.2, 1.0, 240.0, 0.1, 0.0, 7.0, 200.0, 2.0, 0.0).support == 200.0


@pytest.mark.parametrize(("again", "least", "most"), [(0.0, 0.0, 0.0), (1.0, 0.6, 1.1)])
def test_an_event_that_is_one_of_several_is_known_by_what_is_left_elsewhere(
    again: float, least: float, most: float
) -> None:
    left = np.random.default_rng(1).normal(size=(6, 900))
    energy = np.zeros(900)
    energy[200:280] = 6 * 3.0**2
    left[:, 600:680] += 3.0 * again
    assert least <= elsewhere(left, energy, energy / energy.sum()) <= most
    assert elsewhere(left, 0.0 * energy, 0.0 * energy) == 0.0  # of an effect whose fit is zero


def test_a_gain_that_changes_as_the_sensor_warms_up_is_no_leak_of_the_payload() -> None:
    """A leak explains nine tenths of it; a free gain in time, which is outside the library, explains it all."""

    def warming(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del rng
        return np.asarray(0.25 * wrench * (1.0 - np.exp(-(exact.seconds - exact.seconds[0]) / 2.0))[:, None])

    case = make_case(5, duration=8.0, spoil=warming)
    found = diagnose(case.recorded(), case.model, library=effects_called(["mass_leak"]))
    assert found.verdict == "unknown"
    assert found.unknown is not None
    assert "time" in found.unknown.depends_on


def test_a_shape_that_follows_noise_is_not_named() -> None:
    """A spring with a mass has enough parameters to follow noise: its residual must exceed the noise without it."""
    case, mode = make_case(5, duration=8.0), effect_named("flexible_mode")
    assert mode is not None
    problem = wrench_problem(case.recorded(), case.model)
    part = FittedEffect(mode, {p.name: max(p.low, 0.1) for p in mode.parameters(problem.recorded)})
    weak, strong = (EffectProof(6, 6, 1.1, 1.0, 90.0, 0.03, 0.0, 0.6, 90.0, excess, 0.0) for excess in (0.2, 0.9))
    assert "within the noise" in immaterial(problem, part, weak)
    assert not immaterial(problem, part, strong)


def test_a_curve_that_follows_what_errors_of_the_motion_may_leave_is_no_unknown_physics() -> None:
    """The proof of a free curve and the test of the final residual have one limit."""
    case = make_case(5, duration=8.0)
    exact = case.recorded()
    curve = next(each for each in dependences(exact) if each.state.startswith("joint_acceleration"))
    part = FittedEffect(curve, {p.name: 0.0 for p in curve.parameters(exact)})
    rough = replace(exact, motion_variance=np.full((len(exact), 6), 1e-2) * [1, 1, 1, 0.0025, 0.0025, 0.0025])
    proof = EffectProof(6, 6, 1.1, 1.0, 90.0, 0.1, 0.0, 0.6, 90.0, 0.9, 0.0)
    known, unknown = (allowed_excess(wrench_problem(each, case.model)) for each in (exact, rough))
    assert known < 1.1**2 - 1.0 < unknown
    assert not immaterial(wrench_problem(exact, case.model), part, proof)
    assert "within the noise" in immaterial(wrench_problem(rough, case.model), part, proof)


class Tone(Pull):
    """A force along the sensor's x with an unknown frequency; the search for it begins far away."""

    name = "tone"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        frequency = EffectParameter("rate", "rad/s", low=0.1, high=20.0, linear=False)
        return (frequency, *super().parameters(recorded))

    def starts(self, recorded: RecordedMotion, residual: Array) -> list[Values]:
        return [{"rate": 15.0}]

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        out = np.zeros((len(recorded), 6, 1))
        out[:, 0, 0] = np.sin(nonlinear["rate"] * recorded.seconds)
        return out


def test_an_answer_is_compared_with_its_rivals_at_its_own_values() -> None:
    """Not at those that a search from its usual starting points would find again."""
    problem, tone = wrench_problem(*pulled(3.0)), Tone(9.0)
    state = HypothesisSearch(problem, library=(tone,))
    state.offer(fit(state.judging, ()))
    found = state.fitted(state.judging, [FittedEffect(tone, {"rate": 1.02, "force": 2.0})], 8)
    own = replacements(state, found)[0]["tone"]
    assert own.values["rate"] == pytest.approx(1.0, abs=0.05)
    assert own.gain > 100.0


def test_a_search_ends_at_its_deadline_and_lists_what_was_not_tried() -> None:
    shares: list[float] = []
    state, best = search(wrench_problem(*pulled(3.0)), [Pull(9.0)], TimeLimit(0.0))
    assert state.limit.cut
    assert names(best) == ()
    assert "deadline" in state.untestable["pull"]
    state, best = search(wrench_problem(*pulled(3.0)), [Pull(9.0)], TimeLimit(np.inf, shares.append, (0.5, 0.5)))
    assert not state.limit.cut
    assert "pull" in names(best)
    assert shares == sorted(shares)
    assert 0.5 <= shares[-1] <= 1.0


def test_a_diagnosis_cut_by_its_deadline_says_so() -> None:
    found = diagnose(*pulled(3.0), library=[Pull(9.0)], deadline=1e-3)
    assert not found.complete
    assert found.findings == ()


def test_an_event_that_is_over_before_the_held_out_samples_does_not_make_them_worse() -> None:
    """The calibration beside it changes by chance: this is no evidence against the event."""
    vibration = effect_named("external_vibration")
    assert vibration is not None

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        values = {"start": 2.0, "length": 3.0, "frequency": 12.0}
        sizes = {p.name: 0.0 for p in vibration.parameters(exact) if p.linear} | {"sine_x": 0.5, "cosine_y": 0.5}
        return vibration.simulate(exact, values | sizes)

    case = make_case(5, duration=14.0, spoil=spoil)
    found = diagnose(case.recorded(), case.model, None, [vibration])
    assert [each.effect.name for each in found.findings] == ["external_vibration"]


def test_an_event_without_a_free_course_needs_no_more_than_other_effects_when_it_is_alone() -> None:
    proof = EffectProof(6, 6, 1.1, 1.0, 60.0, 0.1, 0.0, 9.0, 60.0, 1.0, 0.0)
    leak, push = effect_named("mass_leak"), effect_named("contact")
    assert leak is not None
    assert push is not None
    assert not faint(FittedEffect(leak, {}), proof, 60.0)
    assert faint(FittedEffect(push, {}), proof, 60.0)
    assert faint(FittedEffect(leak, {}), proof, 500.0)


def test_an_effect_in_joint_efforts_is_not_alone_beside_an_unknown_wrench() -> None:
    """A hand on the tool, in many spans, was unknown in the wrench and an `effort_offset` (85 %, 30 nats)."""
    offset = FittedEffect(effect_named("effort_offset"), {})
    proof = EffectProof(6, 5, 0.667, 0.651, 45.0, 0.05, 0.4, 0.08, 30.0, 0.55, 0.0)
    assert not faint(offset, proof, 30.0)
    assert "from the noise" in faint(offset, proof, 30.0, beside_unknown=True)
    assert not faint(offset, replace(proof, gain=450.0, evidence=300.0), 300.0, beside_unknown=True)


def test_a_brief_vibration_below_the_noise_is_known_by_its_evidence() -> None:
    vibration = effect_named("external_vibration")
    assert vibration is not None
    recorded, model = pulled(3.0)
    problem = wrench_problem(recorded, model)
    values = {p.name: 0.1 for p in vibration.parameters(recorded)} | {"start": 2.0, "length": 1.0, "frequency": 8.0}
    faint_one = EffectProof(6, 6, 1.01, 1.0, 315.0, 0.03, 0.0, 3.5, 57.0, 2.0, 0.6)
    part = FittedEffect(vibration, values)
    assert "at other times" in immaterial(problem, part, faint_one)
    assert "errors of the measured motion" in immaterial(problem, part, replace(faint_one, elsewhere=0.1))
    assert not immaterial(problem, part, replace(faint_one, evidence=283.0))


def test_a_brief_event_beside_a_far_stronger_effect_is_an_error_of_its_law() -> None:
    contact, tilt = effect_named("contact"), effect_named("base_tilt")
    assert contact is not None
    assert tilt is not None
    proof = EffectProof(6, 6, 1.03, 1.02, 296.0, 0.015, 0.04, 7.1, 219.0, 5.9, 0.0)
    assert "law of an effect" in faint(FittedEffect(contact, {}), proof, 67_000.0)
    assert not faint(FittedEffect(contact, {}), proof, 20_000.0)
    assert not faint(FittedEffect(tilt, {}), proof, 67_000.0)


def test_a_name_that_a_curve_without_proof_hid_takes_its_place() -> None:
    recorded, model = pulled(3.0)
    problem, pull = wrench_problem(recorded, model), Pull(np.inf)
    state = HypothesisSearch(problem)
    state.offer(fit(problem, ()))
    named = state.fitted(problem, [FittedEffect(pull, {"force": 0.0})], 2)
    curve = next(each for each in dependences(recorded) if each.state.startswith("joint_acceleration"))
    followed = state.fitted(problem, [FittedEffect(curve, {p.name: 0.0 for p in curve.parameters(recorded)})], 2)
    assert names(named) == ("pull",)
    found = proven(state, followed)
    assert curve.name in found.dropped
    assert names(found.fit) == ("pull",)


class Knock(Pull):
    """A pull whose knocks are known only roughly."""

    name = "knock"

    def unsettled(self, recorded: RecordedMotion, values: Values) -> list[tuple[float, float]]:
        return [(5.0, 5.3)]


class Push(Pull):
    """A pull of free course in a part of the recording."""

    name = "push"
    free_course = True

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return (
            super().columns(recorded, nonlinear) * ((recorded.seconds > 7.0) & (recorded.seconds < 9.0))[:, None, None]
        )

    def windows(self, recorded: RecordedMotion, values: Values) -> list[tuple[float, float]]:
        return [(7.0, 9.0)]


def test_an_event_beside_knocks_is_proven_without_their_samples() -> None:
    """The samples of the knocks are left out of both fits and of the pieces: this was an internal error."""
    problem = wrench_problem(*pulled(2.0))
    parts = [FittedEffect(Knock(np.inf), {"force": 1.0}), FittedEffect(Push(np.inf), {"force": 1.0})]
    state = HypothesisSearch(problem)
    model = proven(state, state.fitted(problem, parts, 2))
    assert "knock" in names(model.fit)
