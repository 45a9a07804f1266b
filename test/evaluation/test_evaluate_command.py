"""`poise evaluate` as a person calls it: goes on after a kill, gives the same answers with any number of workers."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from poise.cli import run
from poise.commands.evaluate import read_plan
from poise.commands.evaluate_worker import run_job
from poise.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "bags" / "kuka_static_poses.mcap"
SCENE = """
friction: 0.5
objects:
  - {{id: floor, fixed: true, box: [2, 2, 0.1], pose: [0, 0, -0.05, 0, 0, 0, 1]}}
  - {{id: crate, box: [1, 1, 1], pose: [0, 0, 0.5, 0, 0, 0, 1], mass: {mass}}}
"""
PUSH = [{"object": "crate", "point": [-0.5, 0, 0.2], "direction": [1, 0, 0]}]


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """Twelve scenes with a crate of 1 to 12 kg, that slips under half of its weight, and one file that is none."""
    folder = tmp_path / "scenes"
    folder.mkdir()
    for mass in range(1, 13):
        (folder / f"crate_{mass:02}.yaml").write_text(SCENE.format(mass=mass))
        (folder / f"crate_{mass:02}.truth.yaml").write_text(f"queries: [{{robustness: {0.5 * 9.80665 * mass}}}]")
    (folder / "broken.yaml").write_text("objects: [")
    (tmp_path / "pushes.json").write_text(json.dumps(PUSH))
    return folder


def arguments(scenes: Path, *more: str) -> list[str]:
    return ["evaluate", "robustness", str(scenes), "--queries", str(scenes.parent / "pushes.json"), *more]


def answers(folder: Path) -> list[dict]:
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()[1:]]
    for line in lines:
        for entry in (line, line["answer"] or {}):
            entry.pop("seconds", None)
    return sorted(lines, key=lambda line: line["name"])


def test_any_number_of_workers_gives_the_same_answers_and_one_bad_file_stops_none(scenes, tmp_path, capsys) -> None:
    assert run(arguments(scenes, "--workers", "1", "--results", str(tmp_path / "one"))) == 2
    printed = capsys.readouterr().out
    target = tmp_path / "two.json"
    assert run(arguments(scenes, "--workers", "2", "--json", str(target))) == 2
    two = {entry["bag"]: entry for entry in json.loads(target.read_text())["recordings"]}
    for entry in answers(tmp_path / "one"):
        other = two[entry["name"]]
        other.pop("seconds", None)
        assert other == {"bag": entry["name"]} | (entry["answer"] or {"error": other.get("error")})
    assert "12 of 13 answered" in printed
    assert "1 FILE_CORRUPT" in printed
    assert "queries.0.robustness" in printed  # errors against the truth files
    for entry in answers(tmp_path / "one"):
        if entry["error"] is None:
            mass = int(Path(entry["name"]).stem[-2:])
            assert entry["answer"]["queries"][0]["robustness"] == pytest.approx(0.5 * 9.80665 * mass, rel=0.01)
    assert {path.name for path in (tmp_path / "one").iterdir()} >= {"index.html", "results.csv", "journal.jsonl"}


def test_after_kill_9_the_same_command_goes_on_and_every_source_is_answered_once(scenes, tmp_path) -> None:
    journal = tmp_path / "out" / "journal.jsonl"
    command = [
        sys.executable,
        "-m",
        "poise.cli",
        *arguments(scenes, "--workers", "1", "--results", str(tmp_path / "out")),
    ]
    started = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, start_new_session=True)
    while started.poll() is None and (not journal.exists() or journal.read_bytes().count(b"\n") < 4):
        time.sleep(0.01)  # until the run is in its middle
    os.killpg(started.pid, signal.SIGKILL)
    started.wait()
    before = journal.read_bytes()
    assert before.count(b"\n") >= 4
    assert run(arguments(scenes, "--results", str(tmp_path / "out"))) == 2
    assert journal.read_bytes().startswith(before[: before.rindex(b"\n") + 1])
    names = [entry["name"] for entry in answers(tmp_path / "out")]
    assert len(names) == len(set(names)) == 13


def test_options_of_the_job_are_passed_on_and_each_source_gets_its_own_files(tmp_path, capsys) -> None:
    shutil.copy(STATIC, tmp_path / "a.mcap")
    shutil.copy(STATIC, tmp_path / "b.mcap")
    report = str(tmp_path / "reports" / "{name}")
    assert run(["evaluate", str(tmp_path), "--method", "static", "--report", report]) == 0
    assert {path.name for path in (tmp_path / "reports").iterdir()} == {"a", "b"}
    assert "b.mcap has the same content as" in capsys.readouterr().out


def test_a_recording_at_a_url_is_answered_as_the_file_and_keeps_its_name(tmp_path) -> None:
    target = tmp_path / "answer.json"
    assert run(["evaluate", f"file://{STATIC}", str(STATIC), "--method", "static", "--json", str(target)]) == 0
    content = {entry.pop("bag"): entry for entry in json.loads(target.read_text())["recordings"]}
    assert set(content) == {f"file://{STATIC}", str(STATIC)}
    first, second = content.values()
    assert first == second


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["identify"], "name the folders"),
        (["mismatch", "bags", "--queries", "x"], "no such option for evaluate mismatch: --queries"),
        (["bags", "--report", "out"], "put {name} into it"),
        (["bags", "--method"], "option --method needs a value"),
        (["compare", "bags"], "needs --reference"),
        (["bags", "--into", "x"], "no such option"),
    ],
)
def test_a_command_that_cannot_be_meant_is_refused_before_anything_is_computed(words, named) -> None:
    with pytest.raises(InputError) as caught:
        read_plan(words, None)
    assert named in caught.value.message


def test_a_value_of_the_wrong_type_is_refused_before_anything_is_computed(capsys) -> None:
    assert run(["evaluate", "bags", "--gravity", "heavy"]) == 2
    assert "--gravity" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("raised", "code", "named"),
    [(MemoryError(), "UNSUPPORTED", "raise --memory"), (ZeroDivisionError("x"), "INTERNAL", "ZeroDivisionError: x")],
)
def test_what_a_job_raises_is_an_error_of_the_source(raised, code, named, monkeypatch) -> None:
    class Failing:
        def main(self, *_: object, **__: object) -> None:
            raise raised

    monkeypatch.setattr("poise.commands.evaluate_worker.command", lambda job: Failing())
    reply = run_job("identify", ["bag.mcap"])
    assert reply["error"]["name"] == code
    assert named in reply["error"]["message"]
