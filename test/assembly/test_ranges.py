"""Numbers from files, Python and the command line that no assembly has: an answer that holds, or a numbered error."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import poise
from poise.assembly import acceleration_limits, plan_disassembly, robustness_map
from poise.assembly.scene import read_scene
from poise.errors import InputError, NoAnswerError

STRANGE = st.sampled_from(
    [math.nan, math.inf, -math.inf, 0, -1, 1e-300, 1e-12, 1e-7, 50, 1e5, 1e300, "x", None, [], {}]
)


def entries(usual: list[float]) -> st.SearchStrategy[Any]:
    """A list of numbers, of which one may be strange, or missing."""
    spoilt = st.tuples(st.integers(0, len(usual) - 1), STRANGE).map(
        lambda change: [change[1] if i == change[0] else value for i, value in enumerate(usual)]
    )
    return st.one_of(st.just(usual), spoilt, st.just(usual[:-1]), STRANGE)


CRATE = st.fixed_dictionaries(
    {
        "id": st.one_of(st.just("crate"), STRANGE),
        "box": entries([0.4, 0.4, 0.4]),
        "mass": st.one_of(st.just(2.0), STRANGE),
        "pose": entries([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]),
    },
    optional={
        "com": entries([0.01, 0.0, 0.0]),
        "inertia": entries([0.05, 0.0, 0.0, 0.05, 0.0, 0.05]),
        "covariance": entries([float(i == j) * 1e-4 for i in range(10) for j in range(10)]),
    },
)
FLOOR = {"id": "floor", "fixed": True, "box": [2, 2, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]}
SCENES = st.fixed_dictionaries(
    {"objects": CRATE.map(lambda crate: [FLOOR, crate])},
    optional={"gravity": entries([0.0, 0.0, -9.81]), "friction": st.one_of(st.just(0.4), STRANGE)},
)
PUSHES = st.tuples(st.just("crate"), entries([-0.2, 0.0, 0.1]), entries([1.0, 0.0, 0.0]))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(SCENES, PUSHES, st.one_of(st.none(), st.just(1.0), STRANGE))
def test_a_strange_scene_or_push_gets_a_sound_answer_or_a_numbered_error(content, push, deadline):
    try:
        found = poise.robustness(read_scene(content), [push], deadline=deadline)
    except (InputError, NoAnswerError):
        return
    (result,) = found.results
    assert math.isfinite(found.margin)
    assert 0 <= result.lower <= result.upper
    assert math.isfinite(result.lower)  # a horizontal push at any of these friction coefficients moves the crate


SCENE = read_scene(
    {"objects": [FLOOR, {"id": "crate", "box": [0.4, 0.4, 0.4], "pose": [0, 0, 0.2, 0, 0, 0, 1], "mass": 2.0}]}
)


@pytest.mark.parametrize("strange", [math.nan, -1, "soon", [1, 2]])
@pytest.mark.parametrize(
    "ask",
    [
        lambda value: acceleration_limits(SCENE, deadline=value),
        lambda value: plan_disassembly(SCENE, deadline=value),
        lambda value: robustness_map(SCENE, 10, deadline=value),
        lambda value: robustness_map(SCENE, 10, tolerance=value),
        lambda value: acceleration_limits(SCENE, directions=value),
        lambda value: acceleration_limits(SCENE, axis=(value,)),
        lambda value: acceleration_limits(SCENE, axis=(0.0, [value])),
    ],
)
def test_strange_arguments_are_refused(ask, strange):
    with pytest.raises(InputError):
        ask(strange)
