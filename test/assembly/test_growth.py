"""A fast slice of benchmarks.growth: small scenes of each kind are answered whole, and certified."""

import pytest

from benchmarks.growth import KINDS, Effort, measured

SMALL = {"wall": 10, "pallet": 12, "shelf": 9, "tables": 6}


@pytest.mark.parametrize("kind", KINDS)
def test_small_scenes_of_each_kind_are_answered_whole(kind: str) -> None:
    row = measured(kind, SMALL[kind], Effort(pushes=3, directions=12, points=100), seed=5)
    assert row["pushes_whole"] == "3 of 3"
    assert row["limits_whole"]
    assert row["map_whole"]
    assert row["disassembly_whole"]
