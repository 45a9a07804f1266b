"""The one door to the conic solver: nothing but finite numbers goes in, nothing unchecked comes out."""

import numpy as np
import pytest

from poise.assembly.statics.solvers import Cones, ConicProgram, Outcome
from poise.errors import ErrorCode, NoAnswerError


def test_a_small_program_has_its_known_answer():
    """min -x - y in the unit disc: (1, 1) / sqrt 2."""
    matrix = np.array([[0.0, 0], [-1, 0], [0, -1]])
    program = ConicProgram(matrix, np.array([1.0, 0, 0]), Cones(second_order=(3,)))
    found = program.solve(np.array([-1.0, -1]))
    assert found.outcome is Outcome.SOLVED
    np.testing.assert_allclose(found.x, np.sqrt(0.5), atol=1e-8)
    assert found.value == pytest.approx(-np.sqrt(2))
    assert found.dual_value == pytest.approx(-np.sqrt(2))


def test_one_program_answers_many_objectives_and_changed_rows():
    program = ConicProgram(np.array([[0.0, 0], [-1, 0], [0, -1]]), np.array([1.0, 0, 0]), Cones(second_order=(3,)))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.normal(size=2)
        assert program.solve(q).value == pytest.approx(-np.linalg.norm(q), rel=1e-7)
    program.set_matrix(np.array([-2.0, -2.0]))
    assert program.solve(np.array([1.0, 0])).value == pytest.approx(-0.5)


def test_a_quadratic_program_projects_onto_a_half_space():
    program = ConicProgram(np.array([[-1.0, -1]]), np.array([-2.0]), Cones(nonnegative=1), quadratic=np.eye(2))
    np.testing.assert_allclose(program.solve(np.zeros(2)).x, [1, 1], atol=1e-7)


def test_infeasible_and_unbounded_are_told_apart():
    empty = ConicProgram(np.array([[1.0], [-1]]), np.array([-1.0, -1]), Cones(nonnegative=2))
    assert empty.solve(np.array([1.0])).outcome is Outcome.INFEASIBLE
    endless = ConicProgram(np.array([[-1.0]]), np.array([0.0]), Cones(nonnegative=1)).solve(np.array([-1.0]))
    assert endless.outcome is Outcome.UNBOUNDED
    assert endless.x[0] > 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["matrix", "right", "objective", "quadratic", "later"])
def test_no_number_that_is_not_finite_reaches_the_solver(value, where):
    bad = {name: value if name == where else 1.0 for name in ("matrix", "right", "objective", "quadratic", "later")}

    def attempt():
        matrix, right, quadratic = np.array([[bad["matrix"]]]), np.array([bad["right"]]), np.array([[bad["quadratic"]]])
        program = ConicProgram(matrix, right, Cones(nonnegative=1), quadratic=quadratic)
        program.set_matrix(np.array([bad["later"]]))
        program.solve(np.array([bad["objective"]]))

    with pytest.raises(NoAnswerError) as caught:
        attempt()
    assert caught.value.code is ErrorCode.SOLVER_FAILED


def test_an_answer_cut_short_is_refused_not_returned():
    rng = np.random.default_rng(1)
    count = 300
    matrix = np.vstack([np.zeros((1, count)), -np.eye(count)])
    program = ConicProgram(
        matrix, np.append(1.0, rng.normal(size=count)), Cones(second_order=(count + 1,)), time_limit=1e-9
    )
    with pytest.raises(NoAnswerError, match="stopped") as caught:
        program.solve(rng.normal(size=count))
    assert caught.value.code is ErrorCode.SOLVER_FAILED


def test_rows_that_do_not_match_their_cones_are_a_fault_of_ours():
    with pytest.raises(ValueError, match="rows"):
        ConicProgram(np.eye(3), np.zeros(3), Cones(nonnegative=2))
