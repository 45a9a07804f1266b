"""docs/mismatch.md: its model is read, its effect works, it names the whole library."""

import re
from pathlib import Path

import numpy as np
import yaml

from poise.inertia import InertialParameters
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.reading import Tolerance, parse_model, recorded_from_motion
from poise.mismatch.reading.nominal_model import TOLERANCE_KEYS
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "mismatch.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_model_of_the_page_is_a_model_with_the_default_tolerances():
    content = yaml.safe_load(block("yaml"))
    model = parse_model(content)
    assert model.tolerance == Tolerance()
    assert {keys[0] for keys in TOLERANCE_KEYS.values()} == set(content["tolerance"])
    assert model.effects[0].values == {"time_constant": 0.05}


def test_the_effect_of_the_page_works(tmp_path, monkeypatch):
    (tmp_path / "suction_leak.py").write_text(block("python"))
    monkeypatch.syspath_prepend(str(tmp_path))
    import suction_leak

    effect = suction_leak.SuctionLeak()
    assert isinstance(effect, Effect)
    robot = RobotModel.from_file("ridgeback_ur10")
    seconds = np.arange(0.0, 5.0, 0.02)
    motion = FourierTrajectory.random(robot, np.random.default_rng(1), duration=5.0).at(seconds)
    phi = InertialParameters(1.0, np.zeros(3), 0.01 * np.eye(3)).phi
    recorded = recorded_from_motion(robot, seconds, motion, phi)
    response = effect.simulate(recorded, {"time_constant": 2.0, "force": 5.0})
    np.testing.assert_allclose(response[:, 2], 5.0 * np.exp(-seconds / 2.0))
    assert {p.name for p in effect.parameters(recorded)} == {"time_constant", "force"}
    assert effect.sentence(recorded, {"force": 5.0}).endswith(".")


def test_the_page_names_the_whole_library_and_nothing_else():
    table = PAGE[PAGE.index("## Effects in the library") : PAGE.index("Each file in")]
    assert set(re.findall(r"`(\w+)`", table)) == {effect.name for effect in all_effects()}
