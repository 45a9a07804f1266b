"""Rolling in an independent engine: below the limit it holds round bodies, above it they move."""

from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
import rolling_scenes as rolls

from poise.assembly import FrictionPair, RigidObject, Sphere, acceleration_limits

pytest.importorskip("mujoco")

from benchmarks import rolling as benchmark


@pytest.mark.parametrize("kind", ["can", "ball"])
@pytest.mark.parametrize("scene", ["tray", "chocks", "groove"])
def test_mujoco_holds_round_bodies_below_the_limit_and_moves_them_above_it(kind, scene, tmp_path):
    """A tray that tilts is a tray that accelerates; rolling resistance is that of the file that Poise writes."""
    body = rolls.KINDS[kind]
    if scene == "groove":
        assembly = rolls.groove(30, body=body)
    else:
        assembly = scenes.on_floor(body(), *(rolls.chocks(0.01) if scene == "chocks" else ()))
    assembly = replace(assembly, rolling=0.02)
    way = np.array([1.0, 0, 0])
    limit = float(acceleration_limits(assembly, way[None], turning=False).limits[0])
    # On edges the engine throws some cylinders over at 0.9 of the limit, depending on the last digits of the load.
    on_edges = scene == "chocks"
    assert benchmark.travel(assembly, 0.9 * limit * way, tmp_path / "scene.xml", 0.5, on_edges) < 2e-4
    assert benchmark.travel(assembly, 1.1 * limit * way, tmp_path / "scene.xml", 0.5, on_edges) > 1e-3


@pytest.mark.parametrize("pairs", [(), (FrictionPair(("low", "ball"), 0.5),)])
def test_mujoco_gives_a_ball_on_a_ball_the_resistance_of_both_curvatures(pairs, tmp_path):
    low = RigidObject("low", Sphere(2 * rolls.R), scenes.pose((0, 0, 2 * rolls.R)), fixed=True)
    assembly = replace(scenes.on_floor(low, rolls.ball(z=5 * rolls.R)), rolling=0.05, friction_pairs=pairs)
    way = np.array([1.0, 0, 0])
    limit = float(acceleration_limits(assembly, way[None], turning=False).limits[0])
    assert limit == pytest.approx(0.05 * 2 / 3 * scenes.G, rel=1e-6)
    assert benchmark.travel(assembly, 0.9 * limit * way, tmp_path / "scene.xml", 0.5) < 1e-3
    assert benchmark.travel(assembly, 1.1 * limit * way, tmp_path / "scene.xml", 0.5) > 2e-3


@pytest.mark.parametrize("number", range(18))
def test_a_slice_of_the_benchmark_agrees_with_mujoco(number, tmp_path):
    """Of random radii, slopes and friction; some cylinders are prisms for Poise and true cylinders for MuJoCo."""
    scene = list(benchmark.random_scenes(number + 1, seed=5))[number]
    assert benchmark.compared(scene, tmp_path / "scene.xml")[1:] == (True, True)
