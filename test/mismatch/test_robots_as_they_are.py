"""The diagnosis of robots as they are: joint efforts without a wrist sensor, from one joint upwards."""

import numpy as np
import pytest
from field_robots import ARM, Recorded, read, streams, urdf

from poise.errors import ErrorCode, InputError
from poise.mismatch.answer import diagnose, effects_called
from poise.mismatch.reading import NominalModel, read_streams

TURN = urdf(("turn", "revolute", "0 1 0"))
SLIDE = urdf(("slide", "prismatic", "1 0 0"))
GANTRY = urdf(("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("z", "prismatic", "0 0 1"))


@pytest.mark.parametrize("text", [TURN, SLIDE, GANTRY, ARM])
def test_friction_is_named_from_joint_efforts_alone(text: str) -> None:
    case = Recorded(text, damping=3.0)
    reading = read(case.joints(), text)
    assert reading.model.sensor_frame == f"link_{text.count('<joint')}"
    assert not reading.recorded.has("wrench")
    assert reading.recorded.joints is not None
    found = diagnose(reading.recorded, reading.model, library=effects_called(["viscous_friction"]))
    (named,) = found.findings
    assert list(named.values.values()) == pytest.approx([3.0] * text.count("<joint"), rel=0.05)
    assert found.main.proof.augmented < 0.5 * found.main.proof.nominal
    healthy = read(Recorded(text).joints(), text)
    assert not diagnose(healthy.recorded, healthy.model, library=effects_called(["viscous_friction"])).findings


@pytest.mark.parametrize("rate", [1000.0, 5000.0])
def test_fast_efforts_are_averaged_to_what_the_motion_can_follow(rate: float) -> None:
    case = Recorded(TURN, seconds=6.0, rate=rate)
    reading = read(case.joints(), TURN)
    effort = reading.recorded.effort
    assert effort is not None
    assert np.median(np.diff(effort.seconds)) == pytest.approx(0.004, rel=0.01)
    # The noise of a mean of k samples is smaller by the root of k, and the mean is where the motion is.
    error = effort.measured - effort.prediction
    assert error.std() == pytest.approx(case.effort_noise / np.sqrt(rate / 250.0), rel=0.1)
    assert any("were averaged" in note for note in reading.notes)


def test_without_wrench_and_efforts_it_says_what_to_record() -> None:
    joints = Recorded(TURN, effort_noise=np.nan).joints()
    with pytest.raises(InputError, match="no wrench") as caught:
        read(joints, TURN)
    assert caught.value.code is ErrorCode.TOPIC_MISSING


def test_a_payload_of_the_model_hangs_on_the_last_link() -> None:
    joints = Recorded(ARM).joints()
    model = NominalModel(phi=np.array([1.0, 0.1, 0.0, 0.0, *[0.0] * 6]))
    empty, loaded = (read_streams(streams(joints), each).recorded.effort for each in (NominalModel(), model))
    assert empty is not None
    assert loaded is not None
    # Slow at first: the weight of 1 kg, 0.3 m along the first link and 0.4 m along the second.
    upper, both = empty.position[0, 0], empty.position[0, :2].sum()
    lever = 0.3 * np.cos(upper) + 0.4 * np.cos(both)
    assert abs((loaded.rigid - empty.rigid)[0, 0]) == pytest.approx(9.81 * lever, rel=0.1)
