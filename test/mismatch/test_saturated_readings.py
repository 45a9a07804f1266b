"""The end of a sensor's range: which readings are at it, with a limit that the model states and without."""

from dataclasses import replace

import numpy as np
import pytest
from cases import make_case

from poise.mismatch.answer import diagnose
from poise.mismatch.effects import exceeded, limited_readings
from poise.mismatch.reading import ModelEffect
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

HIGH = 1e4


@pytest.fixture(scope="module")
def healthy():
    case = make_case(11, ())
    return case, case.recorded()


def with_forces(recorded: RecordedMotion, forces: Array) -> RecordedMotion:
    return replace(recorded, wrench=np.hstack([forces, recorded.wrench[:, 3:]]))


def clipped(recorded: RecordedMotion, low: Array | float, high: Array | float) -> RecordedMotion:
    return with_forces(recorded, np.clip(recorded.wrench[:, :3], low, high))


def test_each_end_of_each_axis_is_found(healthy) -> None:
    """A gauge that limits one axis earlier, and a sensor that was tared: its ends are not symmetric."""
    _, recorded = healthy
    tops = np.quantile(np.abs(recorded.wrench[:, :3]), [0.9, 0.95, 0.8], axis=0).diagonal()
    for low, high in ((-tops, tops), (-tops - 2.0, tops - 2.0)):
        readings = clipped(recorded, low, high)
        beyond = (recorded.wrench[:, :3] >= high) | (recorded.wrench[:, :3] <= low)
        limited = limited_readings(readings)
        assert limited is not None
        assert not (limited[:, :3] & ~beyond).any()
        assert (limited[:, :3] & beyond).sum() > 0.9 * beyond.sum()
        assert not limited[:, 3:].any()


def test_rounded_readings_at_rest_are_not_limited(healthy) -> None:
    """The largest value may repeat because the arm stands still: the load does not vary there."""
    _, recorded = healthy
    last = int(np.argmax(np.abs(recorded.wrench[:, 2])))
    rests = np.arange(len(recorded)).clip(max=last)
    still = replace(recorded, wrench=np.round(recorded.wrench[rests], 1), prediction=recorded.prediction[rests])
    assert limited_readings(still) is None


@pytest.mark.parametrize("step", [0.0, 0.25])
@pytest.mark.parametrize(("factor", "named"), [(1.0, False), (1.001, False), (2.0, True)])
def test_a_stated_limit_does_not_hide_what_the_readings_show(healthy, factor: float, named: bool, step: float) -> None:
    case, recorded = healthy
    limit = float(np.quantile(np.abs(recorded.wrench[:, 2]), 0.7))
    readings = clipped(recorded, -limit, limit)
    if step:
        readings = with_forces(readings, np.round(readings.wrench[:, :3] / step) * step)
    states = ModelEffect("saturation", {"force_limit": factor * limit, "torque_limit": HIGH}, np.zeros((2, 2)))
    found = diagnose(readings, replace(case.model, effects=(states,)))
    assert found.unknown is None
    assert ("saturation" in {each.effect.name for each in found.findings}) is named


def test_a_stated_limit_that_readings_exceed_is_not_used(healthy) -> None:
    case, recorded = healthy
    limit = float(np.quantile(np.abs(recorded.wrench[:, 2]), 0.7)) / 2.0
    values = {"force_limit": limit, "torque_limit": HIGH}
    assert exceeded(recorded, "force_limit", limit)
    assert not exceeded(recorded, "torque_limit", HIGH)
    assert limited_readings(recorded, values) is None
    states = ModelEffect("saturation", values, np.zeros((2, 2)))
    assert diagnose(recorded, replace(case.model, effects=(states,))).verdict == "none"


def test_a_payload_that_is_lighter_within_its_tolerance_does_not_hide_the_limit(healthy) -> None:
    """The nominal prediction is below many limited readings then; that of the calibrated fit is not."""
    case, recorded = healthy
    lighter = with_forces(recorded, 1.03 * recorded.wrench[:, :3])
    limit = float(np.quantile(np.abs(lighter.wrench[:, 2]), 0.5))
    found = diagnose(clipped(lighter, -limit, limit), case.model)
    assert {each.effect.name for each in found.findings} == {"saturation"}
