"""Tolerances of a trajectory: the default, none, or a goal's own; on the path and at the end."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.fake_robots.following import Following, JointTolerances, Outcome

JOINTS = ("shoulder", "elbow")


def tolerances(*given, default=0.0):
    return JointTolerances.read(JOINTS, list(given), default)


def state(shoulder=0.0, elbow=0.0, speed=0.0):
    return np.array([[shoulder, elbow], [speed, 0.0], [0.0, 0.0]])


def test_zero_is_the_default_and_minus_one_is_any_error():
    read = tolerances(("shoulder", (0.0, 0.2, -1)), ("elbow", (-1, 0.0, 0.0)), default=0.05).most
    np.testing.assert_array_equal(read, [[0.05, np.inf], [0.2, np.inf], [np.inf, np.inf]])
    assert np.isinf(tolerances().most).all()


@pytest.mark.parametrize(
    ("given", "code"),
    [
        (("wrist", (0.1, 0.0, 0.0)), ErrorCode.JOINT_MISSING),
        (("elbow", (-0.1, 0.0, 0.0)), ErrorCode.BAD_INPUT),
        (("elbow", (np.nan, 0.0, 0.0)), ErrorCode.BAD_INPUT),
        (("elbow", (np.inf, 0.0, 0.0)), ErrorCode.BAD_INPUT),
    ],
)
def test_tolerances_that_mean_nothing_are_refused(given, code):
    with pytest.raises(InputError) as caught:
        tolerances(given)
    assert caught.value.code is code


def test_the_path_counts_until_the_end_and_the_goal_after_it():
    following = Following(JOINTS, np.zeros(2), 2.0, tolerances(default=0.1), tolerances(default=0.01), 1.0)
    assert following.judge(1.0, state(), state(elbow=0.09)) is None
    code, sentence = following.judge(1.0, state(), state(elbow=0.2))
    assert code is Outcome.PATH_TOLERANCE_VIOLATED
    assert sentence == "path tolerance: position of elbow is off by -0.2000; allowed are 0.1000"
    assert following.judge(2.5, state(), state(shoulder=0.05)) is None  # it may still arrive
    assert following.judge(2.5, state(), state(shoulder=0.005)) == (Outcome.SUCCESSFUL, "")
    code, sentence = following.judge(3.1, state(), state(shoulder=0.05))
    assert code is Outcome.GOAL_TOLERANCE_VIOLATED
    assert "1.00 s after the end: position of shoulder is off by -0.0500" in sentence


def test_a_goal_may_ask_for_rest():
    following = Following(JOINTS, np.zeros(2), 2.0, tolerances(), tolerances(("shoulder", (0.0, 0.01, 0.0))), 0.0)
    assert following.deadline == 2.0
    assert following.judge(2.0, state(), state(speed=0.1))[0] is Outcome.GOAL_TOLERANCE_VIOLATED
    assert following.judge(2.0, state(), state(speed=0.001))[0] is Outcome.SUCCESSFUL
