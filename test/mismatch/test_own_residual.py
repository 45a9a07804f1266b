"""What the recording says against a name: variations of its response, free curves, equal responses, gaps, events."""

from dataclasses import replace

import numpy as np
import pytest
from cases import make_case
from test_effort_recordings import PHI, ROBOT, read
from test_proof import Pull, pulled

from poise.mismatch import diagnose
from poise.mismatch.answer import NamedEffect, effects_called
from poise.mismatch.answer.belief import BeliefBasis, EffectBelief
from poise.mismatch.answer.residual_test import judge_residual
from poise.mismatch.answer.unknown_physics import likelihoods, pieces_of_a_course, unclear, undetermined
from poise.mismatch.effects import EffectParameter, effect_named
from poise.mismatch.inference import FittedEffect, fit, variations, wrench_problem
from poise.mismatch.inference.cancelling import cancelling
from poise.mismatch.inference.proof import EffectProof
from poise.mismatch.inference.replacements import stopped_at_an_end
from poise.mismatch.reading import NominalModel
from poise.mismatch.recorded import RecordedMotion, at_times


@pytest.mark.parametrize(("until", "varies"), [(np.inf, False), (4.0, True)])
def test_an_effect_that_ends_is_said_to_vary(until, varies):
    recorded, model = pulled(6.0, until)
    problem = wrench_problem(recorded, model)
    found = fit(problem, [FittedEffect(Pull(np.inf), {"force": 3.0})])
    left = problem.measured - problem.predicted(recorded) - found.response - found.calibrated
    (variation,) = variations(problem.with_noise(problem.fitted_noise(left)), found.parts)
    assert (variation.gain > 20.0) == varies


def test_a_gap_ends_the_comparison_for_a_moment():
    recorded = make_case(3, duration=8.0).recorded()
    lost = (recorded.seconds > 3.0) & (recorded.seconds < 3.2)
    problem = wrench_problem(recorded.select(~lost), NominalModel(phi=recorded.phi))
    after = (problem.seconds > 3.0) & (problem.seconds < 3.33)
    assert not problem.active[after].any()
    assert problem.active[(problem.seconds > 3.4) & (problem.seconds < 6.0)].all()
    whole = wrench_problem(recorded, NominalModel(phi=recorded.phi))
    assert whole.active[(whole.seconds > 3.0) & (whole.seconds < 3.4)].all()


@pytest.mark.parametrize(("share", "factor", "louder"), [(1.0, 1.0, False), (1.0, 2.0, True), (0.1, 6.0, False)])
def test_noise_that_grows_with_the_speed_grows_in_most_samples(share: float, factor: float, louder: bool):
    """At the corners of a motion its own errors raise a few samples only."""
    recorded = make_case(3, duration=12.0).recorded()
    problem, rng = wrench_problem(recorded, NominalModel(phi=recorded.phi)), np.random.default_rng(2)
    residual = rng.normal(size=recorded.wrench.shape) * problem.noise.sigma
    quick = problem.noise.speed > np.quantile(problem.noise.speed, 0.6)
    residual[quick & (rng.random(len(quick)) < share)] *= factor
    assert judge_residual(problem, residual, residual.T).louder == louder


@pytest.mark.parametrize(("factor", "louder"), [(1.0, False), (2.0, True)])
def test_speeds_are_compared_by_the_readings_that_count(factor: float, louder: bool):
    """One calm reading among the joints at rest made a healthy robot with dry friction `unknown`."""
    recorded = make_case(3, duration=12.0).recorded()
    problem, rng = wrench_problem(recorded, NominalModel(phi=recorded.phi)), np.random.default_rng(2)
    speed = problem.noise.speed
    rest = speed <= np.quantile(speed, 0.4)
    calm = np.zeros(len(rest), dtype=bool)
    calm[np.flatnonzero(rest & np.roll(rest, 8))[20:25]] = True
    limited = np.broadcast_to((rest & ~calm)[:, None], recorded.wrench.shape)
    residual = np.where(limited, 0.0, rng.normal(size=recorded.wrench.shape) * problem.noise.sigma)
    residual[calm] *= 0.3
    residual[speed > np.quantile(speed[~rest], 0.6)] *= factor
    assert judge_residual(replace(problem, limited=limited), residual, residual.T).louder == louder


def test_a_sensor_that_is_turned_far_is_found_from_the_description():
    case = make_case(7, duration=10.0)
    recorded, turned = case.recorded(), effect_named("sensor_rotation")
    assert turned is not None
    true = {"rotation_x": 0.03, "rotation_y": -0.05, "rotation_z": 0.12}
    recorded = replace(recorded, wrench=recorded.wrench + turned.simulate(recorded, true))
    begun = [FittedEffect(turned, dict.fromkeys(true, 1e-4))]
    (part,) = fit(wrench_problem(recorded, case.model), begun, 6).parts
    for name, value in true.items():
        assert part.values[name] == pytest.approx(value, abs=0.02)


def test_a_step_of_a_peaked_parameter_follows_its_tangent_and_stays_in_its_range():
    parameter = EffectParameter("turn", "rad", 0.02, -0.5, 0.5, linear=False, peaked=True)
    rate = (parameter.from_unit(0.5001) - parameter.from_unit(0.4999)) / 2e-4
    assert parameter.moved(0.0, 0.1 / rate) == pytest.approx(0.1, rel=1e-3)
    assert parameter.moved(0.4, 9.0) == pytest.approx(0.5, rel=1e-3)


def test_a_fit_may_end_where_a_property_vanishes_but_not_at_another_end() -> None:
    damping = EffectParameter("damping_time", "s", low=1e-3, high=2.0, linear=False, log=True, vanishes=True)
    assert not damping.at_end(1e-3)
    assert damping.at_end(2.0)
    assert replace(damping, vanishes=False).at_end(1e-3)


def test_a_filter_and_an_early_clock_that_cancel_are_no_explanation():
    recorded = make_case(3, duration=5.0).recorded()
    slow, late = (effect_named(name) for name in ("low_pass", "clock_offset"))
    assert slow is not None
    assert late is not None
    parts = [FittedEffect(slow, {"time_constant": 0.03}), FittedEffect(late, {"offset": -0.025})]
    problem = wrench_problem(recorded, NominalModel(phi=recorded.phi))
    assert cancelling(problem, parts) == ["clock_offset would cancel it", "low_pass would cancel it"]
    assert cancelling(problem, [parts[0], FittedEffect(late, {"offset": 0.025})]) == ["", ""]
    # Their delays cancel, however much they smooth together.
    parts = [FittedEffect(slow, {"time_constant": 0.4}), FittedEffect(late, {"offset": -0.38})]
    assert all(cancelling(problem, parts))


@pytest.mark.parametrize("returns", [False, True])
def test_an_end_counts_only_of_parameters_that_act(returns):
    case, effect = make_case(3, duration=5.0), effect_named("mass_step")
    assert effect is not None
    values = {"time": 2.0, "returns": float(returns), "length": 0.5, "mass": 0.2}
    values |= dict.fromkeys(("moment_x", "moment_y", "moment_z"), 0.0)
    problem = wrench_problem(case.recorded(), case.model)
    assert stopped_at_an_end(problem, fit(problem, [FittedEffect(effect, values)], 0)) == returns


def _pressed(recorded: RecordedMotion, *direction: float) -> dict[str, float]:
    """A force along the velocity of the sensor (1) or against it (-1), over a second in which it moves.

    With two directions, the force turns in the middle.
    """
    speed = np.linalg.norm(recorded.velocity_in_world, axis=1)
    middle = recorded.seconds[int(np.argmax(np.convolve(speed, np.ones(100), mode="same")))]
    values = {"start": float(middle) - 0.5, "length": 1.0, "knots": 7.0, "x": 0.0, "y": 0.0, "z": 0.0}
    for k in range(7):
        row = int(np.searchsorted(recorded.seconds, values["start"] + (k + 1) / 8.0))
        along = direction[k * len(direction) // 7] * recorded.velocity_in_world[row] / speed[row]
        values |= {f"force_{axis}_{k}": 5.0 * float(along[i]) for i, axis in enumerate("xyz")}
    return values


def test_what_attracts_the_tool_is_not_taken_for_a_contact_alone():
    recorded, contact = make_case(3, duration=8.0).recorded(), effect_named("contact")
    assert contact is not None
    assert contact.imitated(recorded, _pressed(recorded, -1.0)) == ""  # an obstacle
    assert contact.imitated(recorded, _pressed(recorded, 1.0)) == ""  # a hand that pushes the tool on
    assert contact.imitated(recorded, _pressed(recorded, 1.0, -1.0)) == "joint_position"  # a magnet
    assert contact.imitated(recorded, _pressed(recorded, -1.0, 1.0)) == ""  # a spring


def test_friction_that_decreases_is_no_viscous_friction():
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    reading = read(model, seconds=12.0, damping=8.0, efforts_alone=True)
    effort = reading.recorded.effort
    assert effort is not None
    library = effects_called(["viscous_friction", "coulomb_friction"])
    (steady,) = diagnose(reading.recorded, model, library=library).findings
    lost = np.linspace(0.0, 8.0, len(effort.seconds))[:, None] * effort.velocity
    changed = replace(reading.recorded, effort=replace(effort, measured=effort.measured - lost))
    found = diagnose(changed, model, library=library)
    assert steady.effect.name == "viscous_friction"
    assert steady.belief.probability > 0.75
    assert all(each.belief.probability < 0.5 for each in found.findings)
    assert len(ROBOT.joint_names) == effort.measured.shape[1] + 3


def test_rotors_do_not_vary_when_all_efforts_are_late():
    """A delay of the whole signal is the clock's. Relative to the part that the rotors add, it would be a large one."""
    model = NominalModel(sensor_frame="ft_sensor", phi=PHI)
    recorded, rotors = read(model, seconds=16.0, efforts_alone=True).recorded, effect_named("motor_inertia")
    assert recorded.effort is not None
    values = {p.name: 0.1 for p in rotors.parameters(recorded)}
    measured = recorded.effort.measured + rotors.simulate(recorded, values)
    late = at_times(recorded.effort.seconds, measured, recorded.effort.seconds - 0.002)
    changed = replace(recorded, effort=replace(recorded.effort, measured=late))
    found = diagnose(changed, model, library=effects_called(["motor_inertia", "viscous_friction"])).main
    assert [each.effect.name for each in found.findings] == ["motor_inertia"]
    (variation,) = variations(found.problem, found.best.parts)
    assert variation.gain < 3.0


@pytest.mark.parametrize(("length", "rope_as_likely"), [(0.06, False), (0.2, True)])
def test_a_long_pendulum_is_a_liquid_or_a_rope(length, rope_as_likely):
    case, slosh = make_case(3, duration=12.0), effect_named("slosh")
    recorded = case.recorded()
    swing = {"length": length, "damping_ratio": 0.05, "x": 0.0, "y": 0.02, "z": 0.1, "mass": 0.3}
    changed = replace(recorded, wrench=recorded.wrench + slosh.simulate(recorded, swing))
    (found,) = diagnose(changed, case.model, library=effects_called(["slosh", "hanging_chain"])).findings
    assert found.effect.name == "slosh"
    assert "hanging_chain" in found.belief.alike  # a weight on a short string swings alike, too
    assert (found.belief.probability < 0.5) == rope_as_likely


def test_an_effect_with_likelier_rivals_is_not_named_but_said():
    def named(chance: float) -> NamedEffect:
        effect = effect_named("joint_offset")
        assert effect is not None
        belief = EffectBelief(chance, (("base_tilt", 0.3),), ("base_tilt",), BeliefBasis(90.0, 2.0, 0, False))
        return NamedEffect(effect, {}, np.zeros((0, 0)), belief, {}, (), "", None)

    weak, sure = named(0.2), named(0.6)
    assert unclear([weak, sure]) == [weak]
    assert likelihoods(weak) == "joint_offset 20 %, base_tilt 30 %"


@pytest.mark.parametrize(("varies", "share", "piece"), [("time", 0.03, True), ("time", 0.8, False), ("", 0.03, False)])
def test_an_event_is_a_piece_of_a_larger_cause_that_varies_with_time(varies: str, share: float, piece: bool):
    """A slowly changing pull was a `mass_step` (68 %) of an arm without a payload, beside an unclear `world_force`."""

    def named(name: str, chance: float, of_error: float, varies_with: str = "") -> NamedEffect:
        effect = effect_named(name)
        assert effect is not None
        belief = EffectBelief(chance, (), (), BeliefBasis(90.0, 2.0, 0, False), varies_with)
        proof = EffectProof(6, 6, 1.2, 1.0, 4500.0, of_error, 0.0, 40.0, 4700.0, 1.0, 0.0)
        return NamedEffect(effect, {}, np.zeros((0, 0)), belief, {}, (), "", proof)

    step, lasting = named("mass_step", 0.7, share), named("viscous_friction", 0.9, 0.03)
    pull = named("world_force", 0.3, 0.4, varies)
    unnamed = unclear([lasting, step, pull])
    assert unnamed == [pull]
    assert pieces_of_a_course([lasting, step, pull], unnamed) == ([step] if piece else [])


@pytest.mark.parametrize(("chance", "error", "kept"), [(0.02, 0.9, False), (0.02, 2.0, True), (0.3, 0.9, True)])
def test_an_effect_that_is_contradicted_is_no_unknown_physics_where_the_rest_is_noise_without_it(chance, error, kept):
    case, effect = make_case(3, duration=6.0), effect_named("grasp_compliance")
    assert effect is not None
    belief = EffectBelief(chance, (), (), None)
    proof = EffectProof(6, 5, error, 0.9, 16.0, 0.01, 0.0, 0.5, 8.0, 0.1, 0.0)
    found = NamedEffect(effect, {}, np.zeros((0, 0)), belief, {}, (), "", proof)
    assert undetermined(wrench_problem(case.recorded(), case.model), [found]) == [found] * kept


def test_one_joint_cannot_distinguish_its_zero_from_a_tilted_base():
    effect = effect_named("joint_offset")
    assert effect is not None
    recorded = make_case(3, duration=5.0).recorded()
    assert effect.twins(recorded, {"offset_1": 0.02}) == ("base_tilt",)
    assert effect.twins(recorded, {"offset_1": 0.02, "offset_2": 0.0}) == ()
