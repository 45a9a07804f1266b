"""Two recordings of one robot: matched by their motion, and what changed between them."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cases
import numpy as np
import pytest

from benchmarks.compare import CHANGES, make_pair
from poise.cli import run
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.mismatch.answer import Quantity
from poise.mismatch.comparing import align, compare, comparison
from poise.mismatch.comparing.change import as_much
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory

FR3 = RobotModel.from_file("fr3")


def motion(seed: int = 1) -> FourierTrajectory:
    rng = np.random.default_rng(seed)
    return FourierTrajectory.random(FR3, rng, duration=40.0, speed=0.8, amplitude=0.8, frequency=0.023, harmonics=15)


def along(path: FourierTrajectory, place: np.ndarray, seconds: np.ndarray, names: Any = FR3.joint_names) -> Any:
    """What `align` needs of a recording: postures at seconds (N,), of a path at its seconds `place` (N,)."""
    joints = SimpleNamespace(names=names, position=path.at(place).position)
    return SimpleNamespace(joints=joints, effort=None, base=None, seconds=seconds)


@pytest.mark.parametrize("rate", [1.0, 1.3, 0.75])
def test_times_are_found_beside_another_start_and_another_speed(rate: float) -> None:
    path, seconds = motion(), np.arange(2000) * 0.01
    matched = align(along(path, 6.0 + rate * seconds, seconds), along(path, seconds, seconds))
    inner = matched.moving & (matched.seconds > 1.0) & (matched.other < 19.0)
    assert np.abs(matched.other - (6.0 + rate * matched.seconds))[inner].max() < 0.01
    assert matched.rate == pytest.approx(rate, abs=2e-3)
    assert matched.share == pytest.approx(min(14.0 / rate / 20.0, 1.0), abs=0.05)
    back = matched.reversed()
    assert np.abs(back.other - (back.seconds - 6.0) / rate)[5:-5].max() < 0.01


def test_a_pause_is_found_and_does_not_count_as_alike() -> None:
    path, seconds = motion(), np.arange(2500) * 0.01
    place = np.where(seconds < 8.0, seconds, np.maximum(seconds - 4.0, 8.0))
    matched = align(along(path, place, seconds), along(path, seconds, seconds))
    expected = np.interp(matched.seconds, seconds, place)
    away = np.abs(matched.seconds - 10.0) > 3.0
    assert np.abs(matched.other - expected)[away & matched.moving].max() < 0.02
    alike = matched.alike(0.1, 0.05, 0.3)
    assert not alike[(matched.seconds > 8.2) & (matched.seconds < 11.8)].any()
    assert alike[away & (matched.seconds > 1.0) & (matched.seconds < 24.0)].mean() > 0.95


def test_other_joints_are_named() -> None:
    seconds = np.arange(1000) * 0.01
    one = along(motion(), seconds, seconds)
    with pytest.raises(InputError, match="second alone has fr3_joint1, the first alone a") as caught:
        align(one, along(motion(), seconds, seconds, ("a", *FR3.joint_names[1:])))
    assert caught.value.code == ErrorCode.BAD_INPUT


def test_a_change_of_the_wrench_is_found_in_the_recording_that_has_it() -> None:
    before, after = cases.make_case(2), cases.make_case(2, (("mass_step", 1.0),))
    a, b = before.recorded(), after.recorded()
    for first, second, side in ((a, b, "b"), (b, a, "a")):
        found = compare(first, second, before.model)
        assert (found.verdict, [each.finding.effect.name for each in found.changes]) == ("named", ["mass_step"])
        assert found.changes[0].present_in == found.changes[0].more_in == side
    silent = replace(a, wrench=np.full_like(a.wrench, np.nan))
    with pytest.raises(NoAnswerError, match="no wrench"):  # of one of them, and no efforts
        compare(silent, b, before.model)
    with pytest.raises(InputError, match="same readings"):
        compare(a, a, before.model)


@pytest.mark.parametrize(
    ("seed", "change", "moved"),
    [
        (2, "load", "pause"),
        (1, "none", "faster"),
        (5, "frictionloss", "skew"),
        (3058, "armature", "same"),  # far below the noise of a sample
        (4002, "load", "other"),  # that only A has
        (7295, "load", "skew"),  # far larger than what the wrong clock does
        (7215, "damping", "faster"),  # of one joint, beside much that both recordings have
    ],
)
def test_what_both_lack_cancels(seed: int, change: str, moved: str, tmp_path: Path) -> None:
    """MuJoCo's efforts; both recordings have friction and rotors that the model lacks."""
    bags, truth = make_pair(seed, tmp_path, change, moved, seconds=16.0)
    words = ["compare", *bags, "--model", str(tmp_path / "model.yaml"), "--json", str(tmp_path / "answer.json")]
    assert run(words) == 0
    found = json.loads((tmp_path / "answer.json").read_text())
    assert [each["name"] for each in found["effects"]] == ([CHANGES[change]] if CHANGES[change] else [])
    if moved != "other":
        assert found["alignment"]["rate"] == pytest.approx(1.3 if moved == "faster" else 1.0, abs=0.01)
    for effect in found["effects"]:
        assert effect["more_in"] == truth["in"]
        assert effect["present_in"] in (truth["in"], "both")
        assert effect["change"].keys() == effect["parameters"].keys()
    if change == "load":
        sign = 1.0 if truth["in"] == "b" else -1.0
        assert sign * found["effects"][0]["change"]["mass"]["value"] == pytest.approx(truth["mass"], rel=0.1)


@pytest.mark.parametrize(("unexplained", "side"), [("", "b"), ("a", "a"), ("ab", "b")])
def test_what_only_a_leaves_unexplained_is_held_against_b(
    monkeypatch: pytest.MonkeyPatch, unexplained: str, side: str
) -> None:
    """Of two motions: rotors of A that no name explains beside its friction were `none`, since B has nothing more."""
    monkeypatch.setattr(comparison, "with_known_load", lambda recorded, alone: recorded)
    alone = {
        name: SimpleNamespace(unknown="rest" if name in unexplained else None, findings=(), augmented=name)
        for name in "ab"
    }
    stages: Any = SimpleNamespace(
        model=None,
        usual=lambda recorded, model: alone[recorded],
        alone=lambda recorded, model: alone[recorded],
        diagnose=lambda this, model: SimpleNamespace(findings=(), held=this, against=model),
    )
    matched: Any = SimpleNamespace(share=0.0)
    found: Any = comparison._through_model("a", "b", matched, stages, [], 0.0)  # type: ignore[arg-type]
    assert found.side == found.diagnosis.held == side
    assert any("may be hidden" in each for each in found.notes) == (unexplained == "ab")
    assert found.diagnosis.against == ("a" if side == "b" else "b")


def test_a_recording_shows_as_much_of_an_effect_as_another_one_within_errors() -> None:
    change = {"inertia_1": Quantity(0.075, 0.006, ""), "inertia_2": Quantity(0.077, 0.01, "")}
    twice = {"inertia_1": Quantity(0.2, 0.04, ""), "inertia_2": Quantity(0.23, 0.18, "")}
    opposite = {"inertia_1": Quantity(-0.2, 0.04, "")}
    assert as_much(twice, change)
    assert not as_much(change, twice)
    assert not as_much(opposite, change)
