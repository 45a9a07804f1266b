"""`poise identify --model`: a robot's flaws, found once with a known load, no longer spoil the weighing of others."""

import json
from pathlib import Path

import cases
import numpy as np
import pytest
from cases import Case, make_case

from poise.cli import run
from poise.inertia import InertialParameters
from poise.mismatch.reading import ModelEffect, NominalModel, dump_model
from poise.recording import write_recording
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf

FLAWS = {
    "low_pass": {"time_constant": 0.08},
    "world_force": {"x": 0.0, "y": 0.02, "z": 0.1, "force_x": 1.2, "force_y": -1.5, "force_z": 0.5},
}
# Error of the mass, and of the centre of mass, without the model over that with it, at the least.
BETTER = {"low_pass": (10.0, 1.0), "world_force": (5.0, 2.0)}


def recorded_bag(folder: Path, name: str, case: Case) -> Path:
    path = folder / f"{name}.mcap"
    urdf = read_urdf(find_urdf("ridgeback_ur10"))
    write_recording(path, {"wrench": case.wrench, "joint_states": case.joints}, robot_description=urdf)
    return path


def errors(bag: Path, case: Case, answer: Path, *more: str) -> tuple[float, float]:
    """Of the mass, kg, and of the centre of mass, m."""
    assert run(["identify", str(bag), "--json", str(answer), *more]) == 0
    said, true = json.loads(answer.read_text()), InertialParameters.from_phi(case.exact.phi)
    return abs(said["mass"] - true.mass), float(np.linalg.norm(np.array(said["com"]) - true.com))


@pytest.mark.parametrize("name", FLAWS)
def test_another_load_is_weighed_better_with_the_model(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(cases.DRAWS, name, lambda rng, recorded, strength: FLAWS[name])
    known, other = (make_case(seed, ((name, 1.0),), duration=20.0) for seed in (21, 22))
    model, saved, answer = tmp_path / "model.yaml", tmp_path / "saved.yaml", tmp_path / "answer.json"
    model.write_text(dump_model(known.model))
    first = recorded_bag(tmp_path, "known", known)
    assert run(["mismatch", str(first), "--model", str(model), "--save", str(saved)]) == 0
    bag = recorded_bag(tmp_path, "other", other)
    without, with_it = errors(bag, other, answer), errors(bag, other, answer, "--model", str(saved))
    assert json.loads(answer.read_text())["taken_out"]["effects"] == [name]
    for before, after, ratio in zip(without, with_it, BETTER[name], strict=True):
        assert before > ratio * after


def test_the_payload_and_events_are_not_taken_out(tmp_path: Path) -> None:
    case = make_case(22, duration=12.0)
    bag, answer, model = recorded_bag(tmp_path, "run", case), tmp_path / "answer.json", tmp_path / "model.yaml"
    parts = (
        ModelEffect("payload_parameters", {"mass": 0.1}, np.zeros((1, 1))),
        ModelEffect("mass_step", {"time": 3.0, "mass": 0.4}, np.zeros((2, 2))),
    )
    model.write_text(dump_model(NominalModel(effects=parts)))
    plain = errors(bag, case, answer)
    same = errors(bag, case, answer, "--model", str(model))
    said = json.loads(answer.read_text())["taken_out"]
    assert said["effects"] == []
    assert set(said["left"]) == {"payload_parameters", "mass_step"}
    assert same == pytest.approx(plain, rel=0.05, abs=1e-4)
