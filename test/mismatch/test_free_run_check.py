"""What of an export makes free runs worse is left out: one joint in MuJoCo, whose recording its own model made."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from poise.mismatch.application import recorded_run, worsening
from poise.recording import JointStream, open_recording, write_recording

MODEL = """<mujoco><option timestep="0.002"/><worldbody><body><joint name="j" axis="0 1 0" damping="{damping}"
armature="{armature}"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body></worldbody>
<actuator><position name="a" joint="j" kp="60" kv="4"/></actuator></mujoco>"""
BEFORE, TRUE, WRONG = {"damping": 0.2, "armature": 0.02}, {"damping": 2.0}, {"armature": 0.8}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 12 s, of a joint with more damping than the model before has."""
    path = tmp_path_factory.mktemp("runs")
    (path / "before.xml").write_text(MODEL.format(**BEFORE))
    model = mujoco.MjModel.from_xml_string(MODEL.format(**(BEFORE | TRUE)))
    data, rows = mujoco.MjData(model), []
    for step in range(6000):
        data.ctrl[0] = 0.8 * np.sin(2.5 * step * 0.002)
        rows.append([step * 0.002, data.ctrl[0], data.qpos[0], data.qvel[0]])
        mujoco.mj_step(model, data)
    seconds, sent, position, velocity = np.array(rows).T[:, :, None]
    stamps, none = 10**18 + np.round(seconds[:, 0] * 1e9).astype(np.int64), np.full_like(sent, np.nan)
    states = JointStream(stamps, ("j",), position, velocity, none)
    write_recording(
        path / "run.mcap", {"joint_states": states, "joint_commands": JointStream(stamps, ("j",), sent, none, none)}
    )
    return path


def writer(changes: dict[str, float]) -> Callable[[tuple[str, ...]], bytes]:
    def written(lost: tuple[str, ...]) -> bytes:
        kept = {name: value for name, value in changes.items() if name not in lost}
        return MODEL.format(**(BEFORE | kept)).encode()

    return written


def checked(folder: Path, changes: dict[str, float]) -> tuple[tuple[str, ...], str]:
    run = recorded_run(open_recording(folder / "run.mcap"))
    found = worsening(run, folder / "before.xml", tuple(changes), writer(changes), folder)
    assert sorted(path.name for path in folder.iterdir()) == ["before.xml", "run.mcap"]
    return found.kinds, found.reason


def test_what_is_right_is_written(folder: Path) -> None:
    assert checked(folder, TRUE) == ((), "")


def test_what_makes_free_runs_worse_is_left_out_and_the_rest_is_kept(folder: Path) -> None:
    kinds, reason = checked(folder, TRUE | WRONG)
    assert kinds == ("armature",)
    assert "times as far off" in reason
    assert checked(folder, WRONG)[0] == ("armature",)


def test_a_model_that_does_not_run_is_not_compared(folder: Path) -> None:
    run = recorded_run(open_recording(folder / "run.mcap"))
    found = worsening(run, folder / "before.xml", ("damping",), lambda _: b"<mujoco><nonsense/></mujoco>", folder)
    assert found.kinds == ()
