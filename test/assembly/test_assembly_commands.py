"""The commands robustness, msa and disassemble: fields of the contract, and one numbered error for what goes wrong."""

import json

import assembly_scenes as scenes
import numpy as np
import pytest
import typer
import yaml
from typer.testing import CliRunner

from poise.assembly import load_scene, write_scene
from poise.assembly.scene.scene_files import read_scene, scene_content
from poise.commands.assembly import disassemble, msa, robustness
from poise.commands.sensitivity import sensitivity
from poise.errors import ErrorCode, InputError, NoAnswerError

app = typer.Typer(pretty_exceptions_enable=False)
for command in (robustness, msa, disassemble, sensitivity):
    app.command()(command)


def strictly(text):
    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a command on a scene in an empty folder; what it raises comes through."""
    monkeypatch.chdir(tmp_path)

    def attempt(name, assembly, *arguments):
        write_scene(assembly, tmp_path / "scene.yaml")
        found = CliRunner().invoke(app, [name, "scene.yaml", *arguments])
        if found.exception is not None and not isinstance(found.exception, SystemExit):
            raise found.exception
        return found

    return attempt


def write_queries(tmp_path, queries):
    path = tmp_path / "queries.json"
    path.write_text(json.dumps(queries))
    return str(path)


def test_robustness_writes_the_fields_of_the_contract(run, tmp_path):
    queries = [
        {"object": "cube", "point": [-0.5, 0, 0.1], "direction": [1, 0, 0]},
        {"object": "cube", "point": [0, 0, 1], "direction": [0, 0, -1]},
    ]
    run("robustness", scenes.cube(), "--queries", write_queries(tmp_path, queries), "--json", "answer.json")
    answer = strictly((tmp_path / "answer.json").read_text())
    assert answer["stable"] is True
    assert answer["seconds"] > 0
    first, second = answer["queries"]
    assert first["robustness"] == pytest.approx(0.5 * scenes.G)
    assert first["lower"] <= first["robustness"] <= first["upper"]
    assert (first["mode"], first["moves"]) == ("slip", ["cube"])
    assert (second["robustness"], second["moves"]) == ("inf", [])
    assert answer["contacts"][0]["gap"] == pytest.approx(0, abs=1e-12)


def test_an_unstable_scene_is_written_as_such_and_ends_without_an_answer(run, tmp_path):
    with pytest.raises(NoAnswerError) as caught:
        run("robustness", scenes.between_walls(with_floor=False), "--json", "answer.json")
    assert caught.value.code is ErrorCode.UNSTABLE
    assert caught.value.exit_status == 3
    assert strictly((tmp_path / "answer.json").read_text())["stable"] is False


def test_a_map_is_written_beside_the_call(run, tmp_path):
    run("robustness", scenes.cube(), "--map", "--points", "200")
    found = strictly((tmp_path / "scene_map.json").read_text())
    assert len(found["points"]) == len(found["lower"]) == len(found["objects"])
    assert found["complete"] is True


@pytest.mark.parametrize("directions", ["4", "file"])
def test_msa_writes_a_limit_for_each_direction(run, tmp_path, directions):
    if directions == "file":
        (tmp_path / "directions.json").write_text("[[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]]")
        directions = "directions.json"
    run("msa", scenes.cube(), "--directions", directions, "--json", "limits.json")
    found = strictly((tmp_path / "limits.json").read_text())
    assert len(found["directions"]) == len(found["limits"]) == len(found["first_to_move"]) == 4
    assert found["limits"][0] == pytest.approx(0.5 * scenes.G)
    assert found["first_to_move"][0] == ["cube"]


def test_disassemble_writes_order_and_safety(run, tmp_path):
    run("disassemble", scenes.stack(3), "--json", "order.json")
    found = strictly((tmp_path / "order.json").read_text())
    assert found["order"] == ["c2", "c1", "c0"]
    assert found["safe"] == [True, True, True]


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("not json", ErrorCode.FILE_CORRUPT),
        ("{}", ErrorCode.BAD_INPUT),
        ('[{"object": "cube"}]', ErrorCode.BAD_INPUT),
        ('[{"object": 3, "point": [0, 0, 1], "direction": [0, 0, 1]}]', ErrorCode.BAD_INPUT),
        ('[{"object": "ghost", "point": [0, 0, 1], "direction": [0, 0, 1]}]', ErrorCode.OBJECT_UNKNOWN),
        ('[{"object": "cube", "point": [0, 0, 9], "direction": [0, 0, 1]}]', ErrorCode.POINT_OFF_SURFACE),
    ],
)
def test_bad_queries_are_refused(run, tmp_path, content, code):
    (tmp_path / "queries.json").write_text(content)
    with pytest.raises(InputError) as caught:
        run("robustness", scenes.cube(), "--queries", "queries.json")
    assert caught.value.code is code


def test_queries_and_map_together_are_refused(run, tmp_path):
    with pytest.raises(InputError, match="exclude each other"):
        run("robustness", scenes.cube(), "--map", "--queries", write_queries(tmp_path, []))


def test_scenes_written_here_are_plain_yaml(run, tmp_path):
    run("disassemble", scenes.cube())
    assert yaml.safe_load((tmp_path / "scene.yaml").read_text())["objects"][1]["box"] == [1.0, 1.0, 1.0]


def test_answers_are_drawn_where_asked(run, tmp_path):
    path = write_queries(tmp_path, [{"object": "cube", "point": [-0.5, 0, 0.1], "direction": [1, 0, 0]}])
    assert run("robustness", scenes.cube(), "--queries", path, "--picture", "push.svg").exit_code == 0
    assert "slip" in (tmp_path / "push.svg").read_text()
    assert run("robustness", scenes.cube(), "--map", "--points", "100", "--picture", "map.png").exit_code == 0
    assert (tmp_path / "map.png").stat().st_size > 1000
    assert run("msa", scenes.cube(), "--directions", "8", "--picture", "limits.svg").exit_code == 0
    assert "cube" in (tmp_path / "limits.svg").read_text()
    with pytest.raises(InputError) as raised:
        run("msa", scenes.cube(), "--picture", str(tmp_path))
    assert raised.value.code == ErrorCode.FILE_UNWRITABLE
    # What falls is drawn all the same, as it stands.
    with pytest.raises(NoAnswerError):
        run(
            "robustness",
            scenes.on_floor(scenes.box("post", (1, 1, 1), (0, 0, 0.5), com=(0.6, 0, 0))),
            "--picture",
            "graph.svg",
        )
    assert "post" in (tmp_path / "graph.svg").read_text()


def low_push(tmp_path, *entries):
    path = tmp_path / "pushes.json"
    path.write_text(json.dumps(list(entries)))
    return str(path)


LOW = {"object": "cube", "point": [-0.5, 0, 0.1], "direction": [1, 0, 0]}


def test_forces_in_a_list_of_their_own_grow_together(run, tmp_path):
    """A hand on top that presses as hard as another pushes: F = mu (W + F)."""
    hand = {"object": "cube", "point": [0, 0, 1], "direction": [0, 0, -1]}
    found = run("robustness", scenes.cube(0.5), "--queries", low_push(tmp_path, [LOW, hand], LOW), "--json", "-")
    alone, together = 0.5 * scenes.G, 0.5 * scenes.G / (1 - 0.5)
    values = [query["robustness"] for query in strictly(found.stdout)["queries"]]
    assert values == pytest.approx([together, alone], rel=1e-6)


@pytest.mark.parametrize("model", ["thesis", "approx", "lp8"])
def test_models_to_compare_with_are_asked_by_name(run, tmp_path, model):
    found = run("robustness", scenes.cube(0.5), "--queries", low_push(tmp_path, LOW), "--model", model, "--json", "-")
    query = strictly(found.stdout)["queries"][0]
    assert query["robustness"] == pytest.approx(0.5 * scenes.G, rel=0.1)
    assert query["moves"] == ["cube"]


def test_derivatives_are_those_of_mu_m_g(run, tmp_path):
    found = run("sensitivity", scenes.cube(0.5), "--queries", low_push(tmp_path, LOW), "--json", "-")
    query = strictly(found.stdout)["queries"][0]
    assert query["mass"]["cube"] == pytest.approx(0.5 * scenes.G, rel=1e-5)
    assert query["friction"] == [{"objects": ["floor", "cube"], "derivative": pytest.approx(scenes.G, rel=1e-5)}]


def test_a_push_as_hard_as_friction_holds_moves_half_of_the_time(run, tmp_path):
    options = ("--force", str(0.5 * scenes.G), "--friction-deviation", "0.05", "--samples", "200", "--json", "-")
    found = run("sensitivity", scenes.cube(0.5), "--queries", low_push(tmp_path, LOW), *options)
    query = strictly(found.stdout)["queries"][0]
    assert query["probability"] == pytest.approx(0.5, abs=0.12)
    assert query["samples"] == 200


def test_sensitivity_refuses_several_forces_at_once(run, tmp_path):
    with pytest.raises(InputError, match="single pushes"):
        run("sensitivity", scenes.cube(), "--queries", low_push(tmp_path, [LOW, LOW]))


def test_a_sensitivity_that_another_collapse_decides_is_doubtful_in_text_and_json(run, tmp_path):
    """A push at the side of a cube turns it; limit analysis lets its corners carry the weight, which holds more."""
    turning = low_push(tmp_path, LOW | {"point": [-0.5, 0.45, 0.01]})
    query = strictly(run("sensitivity", scenes.cube(), "--queries", turning, "--json", "-").stdout)["queries"][0]
    assert query["doubtful"]
    assert query["robustness"] < 0.9 * query["limit"]
    assert "doubtful" in run("sensitivity", scenes.cube(), "--queries", turning).stdout
    plain = strictly(run("sensitivity", scenes.cube(), "--queries", low_push(tmp_path, LOW), "--json", "-").stdout)
    assert not plain["queries"][0]["doubtful"]


def test_uncertain_poses_are_settled_and_answers_have_intervals(run, tmp_path):
    seen = scenes.on_floor(scenes.box("b", (0.2, 0.2, 0.1), (0, 0, 0.053)))
    queries = write_queries(tmp_path, [{"object": "b", "point": [-0.1, 0, 0.06], "direction": [1, 0, 0]}])
    with pytest.raises(InputError, match="nothing holds b"):
        run("robustness", seen, "--queries", queries)
    found = run(
        "robustness", seen, "--queries", queries, "--pose-std", "2mm,0.5deg", "--samples", "9", "--json", "a.json"
    )
    answer = strictly((tmp_path / "a.json").read_text())
    (move,) = answer["settled"]["moves"]
    assert move["translation"][2] == pytest.approx(-0.003, abs=1e-6)
    assert move["sigmas"] == pytest.approx(1.5, abs=1e-3)
    assert answer["settled"]["samples"] == 9
    low, high = answer["queries"][0]["interval"]
    assert low <= answer["queries"][0]["robustness"] <= high
    assert "moved mm" in found.stdout
    assert "interval N" in found.stdout
    assert "1 poses settled" in found.stderr
    assert answer["settled"]["taken_as_exact"] == ["masses", "friction"]
    assert "intervals leave out errors of masses and friction" in " ".join(found.stderr.split())
    limits = run("msa", seen, "--directions", "4", "--pose-std", "0.2cm,0.01rad")
    assert limits.exit_code == 0


def test_a_scene_states_how_well_masses_and_friction_are_known(run, tmp_path):
    content = {**scene_content(scenes.cube()), "mass_std": 0.1, "friction_deviation": 0.05}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    read = load_scene(tmp_path / "scene.yaml")
    cube = next(item for item in read.objects if not item.fixed)
    assert np.sqrt(cube.covariance[0, 0]) == pytest.approx(0.1 * cube.mass)
    assert scene_content(read)["friction_deviation"] == 0.05
    queries = write_queries(
        tmp_path, [{"object": cube.id, "point": (cube.com_in_world - [0.5, 0, 0]).tolist(), "direction": [1, 0, 0]}]
    )
    arguments = "--queries", queries, "--pose-std", "1mm,0.1deg", "--samples", "9", "--json", "a.json"
    found = run("robustness", read, *arguments)
    answer = strictly((tmp_path / "a.json").read_text())
    assert answer["settled"]["taken_as_exact"] == []
    assert "leave out" not in found.stderr
    low, high = answer["queries"][0]["interval"]
    assert low < 0.97 * answer["queries"][0]["robustness"] < high / 1.03


@pytest.mark.parametrize("entry", [{"mass_std": -0.1}, {"mass_std": 1.5}, {"friction_deviation": -0.1}])
def test_a_deviation_that_is_none_is_refused(entry):
    with pytest.raises(InputError, match=r"mass_std|friction_deviation"):
        read_scene({**scene_content(scenes.cube()), **entry})


@pytest.mark.parametrize("words", ["2mm", "2,0.5", "2mm,0.5", "x mm,1deg", "-1mm,0deg", "2mm,90deg"])
def test_a_pose_std_that_is_none_is_refused(run, words):
    with pytest.raises(InputError, match=r"pose.std"):
        run("robustness", scenes.cube(), "--pose-std", words)
