"""`poise identify` on wrenches with an error: the cause is named, the number withheld, and repaired on request."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from poise.cli import app, run
from poise.recording import open_recording, rewrite_recording
from poise.types import Array

BAG = Path("bags/kuka_static_poses.mcap")
MASS = 0.9323


def quarter_turn(wrench: Array) -> Array:
    """In axes that are turned by 90 degrees about z."""
    return wrench[:, [1, 0, 2, 4, 3, 5]] * [1, -1, 1, 1, -1, 1]


def identified(path: Path, *options: str) -> tuple[int, dict]:
    """Exit status and JSON."""
    target = path.with_suffix(".json")
    result = CliRunner().invoke(app, ["identify", str(path), "--json", str(target), *options])
    return getattr(result.exception, "exit_status", result.exit_code), json.loads(target.read_text(encoding="utf-8"))


@pytest.fixture
def turned(tmp_path: Path) -> Path:
    recording, path = open_recording(BAG), tmp_path / "turned.mcap"
    wrench = recording.wrench("wrench")
    rewrite_recording(
        recording, path, {"wrench": replace(wrench, wrench_in_sensor=quarter_turn(wrench.wrench_in_sensor))}
    )
    return path


def test_a_turned_sensor_is_named_and_its_number_withheld(turned: Path) -> None:
    status, answer = identified(turned)
    assert status == 3
    assert answer["mass"] is None
    first = answer["findings"][0]
    assert first["name"] == "SENSOR_ROTATED"
    assert first["evidence"]["residual_force_after"] < 0.2 * first["evidence"]["residual_force_before"]


def test_evaluate_withholds_what_identify_withholds_and_names_the_cause(turned: Path, capsys) -> None:
    target = turned.with_suffix(".json")
    assert run(["evaluate", str(turned.parent), "--json", str(target)]) == 3
    [answer] = json.loads(target.read_text(encoding="utf-8"))["recordings"]
    assert answer["mass"] is None
    assert answer["error"]["name"] == answer["findings"][0]["name"] == "SENSOR_ROTATED"
    assert run(["evaluate", str(turned.parent), "--repair", "--json", str(target)]) == 0
    assert "sensor_rotated" in capsys.readouterr().out


def test_a_repaired_answer_is_the_right_one_and_says_so(turned: Path) -> None:
    status, answer = identified(turned, "--repair")
    assert status == 0
    assert answer["findings"][0]["sentence"].startswith("repaired")
    assert answer["fit"]["passed"]
    assert abs(answer["mass"] - MASS) < 3 * answer["mass_std"] < 0.05 * MASS


def test_a_healthy_answer_says_what_its_motion_cannot_exclude(tmp_path: Path) -> None:
    path = tmp_path / BAG.name
    path.write_bytes(BAG.read_bytes())
    status, answer = identified(path)
    assert status == 0
    assert not answer["findings"]
    assert answer["fit"]["passed"]
    assert any("controller" in words for words in answer["fit"]["cannot_exclude"])
    assert np.isclose(answer["mass"], MASS, atol=1e-3)
