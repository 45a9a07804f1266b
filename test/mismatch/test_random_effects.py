"""A slice of `benchmarks.random_effects`: effects of the foreign generator on robots drawn at random."""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from benchmarks.foreign.run import answer
from benchmarks.foreign.score import judge
from benchmarks.random_effects import KNOWN, TOO_WEAK, TURNS, random_case


@pytest.mark.parametrize("seed", [7026, 7046, 7227, 7291])
def test_effects_on_random_robots_have_no_false_name(seed: int, tmp_path: Path) -> None:
    """The quickest of those that once had one; `--known` answers all."""
    made = random_case(seed, tmp_path)
    assert [each["name"] for each in made.label["effects"]] == [KNOWN[seed]]
    made.write(tmp_path / "case")
    verdict = judge(str(seed), made.label, answer(tmp_path / "case", 300))
    assert verdict.answered
    assert not verdict.extra
    assert verdict.right == (seed not in TOO_WEAK)


def test_kinds_come_in_turn_and_a_seed_gives_the_same_case(tmp_path: Path) -> None:
    kinds = []
    for seed in (7072, 7073):
        (tmp_path / str(seed)).mkdir()
        kinds.append(random_case(seed, tmp_path / str(seed)).label["kind"])
    assert kinds == [kind for kind, _ in TURNS[:2]]
    (tmp_path / "again").mkdir()
    first, second = (random_case(7073, tmp_path / name) for name in ("7073", "again"))
    assert first.label == second.label
