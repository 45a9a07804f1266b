"""Free runs in MuJoCo: the model that made a recording repeats it, a wrong one does not, and drives are found."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.mismatch.application import recorded_run
from poise.recording import JointStream, WrenchStream, open_recording, write_recording
from poise.simulation.rollout import (
    FreeArm,
    RolloutOptions,
    drives_by_effort,
    fit_drives,
    rolled_out,
    share_removed,
)

STEP, RATE, SECONDS = 1e-3, 200, 14.0
NAMES = ("upper", "lower")
MJCF = """<mujoco><!-- two joints, position drives, a sensor --><option timestep="0.001"/><worldbody>
<body name="a"><joint name="upper" axis="0 1 0" damping="0.4" frictionloss="{friction}" armature="0.05"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="2"/>
<body name="b" pos=".4 0 0"><joint name="lower" axis="0 1 0" damping="0.2" armature="0.03"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/>
<body name="held" pos=".3 0 0"><site name="ft"/><geom size=".03" mass="{mass}"/></body>
<body name="finger"><joint name="grip" type="slide"/><geom size=".01" mass=".05"/></body></body></body></worldbody>
<actuator><position name="one" joint="upper" kp="{kp}" kv="8"{delay}/><position joint="lower" kp="{kp}" kv="6"{delay}/>
<motor joint="grip"/></actuator>
<sensor><force site="ft" noise=".05"/><torque site="ft"/><jointpos joint="grip"/></sensor>
<contact><exclude body1="a" body2="b"/><exclude body1="b" body2="held"/><exclude body1="b" body2="finger"/>
<exclude body1="held" body2="finger"/></contact></mujoco>"""
NOMINAL = MJCF.format(friction=0.3, mass=0.5, kp=150, delay="")
TRUE = MJCF.format(friction=1.2, mass=0.5, kp=100, delay=' delay="0.02" nsample="25"')


def commands(seconds: np.ndarray) -> np.ndarray:
    return np.stack(
        [0.6 * np.sin(1.3 * seconds) + 0.2 * np.sin(3.1 * seconds), 0.5 * np.sin(1.9 * seconds + 1.0)], axis=1
    )


def simulated(xml: str) -> dict[str, JointStream | WrenchStream]:
    """Commands at 1 kHz, joint states and the wrench of a model under them."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, rows = mujoco.MjData(model), []
    data.qpos[:2] = commands(np.zeros(1))[0]
    for step in range(round(SECONDS / STEP)):
        data.ctrl[:2] = commands(np.array([step * STEP]))[0]
        state = [[step * STEP], data.qpos[:2].copy(), data.qvel[:2].copy()]
        mujoco.mj_step(model, data)
        if step % round(1 / RATE / STEP) == 0:
            rows.append(np.concatenate([*state, data.actuator_force[:2], -data.sensordata[:6]]))
    values, sent = np.array(rows), np.arange(round(SECONDS / STEP)) * STEP
    stamps, nothing = 10**18 + np.round(values[:, 0] * 1e9).astype(np.int64), np.full((len(sent), 2), np.nan)
    order = 10**18 + np.round(sent * 1e9).astype(np.int64)
    return {
        "joint_states": JointStream(stamps, NAMES, values[:, 1:3], values[:, 3:5], values[:, 5:7]),
        "joint_commands": JointStream(order, NAMES, commands(sent), nothing, nothing),
        "wrench": WrenchStream(stamps, values[:, 7:], "ft"),
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the true model, with and without efforts, and both models."""
    place = tmp_path_factory.mktemp("rollout")
    streams = simulated(TRUE)
    joints = streams["joint_states"]
    assert isinstance(joints, JointStream)
    write_recording(place / "run.mcap", streams)
    silent = JointStream(joints.stamps, NAMES, joints.position, joints.velocity, np.full(joints.position.shape, np.nan))
    alone = {"joint_states": silent, "joint_commands": streams["joint_commands"]}
    write_recording(place / "silent.mcap", alone)
    (place / "nominal.xml").write_text(NOMINAL)
    (place / "true.xml").write_text(TRUE)
    return place


def test_the_model_that_made_a_recording_repeats_its_motion_and_wrench(folder: Path, tmp_path: Path) -> None:
    words = ["rollout", str(folder / "nominal.xml"), str(folder / "true.xml"), "--commands", str(folder / "run.mcap")]
    assert run([*words, "--windows", "0.1,1,3", "--report", str(tmp_path), "--json", str(tmp_path / "r.json")]) == 0
    found = json.loads((tmp_path / "r.json").read_text())
    assert found["joints"] == list(NAMES)
    for before, after in zip(*(model["windows"] for model in found["models"]), strict=True):
        assert after["error"] < 0.05 * before["error"]
        assert after["force"] < 0.2 * before["force"]
        assert after["diverged"] == 0
    assert all(share > 0.95 for share in found["removed"].values())
    assert found["models"][0]["inputs"] == dict.fromkeys(NAMES, "position command")
    page = (tmp_path / "rollout.html").read_text()
    assert "<svg" in page
    assert "http" not in page.replace("http://www.w3.org", "").replace("http-equiv", "")


def test_efforts_drive_a_model_as_commands_do(folder: Path) -> None:
    recorded = recorded_run(open_recording(folder / "run.mcap"))
    errors = []
    for name in ("nominal", "true"):
        arm = FreeArm(folder / f"{name}.xml", recorded, "efforts")
        assert set(arm.driven.values()) == {"effort"}
        errors.append(rolled_out(arm, RolloutOptions((0.5,), 10)).horizons)
    assert share_removed(*errors)[0.5] > 0.9


def test_gains_and_delays_come_back_from_efforts(folder: Path) -> None:
    arm = FreeArm(folder / "nominal.xml", recorded_run(open_recording(folder / "run.mcap")))
    found = drives_by_effort(arm)
    assert [each.joint for each in found] == list(NAMES)
    for each, rate in zip(found, (8.0, 6.0), strict=True):
        assert each.kept
        assert each.values["gain"].value == pytest.approx(100.0, rel=0.01)
        assert each.values["rate_gain"].value == pytest.approx(rate, rel=0.05)
        assert each.values["delay"].value == pytest.approx(0.02, abs=0.003)


def test_drives_come_closer_from_commands_and_motion_alone(folder: Path) -> None:
    recorded = recorded_run(open_recording(folder / "silent.mcap"))
    found = fit_drives(FreeArm(folder / "nominal.xml", recorded))
    for each in found:
        assert each.kept
        assert each.after < 0.2 * each.before
    upper = found[0].values
    assert upper["gain"].value == pytest.approx(100.0, rel=0.15)
    assert upper["delay"].value == pytest.approx(0.02, abs=0.006)
    assert upper["friction"].value == pytest.approx(1.2, rel=0.2)


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("<robot/>", ErrorCode.UNSUPPORTED, "need a model of MuJoCo"),
        (
            NOMINAL.replace('"upper"', '"Upper"').replace('"lower"', '"lower_"'),
            ErrorCode.JOINT_MISSING,
            "lower ~ lower_",
        ),
        (NOMINAL.replace("<actuator>", "<actuator><!--").replace("</actuator>", "--></actuator>"), None, ""),
    ],
)
def test_models_that_cannot_run(folder: Path, tmp_path: Path, text: str, code: ErrorCode | None, said: str) -> None:
    (tmp_path / "m.xml").write_text(text)
    recorded = recorded_run(open_recording(folder / "run.mcap"))
    if code is None:  # without drives the efforts are used
        assert set(FreeArm(tmp_path / "m.xml", recorded).driven.values()) == {"effort"}
        with pytest.raises(InputError, match="nothing drives the joint upper"):
            FreeArm(tmp_path / "m.xml", recorded_run(open_recording(folder / "silent.mcap")))
        return
    with pytest.raises(InputError, match=said):
        FreeArm(tmp_path / "m.xml", recorded)


@pytest.mark.parametrize(
    "words", [["--windows", "0,1"], ["--windows", "a"], ["--inputs", "both"], ["--windows", "100"]]
)
def test_bad_options_are_refused(folder: Path, words: list[str]) -> None:
    assert run(["rollout", str(folder / "true.xml"), "--commands", str(folder / "run.mcap"), *words]) == 2
