"""A slice of `benchmarks.random_effects`: effects of the foreign generator on robots drawn at random."""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from benchmarks.foreign.run import answer
from benchmarks.foreign.score import judge
from benchmarks.random_effects import TURNS, random_case


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        (
            7026,
            "base_motion",
        ),  # filtered efforts, which looked like damping; the motion is too weak
        (7027, "base_tilt"),  # efforts alone under coloured noise
        (7046, "slosh"),  # joint states at 500 Hz that arrive in bursts
        (7227, "cable"),  # efforts alone, in which a contact without proof kept it away
        (7269, "backlash"),  # shakes other joints more than its own
        (7291, "coulomb_friction"),  # whose law of reversal is no other friction
        (7310, "flexible_mode"),  # efforts alone
        (7530, "load_dependent_friction"),  # reverses along a path, as Coulomb friction did alone
        (9141, "stribeck_friction"),  # a tight spot took the place of the Coulomb friction that both contain
        (7525, "coulomb_friction"),  # stick-slip, whose noisy acceleration a spring would smooth
    ],
)
def test_effects_on_random_robots_have_no_false_name(seed: int, effect: str, tmp_path: Path) -> None:
    made = random_case(seed, tmp_path)
    assert [each["name"] for each in made.label["effects"]] == [effect]
    made.write(tmp_path / "case")
    verdict = judge(str(seed), made.label, answer(tmp_path / "case", 300))
    assert verdict.answered
    assert not verdict.extra
    assert verdict.right == (effect != "base_motion")


def test_kinds_come_in_turn_and_a_seed_gives_the_same_case(tmp_path: Path) -> None:
    kinds = []
    for seed in (7072, 7073):
        (tmp_path / str(seed)).mkdir()
        kinds.append(random_case(seed, tmp_path / str(seed)).label["kind"])
    assert kinds == [kind for kind, _ in TURNS[:2]]
    (tmp_path / "again").mkdir()
    first, second = (random_case(7073, tmp_path / name) for name in ("7073", "again"))
    assert first.label == second.label
