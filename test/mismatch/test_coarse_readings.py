"""Readings of a coarse converter: their rounding follows the load, at any rate, and is neither physics nor a fault."""

import numpy as np
import pytest
from field_robots import ARM, Recorded, read, urdf

from poise.mismatch.answer import diagnose
from poise.mismatch.answer.named import within_errors
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import FittedEffect
from poise.mismatch.reading import ReadRecording
from poise.mismatch.reading.wrench_samples import averaged, averaged_readings, usable
from poise.mismatch.recorded import coarse_steps, lattice
from poise.recording import JointStream, WrenchStream
from poise.types import Array

PAN_AND_TILT = urdf(("pan", "revolute", "0 0 1"), ("tilt", "revolute", "0 1 0"))


def in_steps(text: str, rate: float, step: float, coulomb: float, seed: int) -> ReadRecording:
    """A robot whose efforts come in steps that are ten times their noise."""
    joints = Recorded(text, coulomb=coulomb, rate=rate, seed=seed, effort_noise=0.1 * step).joints()
    effort = np.round(joints.effort / step) * step
    return read(JointStream(joints.stamps, joints.names, joints.position, joints.velocity, effort), text)


@pytest.mark.parametrize(
    ("text", "rate", "step", "seed"),
    [(ARM, 250.0, 0.25, 1), (ARM, 250.0, 1.0, 1), (ARM, 1000.0, 1.0, 1), (PAN_AND_TILT, 1000.0, 1.0, 1)],
)
def test_steps_of_the_efforts_are_no_effect(text: str, rate: float, step: float, seed: int) -> None:
    """Before: gear_ripple (67 %), motor_gain (58 %), unknown, mass_step (55 %)."""
    case = in_steps(text, rate, step, 0.0, seed)
    found = diagnose(case.recorded, case.model)
    assert (found.verdict, found.findings) == ("none", ())
    assert [each.kind for each in case.findings] == []


def test_friction_of_most_of_a_step_is_still_named() -> None:
    case = in_steps(ARM, 1000.0, 1.0, 0.7, 3)
    found = diagnose(case.recorded, case.model)
    (named,) = found.findings
    assert named.effect.name == "coulomb_friction"
    assert [named.values[f"torque_{i}"] for i in (1, 2, 3)] == pytest.approx([0.7, 0.7, 0.7], abs=0.2)


def slow(noise: float) -> Array:
    """(8000, 2) readings in steps of 0.5, and how far they are dithered, in steps."""
    at = np.linspace(0.0, 8.0, 8000)
    load = np.stack([3.0 * np.sin(at), 5.0 * np.cos(0.7 * at)], axis=1)
    return np.asarray(np.round(load / 0.5 + noise * np.random.default_rng(1).normal(size=load.shape)) * 0.5)


def test_averages_of_coarse_readings_keep_their_steps() -> None:
    coarse, dithered = slow(0.02), slow(0.6)
    assert coarse_steps(coarse) == pytest.approx([0.5, 0.5])
    assert coarse_steps(dithered) == pytest.approx([0.0, 0.0])
    assert lattice(averaged_readings(coarse, 4)) == pytest.approx(0.5)
    np.testing.assert_array_equal(averaged_readings(dithered, 4), averaged(dithered, 4))
    assert lattice(averaged(coarse, 4)) == pytest.approx(0.125)  # what looked like a finer converter


def test_a_fast_wrench_has_the_steps_of_its_sensor() -> None:
    readings = np.hstack([slow(0.02), slow(0.02), slow(0.02)])
    wrench = WrenchStream(np.arange(len(readings)) * 1_000_000, readings, "sensor")
    fewer, (note,) = usable(wrench)
    assert "4 samples each were averaged" in note
    assert lattice(fewer.wrench_in_sensor[:, :3]) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("levels", "step"), [([0.8, 1.2, 1.6], 0.4), ([-6.0, -5.0], 1.0), ([3.21, 3.58], 0.0), ([0.0], 0.0)]
)
def test_few_levels_show_a_step_where_they_are_its_multiples(levels: list[float], step: float) -> None:
    values = np.random.default_rng(3).choice(levels, 500)
    assert lattice(values) == pytest.approx(step)


@pytest.mark.parametrize(("torque", "nothing"), [(0.007, True), (0.2, False)])
def test_a_size_within_its_error_is_no_effect(torque: float, nothing: bool) -> None:
    """Friction of 0.007 +- 0.013 N was named with 68 %: its asymmetry, which is no size, had followed the rounding."""
    case, effect = in_steps(ARM, 125.0, 0.01, 0.0, 1), effect_named("coulomb_friction")
    assert effect is not None
    parameters = effect.parameters(case.recorded)
    values = {p.name: 0.0 for p in parameters}
    values |= {"transition": 0.01, "torque_3": torque, "asymmetry_3": 0.12}
    sigma = [0.013 if p.name.startswith(("torque_3", "asymmetry")) else 0.0 for p in parameters]
    assert within_errors(FittedEffect(effect, values), case.recorded, np.diag(np.square(sigma))) == nothing


def test_sizes_that_are_known_together_only_are_an_effect() -> None:
    """On one axis, the mass and the moment of a load are known by their sum alone."""
    case, effect = in_steps(ARM, 125.0, 0.01, 0.0, 1), effect_named("coulomb_friction")
    assert effect is not None
    names = [p.name for p in effect.parameters(case.recorded)]
    values = dict.fromkeys(names, 0.0) | {"torque_1": 0.5, "torque_2": 0.5}
    first, second = names.index("torque_1"), names.index("torque_2")
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_((first, second), (first, second))] = [[1.0, -0.9999], [-0.9999, 1.0]]
    assert not within_errors(FittedEffect(effect, values), case.recorded, covariance)
    assert within_errors(FittedEffect(effect, values | {"torque_2": -0.5}), case.recorded, covariance)
