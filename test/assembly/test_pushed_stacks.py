"""The comparison of random pushes with MuJoCo: closed forms, and what it says where the engine disagrees."""

import numpy as np
import pytest

from benchmarks.pushed_stacks import compared, explained, pushed, random_push, random_scene
from poise.assembly import Analysis, Assembly, Box, Push, RigidObject, assess
from poise.geometry import Pose

pytest.importorskip("mujoco")

from poise.baselines.placement import Engine

GRAVITY = 9.80665


def on_floor(shape: Box, height: float, mass: float) -> Analysis:
    floor = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    body = RigidObject("body", shape, Pose(np.eye(3), np.array([0, 0, height / 2])), mass=mass)
    return Analysis.of(Assembly((floor, body), friction=0.5))


def test_a_cube_slides_where_coulomb_says() -> None:
    analysis, push = on_floor(Box((0.1, 0.1, 0.1)), 0.1, 1.0), Push("body", (-0.05, 0.0, 0.02), (1.0, 0.0, 0.0))
    slides = 0.5 * 1.0 * GRAVITY
    assert assess(analysis, [push]).results[0].robustness == pytest.approx(slides, rel=1e-4)
    engine = Engine(analysis.assembly, 1e-3)
    assert pushed(engine, push, 0.9 * slides).rests
    assert pushed(engine, push, 1.1 * slides).moves


def test_soft_contacts_sink_under_a_push_of_many_weights() -> None:
    """A steep push whose line passes the edge of the base by 0.5 mm: 100 weights topple the box about that edge."""
    analysis = on_floor(Box((0.1, 0.1, 0.1)), 0.1, 0.275)
    way = np.array([0.0, -0.12, -1.0]) / np.hypot(0.12, 1.0)
    push = Push("body", (0.0, -0.0385, 0.1), tuple(way.tolist()))
    found = assess(analysis, [push]).results[0]
    assert found.robustness == pytest.approx(0.275 * GRAVITY * 0.05 / (0.0005 / np.hypot(0.12, 1.0)), rel=1e-3)
    engine = Engine(analysis.assembly, 1e-3)
    runs = pushed(engine, push, 0.9 * found.robustness), pushed(engine, push, 1.1 * found.robustness)
    assert not runs[0].rests
    assert runs[0].depth > 5e-4
    assert explained(analysis, push, found, runs)[0] == "sinks"


def test_scenes_come_again_and_stand() -> None:
    for seed in range(4):
        kind, analysis, rng = random_scene(seed)
        again = random_scene(seed)
        assert kind == again[0]
        assert analysis.stability().margin > 0.02
        pushes = random_push(analysis, rng), random_push(again[1], again[2])
        assert pushes[0].object == pushes[1].object
        assert np.array_equal(pushes[0].point, pushes[1].point)


def test_disagreements_are_explained() -> None:
    assert all(outcome != "open" for outcome, _ in compared(3, pushes=1))
