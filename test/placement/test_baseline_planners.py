"""Planners to compare with, the engine they use, and the scenes they meet in."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from benchmarks.placement import run as benchmark
from benchmarks.placement import scenes
from poise.assembly import Analysis, Assembly, load_scene
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about
from poise.placement.packing import heights_over
from poise.worlds import convex_pieces

FLOOR = scenes.scene("cube").objects[0]


@pytest.mark.parametrize(
    "item", [*map(scenes.glued, scenes.GLUED), scenes.scene("sawteeth").objects[1]], ids=lambda item: item.id
)
def test_pieces_fill_the_solid_and_nothing_else(item):
    polyhedron = item.shape.polyhedron
    pieces = convex_pieces(polyhedron)
    assert len(pieces) > 1
    assert sum(ConvexHull(piece).volume for piece in pieces) == pytest.approx(item.shape.volume)
    moments = sum(ConvexHull(piece).volume * piece.mean(axis=0) for piece in pieces)
    if all(len(piece) == 8 for piece in pieces):  # boxes, whose middle is the mean of their corners
        assert moments == pytest.approx(item.shape.volume * item.shape.centroid)


def test_what_is_too_round_to_cut_is_refused():
    with pytest.raises(InputError) as error:
        convex_pieces(scenes.bowl(500).shape.polyhedron)
    assert error.value.code is ErrorCode.UNSUPPORTED


@pytest.mark.parametrize(("degrees", "stays"), [(25.0, True), (28.0, False)])
def test_the_engine_has_the_friction_of_the_scene(degrees, stays):
    """tan 26.6 degrees is 0.5."""
    pytest.importorskip("mujoco")
    from poise.baselines.placement.engine import holds

    lean = rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(degrees))
    cube = scenes.box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
    slope = replace(FLOOR, pose=Pose(lean, lean @ [0, 0, -0.01]))
    assembly = Assembly((slope, replace(cube, pose=Pose(lean, lean @ [0, 0, 0.05]))), friction=0.5)
    assert (holds(assembly) < 1e-3) == stays


def test_the_engine_sees_a_box_fall_that_is_past_its_edge():
    pytest.importorskip("mujoco")
    from poise.baselines.placement.engine import holds

    for offset, stays in ((0.04, True), (0.06, False)):
        cube = scenes.box("upper", (0.1, 0.1, 0.1), (offset, 0, 0.15))
        assembly = scenes.scene("cube").with_object(cube)
        assert (holds(assembly) < 1e-3) == stays


def test_a_heightmap_has_the_heights_of_the_surface():
    pyramid = scenes.scene("pyramids").objects[1]
    low = pyramid.vertices.min(axis=0)
    heights = heights_over(pyramid.shape.polyhedron, pyramid.vertices, low[:2], np.array([15, 15]), 0.004)
    # Cells of 4 mm on a base of 60 mm; the sides rise 100 mm over 30 mm.
    assert heights[0, 7] == pytest.approx(0.002 * 100 / 30)
    assert heights[7, 7] == pytest.approx(0.1)


def test_the_committed_scenes_are_those_of_the_command(tmp_path):
    scenes.write(tmp_path)
    written = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert written == {path.name: path.read_text() for path in scenes.FOLDER.iterdir()}


@pytest.mark.parametrize("name", scenes.SCENES)
def test_a_committed_scene_stands(name):
    analysis = Analysis.of(load_scene(scenes.FOLDER / f"{name}.yaml"))
    assert analysis.stability().margin > 0


def test_the_benchmark_runs_a_slice(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    target = Path(tmp_path) / "placement.json"
    arguments = ["run", "--quick", "--scene", "cube", "--planner", "poise", "--planner", "sim-above", "--workers", "1"]
    monkeypatch.setattr(sys, "argv", [*arguments, "--out", str(target)])
    benchmark.main()
    trials = json.loads(target.read_text())
    assert len(trials) == 4
    assert all(trial["moved"] < 1e-3 for trial in trials if trial["least"] is not None)
