"""Several objects find an order and places; the command line says it, and what is wrong with its input."""

import json

import pytest

from benchmarks.placement import scenes
from poise.assembly import Analysis
from poise.assembly.scene.scene_files import read_object, read_scene
from poise.cli import run as poise
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement import Options, plan_sequence

FLOOR = {"id": "floor", "fixed": True, "box": [1, 1, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]}
CRATE = {"id": "crate", "box": [0.3, 0.3, 0.2], "pose": [0, 0, 0.1, 0, 0, 0, 1], "mass": 4.0}


def cube(name: str, side: float, mass: float) -> dict[str, object]:
    return {"id": name, "box": [side] * 3, "mass": mass}


def test_every_step_of_a_sequence_stands_without_those_that_follow():
    items = [scenes.glued(name) for name in "adh"]
    found = plan_sequence(read_scene({"objects": [FLOOR, CRATE]}), items, Options(on="objects"), seed=4)
    assert found.order == tuple(sorted("adh", key=lambda name: -scenes.glued(name).mass))
    for number, placement in enumerate(found.placements, start=3):
        assembly = placement.analysis.assembly
        assert len(assembly.objects) == number
        assert Analysis.of(assembly).stability().margin > 0
    assert found.score.least > 0


def test_what_could_be_placed_is_said_when_not_all_can():
    """The heavy one has its centre of mass over no contact there is; the light one finds a place without it."""
    pedestal = {"id": "pedestal", "fixed": True, "box": [0.1, 0.1, 0.5], "pose": [0, 0, 0.25, 0, 0, 0, 1]}
    items = [read_object(cube("heavy", 0.1, 5.0) | {"com": [1.0, 1.1, 1.2]}), read_object(cube("light", 0.1, 1.0))]
    with pytest.raises(NoAnswerError) as error:
        plan_sequence(read_scene({"objects": [pedestal]}), items, Options(attempts=15))
    assert error.value.code is ErrorCode.NO_PLACEMENT
    assert (error.value.data["placed"], error.value.data["left"]) == (["light"], ["heavy"])


def test_more_orders_are_no_worse():
    items = [read_object(cube(name, side, mass)) for name, side, mass in (("a", 0.1, 1.0), ("b", 0.08, 0.9))]
    scene = read_scene({"objects": [FLOOR, CRATE]})
    one, three = (plan_sequence(scene, items, Options(on="objects"), 1, orders).score.least for orders in (1, 3))
    assert three >= one * 0.97


@pytest.mark.parametrize("names", [[], ["a", "a"]])
def test_objects_of_a_sequence_have_ids_of_their_own(names):
    with pytest.raises(InputError) as error:
        plan_sequence(read_scene({"objects": [FLOOR]}), [read_object(cube(name, 0.1, 1.0)) for name in names])
    assert error.value.code is ErrorCode.BAD_INPUT


def test_a_deadline_is_for_the_whole_sequence():
    items = [read_object(cube("a", 0.1, 1.0)), read_object(cube("b", 0.1, 1.0))]
    with pytest.raises(NoAnswerError) as error:
        plan_sequence(read_scene({"objects": [FLOOR]}), items, Options(deadline=1e-9))
    assert error.value.code is ErrorCode.DEADLINE


@pytest.fixture
def run(capsys, tmp_path):
    def call(*arguments: str) -> tuple[int, dict, str]:
        target = tmp_path / "answer.json"
        status = poise(["place", *arguments, "--json", str(target)])
        answer = json.loads(target.read_text()) if target.exists() else {}
        return status, answer, capsys.readouterr().err

    return call


SCENE = str(scenes.FOLDER / "cube.yaml")


def test_the_command_places_several(run):
    objects = ["{id: a, box: [0.05, 0.05, 0.05], mass: 0.1}", "{id: b, box: [0.04, 0.04, 0.04], mass: 0.2}"]
    status, answer, _ = run(SCENE, "--object", objects[0], "--object", objects[1])
    assert status == 0
    assert answer["order"] == ["b", "a"]
    assert [len(one["pose"]) for one in answer["placements"]] == [7, 7]
    assert answer["robustness"] > 0


def test_the_command_runs_a_rival(run):
    status, answer, _ = run(SCENE, "--object", "{box: [0.05, 0.05, 0.05], mass: 0.1}", "--planner", "hm")
    assert status == 0
    assert len(answer["pose"]) == 7


@pytest.mark.parametrize(
    ("spec", "more", "status", "says"),
    [
        ("{box: [0.1, 0.1, 0.1]}", [], 2, "mass"),
        ("{mesh: open.obj, mass: 1}", [], 2, "open.obj"),
        ("{mesh: flat.obj, mass: 1}", [], 2, "flat.obj"),
        ("{mesh: none.obj, mass: 1}", [], 2, "none.obj"),
        ("{box: [0.1, 0.1, 0.1], mass: 1}", ["--planner", "best"], 2, "best"),
        ("{box: [0.1, 0.1, 0.1], mass: 1}", ["--deadline", "1e-9"], 3, "deadline"),
        ("{id: cube, box: [0.1, 0.1, 0.1], mass: 1}", [], 2, "cube"),
    ],
)  # fmt: skip
def test_what_cannot_be_placed_is_said(run, tmp_path, monkeypatch, spec, more, status, says):
    monkeypatch.chdir(tmp_path)
    corners = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n"
    (tmp_path / "open.obj").write_text(corners + "f 1 3 2\nf 1 2 4\n")
    (tmp_path / "flat.obj").write_text(corners + "f 1 2 3\nf 1 3 2\n")
    found, _, complaint = run(SCENE, "--object", spec, *more)
    assert found == status
    assert says in complaint


def test_no_place_says_which_test_rejected_how_many(run, tmp_path):
    """A plate larger than the shaft it would have to go into, and nothing else to stand on."""
    walls = [
        {"id": name, "fixed": True, "box": size, "pose": [*at, 0, 0, 0, 1]}
        for name, size, at in (
            ("bottom", [0.2, 0.2, 0.02], [0, 0, -0.01]),
            ("top", [0.6, 0.6, 0.02], [0, 0, 0.31]),
            ("left", [0.02, 0.6, 0.3], [-0.11, 0, 0.15]),
            ("right", [0.02, 0.6, 0.3], [0.11, 0, 0.15]),
        )
    ]
    lid = {"id": "lid", "fixed": True, "box": [2.0, 2.0, 0.02], "pose": [0, 0, 0.36, 0, 0, 0, 1]}
    path = tmp_path / "shaft.yaml"
    path.write_text(json.dumps({"objects": [*walls, lid]}))
    status, answer, _ = run(str(path), "--object", "{box: [3, 3, 3], mass: 1, com: [2, 2, 2]}", "--attempts", "25")
    assert status == 3
    assert answer["error"] == "NO_PLACEMENT"
    assert sum(answer["rejected"].values()) == answer["iterations"] == 25


def test_an_assembly_that_falls_is_refused_and_left_alone(run, tmp_path):
    path = tmp_path / "falls.yaml"
    upper = {**CRATE, "id": "upper", "pose": [0.2, 0, 0.3, 0, 0, 0, 1]}
    path.write_text(json.dumps({"objects": [FLOOR, CRATE, upper]}))
    before = path.read_text()
    status, answer, _ = run(str(path), "--object", "{box: [0.1, 0.1, 0.1], mass: 1}")
    assert (status, answer["error"], answer["objects"]) == (3, "UNSTABLE", ["upper"])
    assert path.read_text() == before
