"""What files of other programs have that was not expected: planes that are walls, no mass, small capsules."""

import json
from pathlib import Path

import numpy as np
import pytest

from poise.assembly import Box
from poise.errors import ErrorCode, InputError
from poise.worlds import read_world
from poise.worlds.solids import capsule, cone

WALL = """<sdf version="1.9"><world name="w"><model name="ground"><static>true</static><link name="l">
<collision name="c"><geometry><plane><normal>{normal}</normal></plane></geometry></collision></link></model>
<model name="brick"><pose>0.05 0 0.05 0 0 0</pose><link name="l"><inertial><mass>1</mass></inertial>
<collision name="c"><geometry><box><size>0.1 0.1 0.1</size></box></geometry></collision></link></model></world></sdf>"""

URDF = """<robot name="thing"><link name="base"><inertial><mass value="0"/></inertial>
<collision><origin xyz="0 0 0.3"/><geometry>{shape}</geometry></collision></link></robot>"""


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8)])
def test_a_plane_lies_below_its_normal(tmp_path: Path, normal: tuple[float, ...]) -> None:
    """A plane with a level normal is a wall: it was read as a floor."""
    path = tmp_path / "w.sdf"
    path.write_text(WALL.format(normal=" ".join(map(str, normal))))
    world, _ = read_world(path)
    ground = world.objects[world.index["ground"]]
    assert (ground.vertices @ normal).max() == pytest.approx(0, abs=1e-12)
    assert (ground.vertices @ normal).min() == pytest.approx(-0.1)
    (tmp_path / "w.urdf").write_text(URDF.format(shape=f'<plane normal="{" ".join(map(str, normal))}"/>'))
    plane = read_world(tmp_path / "w.urdf")[0].objects[0]
    np.testing.assert_allclose((plane.vertices - [0, 0, 0.3]) @ normal, (ground.vertices) @ normal, atol=1e-12)
    assert plane.fixed


def test_what_weighs_nothing_in_a_urdf_is_fixed_as_in_pybullet(tmp_path: Path) -> None:
    (tmp_path / "table.urdf").write_text(URDF.format(shape='<box size="1 1 0.1"/>'))
    world, notes = read_world(tmp_path / "table.urdf")
    assert world.objects[0].fixed
    assert world.objects[0].shape == Box((1.0, 1.0, 0.1))
    assert "thing: the file has no mass for it, or 0; it is fixed" in notes


def test_a_file_with_nothing_fixed_and_an_unknown_shape_say_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(URDF.format(shape='<box size="1 1 0.1"/>').replace('value="0"', 'value="2"'))
    with pytest.raises(InputError, match=r"--floor 0") as error:
        read_world(path)
    assert error.value.code == ErrorCode.BAD_INPUT
    path.write_text(URDF.format(shape='<cdf filename="a.cdf"/>'))
    with pytest.raises(InputError, match=r"<cdf> is not read; box, cylinder, capsule"):
        read_world(path)


@pytest.mark.parametrize("radius", [0.0005, 0.002, 0.005, 3.0])
def test_round_solids_of_any_size_are_closed(radius: float) -> None:
    """Of a radius below some millimetres trimesh left triangles out."""
    for length in (0.1 * radius, 0.5):
        volume = np.pi * radius**2 * (length + 4 / 3 * radius)
        assert capsule(radius, length).volume == pytest.approx(volume, rel=1e-2)
        assert cone(radius, length).volume == pytest.approx(np.pi * radius**2 * length / 3, rel=1e-2)


RVIZ = "scene\n* b\n0 0 0\n0 0 0 1\n1\n{}\n0 0 0\n0 0 0 1\n0 0 0 0\n0\n.\n"


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("box\n0.1 0.1", "2 sizes, expected 3"),
        ("sphere\n0.1 0.2", "2 sizes, expected 1"),
        ("cylinder\n0.1", "1 sizes, expected 2"),
        ("cone\n", "0 sizes, expected 2"),
        ("mesh\n3", "ends early"),
    ],
)
def test_a_shape_in_the_text_of_rviz_has_all_its_sizes(tmp_path: Path, shape: str, message: str) -> None:
    path = tmp_path / "a.scene"
    path.write_text(RVIZ.format(shape))
    with pytest.raises(InputError, match=message):
        read_world(path, floor=-1.0)


@pytest.mark.parametrize(
    ("primitive", "message"),
    [
        ({"type": 1, "dimensions": [0.1, 0.1]}, "2 sizes, expected 3"),
        ({"type": 2, "dimensions": []}, "0 sizes, expected 1"),
        ({"type": 3, "dimensions": [0.1]}, "1 sizes, expected 2"),
        ({"type": 4, "dimensions": [0.1, 0.2, 0.3]}, "3 sizes, expected 2"),
        ({"type": 1, "dimensions": ["x", 1, 1]}, "not a PlanningScene"),
    ],
)
def test_a_primitive_of_a_message_has_all_its_sizes(tmp_path: Path, primitive: object, message: str) -> None:
    path = tmp_path / "a.json"
    item = {"header": {"frame_id": "w"}, "id": "b", "primitives": [primitive]}
    path.write_text(json.dumps({"world": {"collision_objects": [item]}}))
    with pytest.raises(InputError, match=message):
        read_world(path, floor=-1.0)
