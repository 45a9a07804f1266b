"""Random tables: objects that stand, that bodies can have, and that a hand can grasp one by one."""

from pathlib import Path

import numpy as np
import pytest

from poise.assembly import Analysis, Mesh, load_scene
from poise.errors import NoAnswerError
from poise.fake_robots.tables import random_table


def test_objects_of_a_random_table_stand_apart_on_it(tmp_path: Path) -> None:
    meshes = 0
    for seed in range(4):
        scene = load_scene(random_table(5, np.random.default_rng(seed), tmp_path))
        items = [item for item in scene.objects if not item.fixed]
        table = scene.objects[scene.place_of("table")]
        assert len(items) == 5
        assert Analysis.of(scene).stability().stable
        low, high = table.vertices.min(axis=0), table.vertices.max(axis=0)
        for item in items:
            inside = (item.vertices[:, :2] > low[:2]) & (item.vertices[:, :2] < high[:2])
            assert inside.all()
            reach = np.abs(np.asarray(item.com) - item.shape.centroid)
            assert 0 < reach.max() < 0.03  # it is offset
        meshes += sum(isinstance(item.shape, Mesh) for item in items)
    assert meshes


def test_a_seed_gives_the_same_table_and_too_many_objects_are_refused(tmp_path: Path) -> None:
    first = random_table(2, np.random.default_rng(3), tmp_path).read_bytes()
    assert random_table(2, np.random.default_rng(3), tmp_path).read_bytes() == first
    with pytest.raises(NoAnswerError, match="do not fit"):
        random_table(30, np.random.default_rng(0), tmp_path)
