"""Causes of which the responses are equal: the answer says so, or has the likelier one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from effects.effect_worlds import NOISE, recorded
from field_robots import Recorded, read, urdf

from benchmarks.foreign.case import make_case
from benchmarks.foreign.plan import Plan
from benchmarks.foreign.run import answer
from poise.mismatch.answer import Diagnosis, diagnose, effects_called
from poise.mismatch.reading import NominalModel

_SLIDE = urdf(("slide", "prismatic", "1 0 0"))
_TURN = urdf(("turn", "revolute", "0 1 0"))


@pytest.mark.parametrize(("text", "equal"), [(_SLIDE, True), (_TURN, False)])
def test_a_rotor_and_a_gain_are_equal_on_a_level_slide(text: str, equal: bool) -> None:
    """Without gravity each effort is a mass times the acceleration."""
    states = Recorded(text).joints()
    acceleration = np.gradient(states.velocity, states.stamps * 1e-9, axis=0)
    reading = read(replace(states, effort=states.effort + 0.5 * acceleration), text)
    tried = effects_called(["motor_gain", "motor_inertia", "viscous_friction"])
    (named,) = diagnose(reading.recorded, reading.model, library=tried).findings
    pair = {"motor_gain", "motor_inertia"}
    assert named.effect.name == "motor_inertia" or equal
    assert ({named.effect.name, *named.belief.alike} == pair) == equal
    assert (named.belief.probability < 0.55) == equal


def _scaled(gains: list[float]) -> Diagnosis:
    """Of a sensor whose channels have these gains."""
    at = recorded("fourier")
    noise = np.random.default_rng(5).normal(size=at.prediction.shape) * NOISE
    return diagnose(replace(at, wrench=at.prediction * np.array(gains) + noise), NominalModel(phi=at.phi))


def test_gains_of_some_axes_are_no_matrix() -> None:
    (named,) = _scaled([1.08, 1.0, 1.1, 1.0, 1.0, 1.0]).findings
    assert named.effect.name == "sensor_gain"
    assert named.belief.probability > 0.9
    assert set(named.parameters) == {f"gain_{axis}_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")}
    assert "crosstalk inside its tolerance" in named.sentence


def test_a_gain_that_all_axes_share_is_another_payload() -> None:
    """Both have the same response; six amplifiers that are off alike are rarer than a payload that is heavier."""
    (named,) = _scaled([1.12] * 6).findings
    assert named.effect.name == "payload_parameters"
    assert "sensor_gain" in named.belief.alike
    assert named.parameters["mass"].value == pytest.approx(0.12 * 2.2, rel=0.05)


def test_a_gain_beside_another_payload_says_what_all_axes_share() -> None:
    (named,) = _scaled([1.2] + [1.12] * 5).findings
    assert named.effect.name == "sensor_gain"
    assert "% of all axes may be the payload's" in named.sentence


def test_a_pull_on_one_axis_is_no_zero_of_its_encoder(tmp_path: Path) -> None:
    """Zero, tilt, link and a pull have one response, of which the tolerances explain most: none is named."""
    make_case(Plan((829_157, 25), "single", "one_axis_efforts", ("world_force",), 1.0)).write(tmp_path / "case")
    said = answer(tmp_path / "case", 300)["answer"]
    assert said["verdict"] == "unknown"
    causes = {each["name"]: each["probability"] for each in said["unknown"]["candidates"]}
    assert {"world_force", "joint_offset", "base_tilt"} <= causes.keys()
    assert max(causes.values()) < 0.45
    assert 0.9 < sum(causes.values()) <= 1.0
