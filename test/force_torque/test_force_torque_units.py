"""Counts and units become N and N m, in the contract's sign."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.force_torque.samples import Calibration, Reports
from poise.force_torque.units import FORCE, TORQUE, newton_metres_per, newtons_per


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
    assert not FORCE.keys() & TORQUE.keys()
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
