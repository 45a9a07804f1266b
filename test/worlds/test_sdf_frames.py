"""Nested models, frames, joints and included models of SDFormat: where their bodies are, and which are one."""

from pathlib import Path

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.worlds import read_world

CUP = """<sdf version='1.9'><model name='cup'>
  <frame name='rim' attached_to='body'><pose>0 0 0.05 0 0 0</pose></frame>
  <link name='body'><pose>0 0 0.05 0 0 0</pose><inertial><mass>0.3</mass></inertial>
    <collision name='c'><geometry><cylinder><radius>0.03</radius><length>0.1</length></cylinder></geometry></collision>
  </link></model></sdf>"""


def solid(name: str, side: float, rest: str = "") -> str:
    """A link that is a cube of 1 kg."""
    return f"""<link name='{name}'>{rest}<inertial><mass>1</mass></inertial><collision name='c'>
      <geometry><box><size>{side} {side} {side}</size></box></geometry></collision></link>"""


def world_of(folder: Path, text: str) -> Path:
    """A world with a floor, and a cup beside it to be included."""
    (folder / "cup").mkdir(exist_ok=True)
    (folder / "cup" / "model.sdf").write_text(CUP)
    floor = "<model name='floor'><static>true</static><link name='l'><collision name='c'><geometry><plane/></geometry>"
    path = folder / "world.sdf"
    path.write_text(
        f"<sdf version='1.9'><world name='w'>{floor}</collision></link></model>"
        f"<frame name='table'><pose degrees='true'>1 2 0.5 0 0 90</pose></frame>{text}</world></sdf>"
    )
    return path


def test_a_placement_frame_is_where_the_pose_says(tmp_path: Path) -> None:
    include = "<include {}><uri>model://cup</uri><name>a</name><placement_frame>rim</placement_frame><pose {}</include>"
    text = include.format("", "relative_to='table'>0.3 0 0.4 0 0 0</pose>") + (
        "<model name='b' placement_frame='inner::top'><pose>0 0 1 0 0 0</pose>"
        f"<model name='inner'><pose>0.2 0 0 0 0 0</pose><frame name='top'><pose>0 0 0.1 0 0 0</pose></frame>"
        f"{solid('l', 0.2)}</model></model>"
        "<model name='c'><pose>0 -1 0 0 0 0</pose>"
        + include.format("merge='true'", "degrees='true'>0 0 0.4 180 0 0</pose>")
        + "</model>"
    )
    found = {item.id: item.pose for item in read_world(world_of(tmp_path, text))[0].objects}
    np.testing.assert_allclose(found["a"].translation, [1, 2.3, 0.85], atol=1e-9)
    np.testing.assert_allclose(found["b::inner"].translation, [0, 0, 0.9], atol=1e-9)
    np.testing.assert_allclose(found["c"].translation, [0, -1, 0.45], atol=1e-9)  # upside down


def test_poses_are_relative_to_what_is_in_other_models(tmp_path: Path) -> None:
    text = (
        "<include><uri>model://cup</uri><name>a</name><pose relative_to='table'>0 0 0 0 0 0</pose></include>"
        "<include><uri>model://cup</uri><name>b</name><pose relative_to='a::rim'>0.1 0 0 0 0 0</pose></include>"
        "<model name='c'><pose relative_to='b'>0 0 0.2 0 0 0</pose>"
        f"<model name='inner'><pose>0 0 0.5 0 0 0</pose>{solid('l', 0.1)}</model>"
        + solid("m", 0.1, "<pose relative_to='inner::l'>0.3 0 0 0 0 0</pose>")
        + "</model>"
    )
    found = {item.id: item.pose.translation for item in read_world(world_of(tmp_path, text))[0].objects}
    np.testing.assert_allclose(found["b"], [1, 2.1, 0.65], atol=1e-9)
    np.testing.assert_allclose(found["c"], [1, 2.4, 1.3], atol=1e-9)
    np.testing.assert_allclose(found["c::inner"], [1, 2.1, 1.3], atol=1e-9)


def test_joints_weld_links_of_nested_models_and_of_the_world(tmp_path: Path) -> None:
    weld = "<joint name='j' type='fixed'><parent>{}</parent><child>{}</child></joint>"
    text = (
        f"<model name='a'><model name='inner'><frame name='f' attached_to='l'/>{solid('l', 0.1)}</model>"
        + solid("m", 0.1, "<pose>0.1 0 0 0 0 0</pose>")
        + weld.format("m", "inner::f")
        + f"</model><model name='b'><pose>0 1 0 0 0 0</pose>{solid('l', 0.1)}</model>"
        "<model name='c'><static>1</static><model name='inner'><pose>0 2 0 0 0 0</pose>"
        f"{solid('l', 0.1)}</model></model>" + weld.format("world", "b::l") + weld.format("b", "none")
    )
    scene, notes = read_world(world_of(tmp_path, text))
    assert [(item.id, item.fixed) for item in scene.objects] == [
        ("floor", True),
        ("a", False),
        ("b", True),
        ("c::inner", True),
    ]
    assert scene.objects[1].mass == pytest.approx(2.0)
    np.testing.assert_allclose(scene.objects[1].com_in_world, [0.05, 0, 0], atol=1e-9)
    assert "world: the joint j is of none, which is no link; left out" in notes


def test_models_are_where_the_saved_state_has_them(tmp_path: Path) -> None:
    state = "<state world_name='w'><model name='a'><pose>0 0 3 0 0 0</pose></model></state>"
    scene, notes = read_world(world_of(tmp_path, f"<model name='a'>{solid('l', 0.1)}</model>{state}"))
    np.testing.assert_allclose(scene.objects[1].pose.translation, [0, 0, 3])
    assert any("saved state" in note for note in notes)


@pytest.mark.parametrize("base", ["a::nothing", "nothing::l", "a::l::deeper", "b", "b::l"])
def test_frames_that_are_nowhere_or_relative_to_themselves_are_refused(base: str, tmp_path: Path) -> None:
    text = f"<model name='a'>{solid('l', 0.1)}</model>"
    text += f"<model name='b'><pose relative_to='{base}'/>{solid('l', 0.1)}</model>"
    with pytest.raises(InputError) as error:
        read_world(world_of(tmp_path, text))
    assert error.value.code == ErrorCode.FRAME_UNKNOWN
