"""A rope of rods, simulated by MuJoCo, on a moving arm: the answer is a hanging chain, and no motion of the base."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the benchmark's engine is an extra: pip install '.[sim]'")

from benchmarks.concealed.case import Case, Plan, make_case
from benchmarks.concealed.changes.moving import Chain
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import search, wrench_problem
from poise.mismatch.reading import load_model, read_recording
from poise.recording import open_recording

RIVALS = ("hanging_chain", "base_motion", "slosh")


@cache
def rope() -> Case:
    return make_case(Plan("single", ("hanging_chain",), 1.0, False, (4_021, 8_003)))


def test_the_modes_of_many_rods_are_those_of_a_rope():
    length, mass = Chain(name="rope", mass=1.0, link=0.01, links=60).first_mode()
    first_zero = 2.404826  # of the Bessel function J0
    assert length == pytest.approx(4 * 0.6 / first_zero**2, rel=0.01)
    assert mass == pytest.approx(4 / first_zero**2, rel=0.02)


def test_a_rope_is_a_hanging_chain_and_no_motion_of_the_base(tmp_path):
    rope().write(tmp_path, "case")
    reading = read_recording(open_recording(tmp_path / "case.mcap"), load_model(tmp_path / "case.yaml"))
    problem = wrench_problem(reading.recorded, reading.model)
    _, best = search(problem, [effect_named(name) for name in RIVALS])
    names = [part.effect.name for part in best.parts]
    assert "hanging_chain" in names
    assert "base_motion" not in names
    values = next(part.values for part in best.parts if part.effect.name == "hanging_chain")
    truth = rope().label.effects[0]["parameters"]
    assert values["length"] == pytest.approx(truth["length"], rel=0.05)
    assert values["mass"] == pytest.approx(truth["mass"], rel=0.3)
    assert np.abs([values[axis] - truth[axis] for axis in "xyz"]).max() < 0.03
