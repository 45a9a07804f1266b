"""Knocks of a part in the load are physics: they stay in the data, and the part that makes them is found."""

from dataclasses import replace

import numpy as np
import pytest
from effect_worlds import NOISE, TYPICAL, recorded, typical

from poise.mismatch.effects import effect_named
from poise.mismatch.reading.sanity import without_spikes

LOOSE = effect_named("loose_part")


def knocking(seed=4):
    at = recorded("poses")
    values = TYPICAL["loose_part"] | {"settling": 0.006, "friction": 0.005}
    noise = np.random.default_rng(seed).normal(size=at.wrench.shape) * NOISE
    return replace(at, wrench=at.prediction + LOOSE.simulate(at, values) + noise), values


def test_the_knocks_of_a_loose_part_are_not_outliers():
    at, values = knocking()
    assert len(LOOSE.unsettled(at, values)) >= 5
    kept, notes = without_spikes(at)
    assert len(kept) == len(at)
    assert notes == []


@pytest.mark.parametrize("channels", [slice(0, 1), slice(0, 6)])
def test_transmission_errors_are_outliers(channels):
    at = recorded("poses")
    rng = np.random.default_rng(5)
    wrench = at.prediction + rng.normal(size=at.wrench.shape) * NOISE
    rows = rng.choice(np.arange(10, len(at) - 10), 12, replace=False)
    wrench[rows, channels] += (50.0 * NOISE * rng.choice([-1.0, 1.0], (12, 6)))[:, channels]
    kept, notes = without_spikes(replace(at, wrench=wrench))
    assert len(kept) == len(at) - 12
    assert "12 wrench samples" in notes[0]


def test_only_knocks_are_unsettled():
    at, values = knocking()
    windows = LOOSE.unsettled(at, values)
    inside = np.zeros(len(at), dtype=bool)
    for begin, end in windows:
        inside |= (at.seconds >= begin) & (at.seconds <= end)
    assert inside.mean() < 0.15
    # What the part does there is most of its force, and nearly none of the rest exceeds its weight.
    force = np.linalg.norm(LOOSE.simulate(at, values)[:, :3], axis=1)
    assert force[inside].max() > 5.0 * force[~inside].max()


@pytest.mark.parametrize("name", ["loose_part", "flexible_mode", "slosh", "hanging_chain"])
def test_nothing_acts_beyond_the_reach_and_no_part_outweighs_the_payload(name):
    effect, at, values = typical(name, "poses" if name == "loose_part" else "fourier")
    assert effect.implausible(at, values) == ""
    assert "0.50 m" in effect.implausible(at, values | {"x": -0.499})
    assert "payload" in effect.implausible(at, values | {"mass": 3.0})


def test_the_point_of_a_contact_on_its_line_of_force_is_free():
    """The wrench of a force does not show where on its line it acts."""
    effect, at, values = typical("contact")
    assert effect.implausible(at, values | {"x": -0.499}) == ""


def test_a_loose_part_that_stays_at_one_stop_is_none():
    """It would be a mass on a soft spring that never knocks: what a wrong inertia needs."""
    assert LOOSE.implausible(*knocking()) == ""
    _, at, values = typical("loose_part", "fourier")  # a motion that does not tilt its axis to both sides
    assert "stop" in LOOSE.implausible(at, values)
