"""A slice of `benchmarks.random_events`: events whose courses no effect of the library follows, on random arms."""

from pathlib import Path

import pytest

from benchmarks.foreign.run import answer
from benchmarks.random_events import EVENTS, recorded


@pytest.mark.parametrize(("seed", "event"), [(7200, "hand")])
def test_an_event_on_a_random_arm_is_named(seed: int, event: str, tmp_path: Path) -> None:
    said = answer(recorded(event, seed, tmp_path), 300)["answer"]
    assert [effect["name"] for effect in said["effects"]] == [EVENTS[event]]
    assert said["fit"]["holdout"]["augmented"] < 0.5 * said["fit"]["holdout"]["nominal"]
