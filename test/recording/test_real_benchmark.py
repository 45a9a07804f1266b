"""Least squares with the true structure: exact on a simulated robot, and equal to what was published for EMPS."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from benchmarks.real.least_squares import fit
from benchmarks.real.rigs import RIGS, Structure
from benchmarks.real.score import SEALED, Answer, deviations, judged, values_of
from poise.recording import JointStream, open_recording, write_recording

EXAMPLES = Path(__file__).parents[2] / "examples" / "recordings"
PUBLISHED = yaml.safe_load(SEALED.read_text())
ARM = """<robot name="arm">
  <link name="base"/>
  <joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="10"/></joint>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.02"/></inertial></link>
  <joint name="two" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="10"/></joint>
  <link name="lower"><inertial><origin xyz="0 0 0.15"/><mass value="2"/>
    <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.01"/></inertial></link>
</robot>"""


def test_the_fit_of_a_simulated_robot_is_exact(tmp_path):
    model = pin.buildModelFromXML(ARM)
    data = model.createData()
    time = np.arange(4000) / 500
    phases = 2 * np.pi * time[:, None] * [0.4, 0.7]
    rates = 2 * np.pi * np.array([0.4, 0.7])
    q, v, a = np.sin(phases), rates * np.cos(phases), -(rates**2) * np.sin(phases)
    torque = np.array([pin.rnea(model, data, *state).copy() for state in zip(q, v, a, strict=True)])
    torque += v * [2.0, 0.5] + np.sign(v) * [3.0, 0.7] + a * [0.4, 0.3] + [0.1, -0.2]
    both = 0.2 * a[:, ::-1] + 0.6 * v[:, ::-1] + 1.1 * np.sign(v.sum(axis=1))[:, None]
    stamps = (time * 1e9).astype(np.int64)
    joints = JointStream(stamps, ("one", "two"), q, v, torque + both)
    write_recording(tmp_path / "run.mcap", {"joint_states": joints}, robot_description=ARM)
    structure = Structure(rotor=True, couplings=((0, 1),), dead_band=0.05)
    found = fit(open_recording(tmp_path / "run.mcap"), structure)
    truth = {
        "viscous_1": 2.0, "viscous_2": 0.5, "coulomb_1": 3.0, "coulomb_2": 0.7, "rotor_1": 0.4, "rotor_2": 0.3,
        "offset_1": 0.1, "offset_2": -0.2,
        "coupled_rotor_1_2": 0.2, "coupled_viscous_1_2": 0.6, "coupled_coulomb_1_2": 1.1,
    }  # fmt: skip
    assert found.values == pytest.approx(truth, abs=0.01)
    assert found.moving.max() < 0.01
    assert found.nominal.min() > 0.3


def test_the_published_values_of_emps_are_reproduced():
    rig = next(rig for rig in RIGS if rig.name == "emps")
    found = fit(open_recording(EXAMPLES / "emps"), rig.structure)
    published = PUBLISHED["emps"]
    for name, value in published["values"].items():
        assert found.values[name] == pytest.approx(value, rel=0.012), name
    assert found.nrmse.mean() < published["nrmse"]
    assert found.nominal.mean() > 0.5
    assert deviations(found.values, published["values"]).startswith("0.")


def test_an_answer_is_held_against_the_sealed_effects():
    refused = Answer("refused", {}, {}, {}, {}, 1.0, "poise: recording.mcap has no topic wrench: name another")
    assert judged(refused, ["viscous_friction"]) == "refused: recording.mcap has no topic wrench"
    values = {
        "viscous_friction": {"damping_2": 3.0},
        "joint_coupling": {"driving": 6.0, "driven": 5.0, "inertia": 0.01},
    }
    values["joint_coupling"] |= {"damping": 0.6, "friction": 2.0}
    answer = Answer("mixed", {"backlash": 0.39, "viscous_friction": 0.8}, {}, {}, values, 1.0, "")
    expected = "backlash 39 % (false); viscous_friction 80 %; missed coulomb_friction"
    assert judged(answer, ["viscous_friction", "coulomb_friction"]) == expected
    assert judged(answer, ["viscous_friction"], ["backlash"]) == "backlash 39 %; viscous_friction 80 %"
    found = values_of(answer)
    assert found == {
        "viscous_2": 3.0,
        "coupled_rotor_5_6": 0.01,
        "coupled_viscous_5_6": 0.6,
        "coupled_coulomb_5_6": 2.0,
    }
    assert deviations(found, {"viscous_2": 2.0, "coulomb_2": 1.0}) == "50.0 %, viscous_2 50 %"
    assert set(PUBLISHED) == {rig.name for rig in RIGS}
