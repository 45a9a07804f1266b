"""`poise carry`: a plan that a program can play, a picture, and one line for everything that cannot be."""

import json
from pathlib import Path

import numpy as np
import pytest

from poise.assembly import load_scene
from poise.cli import run
from poise.geometry import Pose
from poise.manipulation import Arm
from poise.manipulation.bodies import se3_of

SCENE = str(Path(__file__).resolve().parents[2] / "docs" / "scenes" / "placement" / "cube.yaml")
CAN = "{id: can, cylinder: [0.03, 0.1], mass: 0.3, pose: [-0.1, -0.42, 0.05, 0, 0, 0, 1]}"
BASE = ["--base", "-0.5", "0", "0", "0"]


def test_the_plan_ends_with_the_object_where_it_stays(tmp_path, capsys):
    plan, scene, picture = (tmp_path / name for name in ("plan.json", "after.yaml", "carry.png"))
    more = ["--json", str(plan), "--save", str(scene), "--picture", str(picture), "--seed", "1", "--seconds", "300"]
    assert run(["carry", SCENE, "--object", CAN, *BASE, "--on", "objects", *more]) == 0
    answer = json.loads(plan.read_text())
    arm = Arm.load("fr3", Pose.from_vector([-0.5, 0, 0, 0, 0, 0, 1]))
    assert answer["joint_names"] == list(arm.joint_names)
    phases = {phase["name"]: phase for phase in answer["phases"]}
    assert list(phases) == ["reach", "approach", "lift", "carry", "lower", "retreat", "return"]
    assert [phase["holding"] for phase in phases.values()] == [False, False, True, True, True, False, False]
    tool = arm.tool(np.array(phases["lower"]["motions"][-1]["position"][-1]))
    item = tool * se3_of(Pose.from_vector(answer["grasp"]["object_tcp"])).inverse()
    np.testing.assert_allclose(item.translation, answer["pose"][:3], atol=1e-4)
    placed = {item.id: item for item in load_scene(scene).objects}["can"]
    np.testing.assert_allclose(placed.pose.vector, answer["pose"], atol=1e-9)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "can: stable at" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--object", "{cylinder: [0.03, 0.1], mass: 0.3}"], 2, "pose is missing"),
        (["--object", CAN.replace("can", "cube")], 2, "id that is not in the scene"),
        (["--object", CAN.replace("-0.42, 0.05", "0.0, 0.05").replace("-0.1", "0.0")], 2, "cube"),
        (["--object", CAN, "--robot", "no_such.urdf"], 2, "no_such.urdf"),
        (["--object", CAN, "--tcp", "nowhere"], 2, "nowhere"),
        (["--object", CAN, "--keep-free", "0", "0", "0", "1", "1", "0"], 2, "room to be kept free"),
        (["--object", CAN, "--base", "-9", "0", "0", "0", "--attempts", "10"], 3, "cannot be picked up"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments, status, words, tmp_path, capsys):
    assert run(["carry", SCENE, *arguments]) == status
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert words in said[0]
