"""Weak places of the search: the end of a contact in its proof, what stays where an effect hardly acts, free curves."""

import numpy as np
from cases import make_case
from test_proof import Pull, pulled

from poise.mismatch.answer.belief import rival_odds
from poise.mismatch.effects import Values, effect_named
from poise.mismatch.inference import (
    FittedEffect,
    HypothesisSearch,
    Problem,
    ProvenModel,
    fit,
    proven,
    wrench_problem,
)
from poise.mismatch.inference.coarse import thinned
from poise.mismatch.inference.screening import _middles
from poise.mismatch.inference.search import prescreen
from poise.mismatch.inference.unknown import dependences
from poise.mismatch.inference.variations import _kinds
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

CONTACT = {"start": 4.0, "length": 0.7, "knots": 7.0, "x": 0.0, "y": 0.0, "z": 0.2}
COURSE = (0.2, 1.5, 0.8, 0.1, 0.02, 0.02, 0.02)
"""N, along the world's z: a knock, and a touch that ends slowly."""
_OF_THE_WHOLE = ("channel", "delay", "sign")


def proven_of(problem: Problem, parts: list[FittedEffect]) -> ProvenModel:
    """The model with these parts, from their values."""
    state = HypothesisSearch(problem)
    state.offer(fit(problem, ()))
    return proven(state, state.fitted(problem, parts, 2))


def test_a_contact_that_ends_slowly_has_its_proof() -> None:
    """Pieces with equal shares of the response left out the whole end of the course, and predicted it at random."""
    contact = effect_named("contact")
    assert contact is not None
    zero = {f"force_{axis}_{k}": 0.0 for axis in "xyz" for k in range(15)}
    forces = {f"force_z_{k}": force for k, force in enumerate(COURSE)}

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        return contact.simulate(exact, CONTACT | zero | forces)

    case = make_case(5, duration=10.0, spoil=spoil)
    problem = wrench_problem(case.recorded(), case.model)
    model = proven_of(problem, [FittedEffect(contact, CONTACT | zero)])
    assert model.dropped == {}
    (proof,) = model.proofs
    assert proof.improved_blocks == proof.blocks
    assert proof.gain > 0.5 * proof.evidence


class Beside(Pull):
    """A force that would be negative without the pull that acts against it."""

    name = "beside"

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        out = -super().columns(recorded, nonlinear)
        out[:, 0, 0] += np.cos(recorded.seconds)
        return out


def test_the_evidence_for_a_name_is_finite_where_the_others_are_impossible_without_it() -> None:
    """Infinite evidence hid that a name would have to vary, and that it has rivals: a false delay had 98 %."""
    pull, beside = Pull(np.inf), Beside(np.inf)

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        return pull.simulate(exact, {"force": 6.0}) + beside.simulate(exact, {"force": 1.5})

    case = make_case(5, duration=8.0, spoil=spoil)
    problem = wrench_problem(case.recorded(), case.model)
    model = proven_of(problem, [FittedEffect(each, {"force": 1.0}) for each in (pull, beside)])
    assert model.without[0].log_evidence == -np.inf
    assert model.proofs[0].evidence == model.proofs[0].gain > 6.0


def test_an_amplitude_varies_where_the_effect_acts_alone() -> None:
    """The rounded corners of a measured acceleration, where the response is small, spoke against true rotors."""
    recorded, model = pulled(6.0)
    problem = wrench_problem(recorded, model)
    response = Pull(np.inf).simulate(recorded, {"force": 6.0})
    small = np.abs(response[:, 0]) < 0.03 * np.abs(response[:, 0]).max()
    functions = [columns for state, columns in _kinds(problem, response, response) if state not in _OF_THE_WHOLE]
    assert functions
    assert not any(columns[small].any() for columns in functions)
    assert all(columns[~small].any() for columns in functions)


def test_laws_of_friction_that_differ_by_half_a_percent_of_their_evidence_are_rivals() -> None:
    """Friction under a load that hardly changes explained 7 of 1,490 nats less as Coulomb friction."""
    assert rival_odds(1490.0, 1483.0, 0.0, 0.005) > 0.5 > rival_odds(1490.0, 1483.0, 0.0)
    assert rival_odds(1490.0, 1300.0, 0.0, 0.005) < 1e-6


def test_a_free_curve_that_was_screened_on_averages_is_fitted_on_all_samples() -> None:
    """The middles of averages end earlier, so that a curve in time may have a knot less: its values were missing."""

    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del rng
        course = np.sin(1.3 * exact.seconds)[:, None, None]
        return wrench + 8.0 * np.hstack([(course * exact.rotation_world_sensor)[:, 2], np.zeros((len(wrench), 3))])

    case = make_case(5, duration=26.21, spoil=spoil)
    problem = wrench_problem(case.recorded(), case.model)
    (curve,) = (each for each in dependences(problem.recorded) if each.name.endswith("pushes"))
    state = HypothesisSearch(problem)
    nominal = fit(problem, ())
    state.offer(nominal)
    middles = _middles(problem.recorded, thinned(problem))
    assert len(curve.parameters(middles)) < len(curve.parameters(problem.recorded))
    ((part,),) = prescreen(state, nominal, [curve])
    assert set(part.values) == {p.name for p in curve.parameters(problem.recorded)}
