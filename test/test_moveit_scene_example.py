"""examples/moveit_scene.py: a planning scene becomes a scene that can be assessed, and comes back as it was."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from poise.assembly import acceleration_limits, load_scene

EXAMPLE = Path(__file__).parents[1] / "examples" / "moveit_scene.py"
HEADER = {"frame_id": "world"}
HALF = float(np.sqrt(0.5))


def placed(z: float) -> dict[str, Any]:
    return {"position": {"x": 0.0, "y": 0.0, "z": z}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def convert(way: str, source: Path, output: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLE), way, str(source), "--output", str(output), *more]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def planning_scene(tmp_path: Path) -> Path:
    """A table, a box that lies on its side, and a dumbbell of two boxes and a bar."""
    box = {"type": 1, "dimensions": [0.3, 0.1, 0.1]}
    side = {"position": {"x": 0.1, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}}
    other = {"position": {"x": -0.1, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}}
    turned = placed(0.15) | {"orientation": {"x": 0.0, "y": HALF, "z": 0.0, "w": HALF}}
    items = [
        {
            "header": HEADER,
            "id": "table",
            "pose": placed(-0.05),
            "primitives": [{"type": 1, "dimensions": [2, 2, 0.1]}],
        },
        {"header": HEADER, "id": "box", "pose": turned, "primitives": [box], "primitive_poses": [placed(0.0)]},
        {
            "header": HEADER,
            "id": "dumbbell",
            "pose": placed(0.05) | {"position": {"x": 0.0, "y": 0.5, "z": 0.05}},
            "primitives": [{"type": 1, "dimensions": [0.1, 0.1, 0.1]}] * 2
            + [{"type": 1, "dimensions": [0.2, 0.02, 0.02]}],
            "primitive_poses": [side, other, placed(0.0)],
        },
    ]
    held = [{"object": {"id": "cup"}}]
    path = tmp_path / "planning_scene.yaml"
    content = {"world": {"collision_objects": items}, "robot_state": {"attached_collision_objects": held}}
    path.write_text(yaml.safe_dump(content) + "---\n")
    return path


def test_a_planning_scene_is_assessed_and_comes_back(planning_scene: Path, tmp_path: Path) -> None:
    masses, scene, back = tmp_path / "masses.yaml", tmp_path / "scene.yaml", tmp_path / "back.yaml"
    masses.write_text("box: 2.0\ndumbbell: 3.0\n")
    done = convert("to-poise", planning_scene, scene, "--masses", str(masses), "--friction", "0.9")
    assert done.returncode == 0, done.stderr
    assert "table: no mass is given; it is fixed" in done.stderr
    assert "cup: the robot holds it" in done.stderr
    assembly = load_scene(scene)
    assert {item.id for item in assembly.objects if item.fixed} == {"table"}
    limits = acceleration_limits(assembly, np.array([[1.0, 0.0, 0.0]]))
    assert limits.limits[0] == pytest.approx(9.80665 * 0.1 / 0.3, rel=1e-3)  # the upright box topples: g b / h

    assert convert("to-moveit", scene, back, "--frame", "map").returncode == 0
    items = {item["id"]: item for item in yaml.safe_load(back.read_text())["world"]["collision_objects"]}
    assert items["box"]["primitives"] == [{"type": 1, "dimensions": [0.3, 0.1, 0.1]}]
    assert items["box"]["pose"]["orientation"]["y"] == pytest.approx(HALF)
    assert items["box"]["header"]["frame_id"] == "map"
    vertices = np.array([[vertex[axis] for axis in "xyz"] for vertex in items["dumbbell"]["meshes"][0]["vertices"]])
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.3, 0.1, 0.1], atol=1e-6)
    again = tmp_path / "again.yaml"
    assert "is_diff" not in done.stderr
    done = convert("to-poise", back, again, "--masses", str(masses), "--friction", "0.9")
    assert done.returncode == 0
    assert "is a difference (is_diff)" in done.stderr
    for before, after in zip(assembly.objects, load_scene(again).objects, strict=True):
        assert after.shape.volume == pytest.approx(before.shape.volume, rel=1e-5)
        np.testing.assert_allclose(after.pose.vector, before.pose.vector, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda items: items[1].update(header={"frame_id": "tray"}), "several frames: tray, world"),
        (lambda items: items[1].update(id="other"), "masses: there is no box"),
        (lambda items: items[1].update(operation=b"\1"), "box: operation"),
        (lambda items: items[1]["primitives"][0].update(type=5), "box: primitive type 5"),
        (lambda items: items[1].update(primitives=[], primitive_poses=[]), "box: it has no primitive"),
    ],
)
def test_a_scene_that_cannot_be_read_is_refused_and_nothing_is_written(
    change: Any, message: str, planning_scene: Path, tmp_path: Path
) -> None:
    content = next(iter(yaml.safe_load_all(planning_scene.read_text())))
    change(content["world"]["collision_objects"])
    planning_scene.write_text(yaml.safe_dump(content))
    masses = tmp_path / "masses.yaml"
    masses.write_text("box: 2.0\n")
    done = convert("to-poise", planning_scene, tmp_path / "scene.yaml", "--masses", str(masses), "--friction", "0.9")
    assert done.returncode == 1
    assert message in done.stderr
    assert not (tmp_path / "scene.yaml").exists()
