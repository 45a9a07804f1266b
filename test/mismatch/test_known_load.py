"""Acceleration limits of a load that a diagnosis knows, with as much caution as it knows it badly."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from poise.cli import run
from poise.mismatch.application.known_load import known_load
from poise.mismatch.effects import PAYLOAD_PARAMETERS
from poise.mismatch.reading import parse_model

GRAVITY = 9.81
SIDE = 0.2


def asked(folder: Path, model: dict[str, object], *more: str) -> dict[str, list[float]]:
    """Limits along +x and -x of a cube that topples before it slips."""
    scene, known, answer = folder / "scene.yaml", folder / "model.yaml", folder / "limits.json"
    objects = [
        {"id": "tray", "fixed": True, "box": [1.0, 1.0, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]},
        {"id": "cube", "box": [SIDE] * 3, "pose": [0, 0, SIDE / 2, 0, 0, 0, 1], "mass": 5.0},
    ]
    scene.write_text(yaml.safe_dump({"gravity": [0, 0, -GRAVITY], "friction": 3.0, "objects": objects}))
    known.write_text(yaml.safe_dump(model))
    ways = folder / "ways.json"
    ways.write_text("[[1, 0, 0], [-1, 0, 0]]")
    options = ["--directions", str(ways), "--load", "cube", "--model", str(known), "--json", str(answer), *more]
    assert run(["msa", str(scene), *options]) == 0
    content: dict[str, list[float]] = json.loads(answer.read_text())
    return content


def test_caution_is_two_sigmas_of_the_centre_of_mass_at_the_edge(tmp_path: Path) -> None:
    """It topples at g d / h, d from the centre of mass to the edge; known to half a tolerance of 10 mm."""
    payload = {"mass": 2.0, "com": [0.0, 0.0, 0.0], "inertia": [0.02, 0, 0, 0.02, 0, 0.02]}
    said = asked(tmp_path, {"payload": payload, "tolerance": {"payload": {"com": 0.01, "mass": 0.001}}})
    half = SIDE / 2
    assert said["limits"] == pytest.approx([GRAVITY] * 2, rel=1e-3)
    assert said["cautious_limits"] == pytest.approx([GRAVITY * (half - 0.01) / half] * 2, rel=2e-3)


def test_what_a_diagnosis_found_moves_the_limits(tmp_path: Path) -> None:
    """A centre of mass 30 mm towards the front, and turned by half a turn where the object's frame is."""
    values = dict.fromkeys(PAYLOAD_PARAMETERS, 0.0) | {
        "moment_x": 2.0 * 0.03,
        "ixx": 1e-3,
        "iyy": 2.8e-3,
        "izz": 2.8e-3,
    }
    payload = {"mass": 2.0, "com": [0.0, 0.0, 0.0], "inertia": [0.02, 0, 0, 0.02, 0, 0.02]}
    effect = {"name": "payload_parameters", "parameters": values, "covariance": (1e-12 * np.eye(10)).tolist()}
    expected = [GRAVITY * (SIDE / 2 + sign * 0.03) / (SIDE / 2) for sign in (1, -1)]
    said = asked(tmp_path, {"payload": payload, "effects": [effect]})
    assert said["limits"] == pytest.approx(expected, rel=1e-3)
    assert said["cautious_limits"] == pytest.approx(expected, rel=1e-3)
    turned = asked(tmp_path, {"payload": payload, "effects": [effect]}, "--load-pose", "0 0 0 0 0 1 0")
    assert turned["limits"] == pytest.approx(expected[::-1], rel=1e-3)


def test_a_model_without_a_payload_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(AssertionError):
        asked(tmp_path, {})
    assert "no payload" in capsys.readouterr().err


def test_the_covariance_of_a_finding_follows_its_names_not_their_order() -> None:
    names = PAYLOAD_PARAMETERS[::-1]
    spread = np.arange(1.0, 11.0)
    effect = {
        "name": "payload_parameters",
        "parameters": dict.fromkeys(names, 0.0),
        "covariance": np.diag(spread).tolist(),
    }
    model = parse_model({"payload": {"mass": 1.0}, "effects": [effect]})
    assert np.array_equal(np.diag(known_load(model)[1]), spread[::-1])
