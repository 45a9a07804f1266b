"""Dry friction that varies with the position of a joint, against friction that does not."""

from dataclasses import replace

import numpy as np
import pytest
from field_robots import ARM, Recorded, read

from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.effects import effect_named

LIBRARY = ("viscous_friction", "coulomb_friction", "stribeck_friction", "load_dependent_friction", "position_friction")


@pytest.mark.parametrize(("uneven", "name"), [(0.0, "coulomb_friction"), (0.7, "position_friction")])
def test_a_tight_spot_is_no_even_friction(uneven: float, name: str) -> None:
    """A bump about one angle, which no sine describes exactly, on top of an even friction."""
    joints = Recorded(ARM, seconds=20.0, effort_noise=0.1).joints()
    spot = joints.position.mean(axis=0) + 0.5
    size = 2.0 * (1.0 - uneven + uneven * np.exp((np.cos(joints.position - spot) - 1.0) / 0.3))
    tight = replace(joints, effort=joints.effort + size * np.tanh(joints.velocity / 5e-3))
    reading = read(tight)
    found = diagnose(reading.recorded, reading.model, library=effects_called(LIBRARY))
    assert [each.effect.name for each in found.findings] == [name]


def test_stiction_is_no_tight_spot() -> None:
    """Both contain Coulomb friction; the one that explains more takes its place."""
    joints = Recorded(ARM, seconds=20.0, effort_noise=0.1).joints()
    size = 1.0 + 1.0 * np.exp(-((joints.velocity / 0.1) ** 2))
    stuck = replace(joints, effort=joints.effort + size * np.tanh(joints.velocity / 5e-3))
    reading = read(stuck)
    found = diagnose(reading.recorded, reading.model, library=effects_called(LIBRARY))
    assert [each.effect.name for each in found.findings] == ["stribeck_friction"]


def test_friction_that_would_drive_a_joint_is_no_answer() -> None:
    recorded, effect = read(Recorded(ARM, seconds=6.0).joints()).recorded, effect_named("position_friction")
    assert effect is not None
    values = {p.name: 0.0 if p.linear else p.from_unit(0.5) for p in effect.parameters(recorded)}
    assert "hardly varies" in effect.implausible(recorded, values | {"torque_1": 2.0})
    assert effect.implausible(recorded, values | {"torque_1": 2.0, "sine_1": 1.0}) == ""
    assert "drive" in effect.implausible(recorded, values | {"torque_1": 0.1, "sine_1": -3.0, "cosine_1": -3.0})
