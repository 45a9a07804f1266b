"""Counts and units become N and N m, in the contract's sign."""

from pathlib import Path

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.force_torque.wire import Calibration, Reports
from poise.force_torque.wire.units import NEWTON_METRES_PER_UNIT, NEWTONS_PER_UNIT, newton_metres_per, newtons_per
from poise.recording import open_recording

BAGS = Path(__file__).parents[2] / "bags"


@pytest.mark.parametrize(
    ("unit", "newtons"),
    [("lbf", 4.4482216152605), ("klbf", 4448.2216152605), ("kgf", 9.80665), ("gf", 9.80665e-3), ("kN", 1e3), ("N", 1)],
)
def test_forces_are_those_of_nist_sp_811(unit: str, newtons: float) -> None:
    assert newtons_per(unit) == pytest.approx(newtons, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "newton_metres"),
    [
        ("lbf-in", 0.1129848290276167),
        ("lbf-ft", 1.3558179483314004),
        ("kgf-cm", 0.0980665),
        ("N-mm", 1e-3),
        ("kN-m", 1e3),
        ("N m", 1),
    ],
)
def test_torques_are_those_of_nist_sp_811(unit: str, newton_metres: float) -> None:
    assert newton_metres_per(unit) == pytest.approx(newton_metres, rel=1e-14)


@pytest.mark.parametrize("spelling", ["Nm", "N-m", "N m", "n·m", "NM"])
def test_spelling_does_not_matter(spelling: str) -> None:
    assert newton_metres_per(spelling) == 1


def test_force_and_torque_units_are_not_confused() -> None:
    assert not NEWTONS_PER_UNIT.keys() & NEWTON_METRES_PER_UNIT.keys()
    with pytest.raises(InputError) as caught:
        newtons_per("N m")
    assert caught.value.code == ErrorCode.UNSUPPORTED
    assert "'N m'" in caught.value.message


def test_a_device_that_reports_its_own_force_is_turned_round() -> None:
    counts = np.array([[1, -2, 3, -4, 5, -6]])
    on_sensor = Calibration.from_counts(10, 100).wrench(counts)
    on_load = Calibration.from_counts(10, 100, reports=Reports.SENSOR_ON_LOAD).wrench(counts)
    np.testing.assert_allclose(on_sensor, [[0.1, -0.2, 0.3, -0.04, 0.05, -0.06]])
    np.testing.assert_array_equal(on_load, -on_sensor)


def test_the_recorded_ati_sensor_reports_the_load_on_the_sensor_as_is_the_default() -> None:
    recording = open_recording(BAGS / "kuka_static_poses.mcap")
    wrench, poses = recording.wrench(), recording.poses("ft_sensor")
    rotation_base_sensor = poses.rotation_parent_child[np.searchsorted(poses.stamps, wrench.stamps) - 1]
    gravity_in_sensor = rotation_base_sensor.transpose(0, 2, 1) @ [0.0, 0.0, -9.82085]
    force = wrench.wrench_in_sensor[:, :3]
    # f = m g + bias: the slope, with the means (that is, the bias) taken off.
    gravity = gravity_in_sensor - gravity_in_sensor.mean(axis=0)
    mass = np.sum(gravity * (force - force.mean(axis=0))) / np.sum(gravity**2)
    assert mass == pytest.approx(0.9323, abs=0.01)


def test_the_limit_is_given_in_the_units_of_the_counts_and_zero_means_none() -> None:
    calibration = Calibration.from_counts(1, 1, "kN", "N mm", limit=(1, 2, 0, 3, 4, 5))
    np.testing.assert_allclose(calibration.limit, [1e3, 2e3, np.inf, 3e-3, 4e-3, 5e-3])
    replaced = calibration.with_limit(np.array([np.inf, 50, 50, np.inf, 1, 1]))
    np.testing.assert_allclose(replaced.limit, [1e3, 50, 50, 3e-3, 1, 1])


@pytest.mark.parametrize("counts", [0.0, -1.0, np.nan, np.inf])
def test_counts_that_would_make_nan_are_refused(counts: float) -> None:
    with pytest.raises(InputError, match="counts per force"):
        Calibration.from_counts(counts, 1.0)
    with pytest.raises(InputError, match="counts per torque"):
        Calibration.from_counts(1.0, counts)


@pytest.mark.parametrize("limit", [(1, 2, 3), (1, 2, 3, 4, 5, -6), (1, 2, 3, 4, 5, np.nan)])
def test_limits_that_are_none_are_refused(limit: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="limits"):
        Calibration.from_counts(1.0, 1.0, limit=limit)
