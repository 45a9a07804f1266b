"""The Rerun scene of an assembly, read back: every body, the graph, a step for each push, the limits."""

import sys

import numpy as np
import pytest
from assembly_in_pictures import CAN, CUBE, FLOOR, UPRIGHT

from poise.assembly import Analysis, Assembly, Box, Push, RigidObject, acceleration_limits, assess, robustness_map
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.viewing.assembly_recording import write_assembly_recording

rrd = pytest.importorskip("rerun.chunk", reason="rerun-sdk is an extra")


@pytest.fixture(scope="module")
def analysis():
    return Analysis.of(Assembly((FLOOR, CUBE, CAN), np.array([0, 0, -9.81])))


def test_the_scene_holds_what_it_promises(analysis, tmp_path):
    pushes = [Push("cube", (-0.5, 0, 0.9), (1, 0, 0)), Push("can", (-0.1, 0, 1.45), (1, 0, 0))]
    path = write_assembly_recording(
        tmp_path / "scene.rrd",
        analysis,
        pushes,
        assess(analysis, pushes).results,
        robustness_map(analysis, 200, 0.1),
        acceleration_limits(analysis, 8),
    )
    chunks = rrd.RrdReader(str(path)).stream().to_chunks()
    entities = {chunk.entity_path for chunk in chunks}
    bodies = {f"/world/bodies/{name}" for name in ("floor", "cube", "can")}
    assert bodies | {"/world/graph/bodies", "/world/map/points", "/world/mechanism", "/limits"} <= entities
    assert sum(chunk.num_rows for chunk in chunks if chunk.entity_path == "/world/pushes") == 2


def test_without_rerun_the_error_names_the_line_that_installs_it(analysis, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError) as raised:
        write_assembly_recording(tmp_path / "scene.rrd", analysis)
    assert raised.value.code == ErrorCode.UNSUPPORTED
    assert "pip install" in raised.value.message


def test_doubtful_points_and_directions_are_marked(tmp_path):
    boxes = [RigidObject(f"b{x}", Box((1, 1, 1)), Pose.from_vector([x, 0, 0.5, *UPRIGHT]), mass=1.0) for x in (0, 1)]
    row = Analysis.of(Assembly((FLOOR, *boxes), np.array([0, 0, -9.81])))
    found, limits = robustness_map(row, 50, 0.1, "limit"), acceleration_limits(row, 4, deadline=0.0)
    path = write_assembly_recording(tmp_path / "row.rrd", row, found_map=found, limits=limits)
    content = {chunk.entity_path: chunk for chunk in rrd.RrdReader(str(path)).stream().to_chunks()}
    assert "/world/map/doubtful" in content
    assert path.read_bytes().count(b"(doubtful)") >= 1
