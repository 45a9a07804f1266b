"""A simulator's model as the nominal one: what its file has is predicted, and what is found goes back into it."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.mismatch import diagnose, load_model, read_recording
from poise.mismatch.application import joint_values, unsure_values
from poise.mismatch.reading import dump_model, parse_model
from poise.mismatch.reading.simulator import _lightness_with_load
from poise.recording import JointStream, open_recording, write_recording

ARM = Path(__file__).resolve().parents[2] / "examples" / "simulator" / "arm.xml"
JOINTS = ("turn", "shoulder", "elbow")


def efforts(
    friction: float, armature: float, seconds: float = 14.0, damping: float = 0.3, soft: bool = False
) -> JointStream:
    """Joint states of the example's arm with other friction and rotors, by MuJoCo's inverse dynamics.

    soft: the dry friction of the elbow grows up to about its largest speed, as that of a light joint does.
    """
    spec = mujoco.MjSpec.from_file(str(ARM))
    for joint in spec.joints:
        joint.frictionloss, joint.armature = friction, armature
        joint.damping = [damping, 0.0, 0.0] if np.ndim(joint.damping) else damping
    if soft:
        spec.joint("elbow").solref_friction = [0.2, 1.0]
        spec.joint("elbow").solimp_friction = [0.1, 0.1, 0.001, 0.5, 2.0]
    model = spec.compile()
    data, times = mujoco.MjData(model), np.arange(0.0, seconds, 0.008)
    rates, sizes = np.array([[0.9, 2.1], [0.7, 1.7], [1.1, 2.3]]), np.array([[0.7, 0.3], [0.5, 0.3], [0.6, 0.3]])
    phase = rates[None] * times[:, None, None]
    q, v, a = (
        (sizes * each).sum(axis=2) for each in (np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase))
    )
    out = np.zeros_like(q)
    for row in range(len(times)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], v[row], a[row]
        mujoco.mj_inverse(model, data)
        out[row] = data.qfrc_inverse
    rng = np.random.default_rng(3)
    noise = 0.02 * rng.normal(size=out.shape)
    return JointStream(10**18 + np.round(times * 1e9).astype(np.int64), JOINTS, q, v, out + noise)


def test_a_load_makes_soft_friction_steeper_as_in_mujoco() -> None:
    """Its ramp is proportional to the lightness of the joint: a load of model.yaml counts, which the file lacks."""
    spec, mass, com = mujoco.MjSpec.from_file(str(ARM)), 1.5, [0.02, -0.01, 0.1]
    empty = spec.compile().dof_invweight0
    body, sizes = spec.body("held").add_body(), [0.004, 0.005, 0.003]
    body.mass, body.ipos, body.inertia, body.explicitinertial = mass, com, sizes, True
    laden = spec.compile().dof_invweight0
    load = InertialParameters(mass, np.array(com), np.diag(sizes))
    plain = load_model(ARM)
    found = _lightness_with_load(replace(plain, sensor_frame="ft_sensor", phi=load.phi))
    assert [found[name] for name in JOINTS] == pytest.approx(laden / empty, rel=1e-6)
    assert (laden < 0.8 * empty).any()
    assert _lightness_with_load(replace(plain, sensor_frame="ft_sensor")) == {}


def test_what_the_file_has_is_predicted_and_friction_may_be_less(tmp_path: Path) -> None:
    model = replace(load_model(ARM), payload_link="held")
    for friction, armature in ((0.2, 0.02), (0.05, 0.02)):  # as in the file; less friction
        write_recording(tmp_path / "run.mcap", {"joint_states": efforts(friction, armature)})
        read = read_recording(open_recording(tmp_path / "run.mcap"), model)
        effort = read.recorded.effort
        assert effort is not None
        assert [each.friction for each in effort.stated] == [0.2] * 3
        assert read.model.phi is not None
        assert read.model.phi[0] == pytest.approx(0.6)
        found = diagnose(read.recorded, read.model)
        if friction == 0.2:
            assert found.verdict == "none"
            continue
        assert [each.effect.name for each in found.findings] == ["coulomb_friction"]
        values = joint_values(found)
        assert [values[joint]["friction"] for joint in JOINTS] == pytest.approx([0.05] * 3, abs=0.02)


def test_dry_friction_that_looks_like_damping_is_unsure(tmp_path: Path) -> None:
    """A joint that never moves faster than its soft friction grows: another law gives other values."""
    bare = ARM.read_text().replace('damping="0.3" frictionloss="0.2"', 'damping="0" frictionloss="0"')
    (tmp_path / "arm.xml").write_text(bare)
    model = replace(load_model(tmp_path / "arm.xml"), payload_link="held")
    for soft, joints in ((False, set()), (True, {"elbow"})):
        write_recording(tmp_path / "run.mcap", {"joint_states": efforts(0.9, 0.02, 14.0, 1.0, soft)})
        read = read_recording(open_recording(tmp_path / "run.mcap"), model)
        found = diagnose(read.recorded, read.model)
        values = joint_values(found)
        unsure = unsure_values(found, values)
        assert {each.joint for each in unsure} == joints
        for each in unsure:
            true = {"friction": 0.9, "damping": 1.0}[each.kind]
            assert abs(each.value - true) < 3.0 * each.std
            assert each.joint in each.clause


def test_model_yaml_names_the_file_and_comes_back(tmp_path: Path) -> None:
    text = f"simulator: {ARM}\npayload_link: held\ngravity: 9.8\n"
    (tmp_path / "model.yaml").write_text(text)
    model = load_model(tmp_path / "model.yaml")
    assert model.simulator is not None
    assert (model.gravity, model.payload_link, model.tool_in_wrench) == (9.8, "held", True)
    (tmp_path / "again.yaml").write_text(dump_model(model))
    again = load_model(tmp_path / "again.yaml")
    assert again.simulator is not None
    assert again.simulator.joints == model.simulator.joints
    with pytest.raises(InputError, match="which is the robot"):
        parse_model({"urdf": "fr3", "simulator": str(ARM)})
    write_recording(tmp_path / "run.mcap", {"joint_states": efforts(0.2, 0.02, 5.0)})
    with pytest.raises(InputError, match="has no link hold; it has held") as caught:
        read_recording(open_recording(tmp_path / "run.mcap"), replace(model, payload_link="hold"))
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN
