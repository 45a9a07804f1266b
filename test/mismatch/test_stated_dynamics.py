"""The dynamics that a robot description states, and a heavy slide whose encoder counts steps."""

from pathlib import Path

import numpy as np
from field_robots import streams

from poise.mismatch import diagnose
from poise.mismatch.reading import parse_model, read_streams
from poise.recording import JointStream
from poise.simulation.models import urdf_physics

AXIS = """<robot name="axis"><link name="base"/><link name="carriage"><inertial><mass value="40"/>
<origin xyz="0 0 0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<dynamics friction="15" damping="20"/><limit lower="-2" upper="2" effort="900" velocity="3"/></joint></robot>"""


def axis_states(step: float) -> JointStream:
    """A heavy slide that its description describes, with an encoder that counts steps, m."""
    rng, times = np.random.default_rng(5), np.arange(0.0, 20.0, 0.008)
    rates, sizes = np.array([0.5, 1.3, 2.1]), np.array([0.3, 0.12, 0.05])
    phase = rates * times[:, None] + [0.0, 1.0, 2.0]
    x, v = (sizes * np.sin(phase)).sum(1), (sizes * rates * np.cos(phase)).sum(1)
    a = -(sizes * rates**2 * np.sin(phase)).sum(1)
    force = 40.0 * a + 15.0 * np.tanh(v / 1e-3) + 20.0 * v + 0.3 * rng.normal(size=len(times))
    stamps = 10**18 + np.round(times * 1e9).astype(np.int64)
    read = step * np.round(x / step)[:, None]
    return JointStream(stamps, ("x",), read, np.gradient(read, 0.008, axis=0), force[:, None])


def test_a_description_states_the_dynamics_of_its_joints() -> None:
    assert {name: each.values for name, each in urdf_physics(AXIS).items()} == {
        "x": {"friction": 15.0, "damping": 20.0}
    }
    found = read_streams(streams(axis_states(1e-6), AXIS), parse_model({}))
    assert any("states dynamics of joints (x friction 15, damping 20)" in note for note in found.notes)


def test_steps_of_an_encoder_are_no_noise_that_grows_with_the_speed(tmp_path: Path) -> None:
    """At rest an encoder reads the same, and a heavy slide turns its steps under way into forces."""
    (tmp_path / "axis.urdf").write_text(AXIS, encoding="utf-8")
    model = parse_model({"simulator": "axis.urdf"}, tmp_path)
    found = read_streams(streams(axis_states(5e-5), AXIS), model)
    assert not any("states dynamics" in note for note in found.notes)
    assert found.recorded.effort is not None
    assert found.recorded.effort.stated[0].friction == 15.0
    assert diagnose(found.recorded, found.model).verdict == "none"
