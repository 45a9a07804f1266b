"""Scenes that are possible and probably wrong have a finding; ordinary ones have none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from poise.assembly import Assembly, Box, FrictionPair, RigidObject, load_scene
from poise.assembly.scene import scene_findings
from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose

SCENES = Path(__file__).parents[2] / "docs" / "scenes"
FLOOR = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)


def cube(mass: float = 1.0, turn: np.ndarray | None = None) -> RigidObject:
    pose = Pose(np.eye(3) if turn is None else turn, np.array([0.0, 0.0, 0.05]))
    return RigidObject("cube", Box((0.1, 0.1, 0.1)), pose, mass=mass)


ABOUT_CORNER = np.full((3, 3), -0.0025) + np.diag(np.full(3, 0.0025 + 0.02 / 3))
"""kg m2, of the cube of 1 kg and 0.1 m."""


def test_an_inertia_at_the_bound_of_what_a_shape_holds_is_no_finding() -> None:
    halves_at_ends = np.diag([0.0025, 0.0025, 0.0])
    assert scene_findings(Assembly((FLOOR, replace(cube(), inertia=halves_at_ends)))) == ()


@pytest.mark.parametrize(
    "scene", [*SCENES.glob("*.yaml"), *SCENES.glob("placement/*.yaml")], ids=lambda path: path.name
)
def test_the_scenes_of_the_pages_have_no_finding(scene: Path) -> None:
    assert scene_findings(load_scene(scene)) == ()


@pytest.mark.parametrize(
    ("assembly", "word"),
    [
        (Assembly((FLOOR, cube()), friction=3.0), "friction"),
        (Assembly((FLOOR, cube()), friction_pairs=(FrictionPair(("floor", "cube"), 2.5),)), "floor and cube"),
        (Assembly((FLOOR, cube()), friction=0.0), "incline"),
        (Assembly((FLOOR, cube(mass=15.0))), "denser than lead"),
        (Assembly((FLOOR, cube(mass=0.0002))), "lighter"),
        (Assembly((FLOOR, cube(turn=np.diag([1.0, -1.0, -1.0])))), "x y z w"),
        (Assembly((FLOOR, cube(mass=1.5e-6))), "lengths in cm would give 1.5e+03 kg/m3"),
        (Assembly((FLOOR, cube()), gravity=np.array([0.0, -9.81, 0.0])), "upwards"),
        (Assembly((FLOOR, cube()), gravity=np.array([0.0, 0.0, -1.0])), "gravity is 1 m/s2"),
        (Assembly((FLOOR, replace(cube(), com=np.full(3, 0.05)))), "not inside the shape"),
        (Assembly((FLOOR, replace(cube(), inertia=ABOUT_CORNER))), "about the centre of mass"),
        (Assembly((FLOOR, cube(), replace(cube(), id="b", shape=Box((0.1, 0.1, 0.2))))), "all weigh 1 kg"),
        (Assembly((FLOOR, replace(cube(), pose=Pose.identity(), pose_covariance=np.eye(6) / 1e6))), "the default"),
    ],
)
def test_what_is_probably_wrong_is_said(assembly: Assembly, word: str) -> None:
    (found,) = scene_findings(assembly)
    assert word in found.sentence


def test_findings_are_in_the_answer_and_a_push_on_what_is_fixed_is_one(tmp_path: Path, capsys) -> None:
    scene = {
        "friction": 3.0,
        "objects": [
            {"id": "floor", "fixed": True, "box": [2, 2, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]},
            {"id": "a", "box": [0.1, 0.1, 0.1], "mass": "1e-1", "pose": [0, 0, 0.05, 0, 0, 0, 1]},
        ],
    }
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    pushes = [{"object": name, "point": [0, 0, z], "direction": [1, 0, 0]} for name, z in (("a", 0.1), ("floor", 0.0))]
    (tmp_path / "pushes.yaml").write_text(yaml.safe_dump(pushes))
    command = ["robustness", str(tmp_path / "scene.yaml"), "--queries", str(tmp_path / "pushes.yaml"), "--json", "-"]
    assert run(command) == 0
    output = capsys.readouterr()
    answer = json.loads(output.out)
    assert [found["name"] for found in answer["findings"]] == ["IMPLAUSIBLE", "IMPLAUSIBLE"]
    assert "floor is fixed" in output.err
    assert answer["queries"][1]["robustness"] == "inf"


def test_what_floats_is_named_with_its_distance() -> None:
    from poise.assembly import Analysis

    high = RigidObject("b", Box((0.1, 0.1, 0.1)), Pose(np.eye(3), np.array([0.0, 0.0, 0.1523])), mass=1.0)
    with pytest.raises(InputError, match=r"b is 2\.3 mm from cube") as caught:
        Analysis.of(Assembly((FLOOR, cube(), high)))
    assert caught.value.code == ErrorCode.FLOATING
