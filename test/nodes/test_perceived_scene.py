"""Assemblies whose poses are uncertain in messages and in the worker: settled, carried on, with intervals."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from assembly_calls import CUBE, FLOOR, FRAME, LID, box, message

from poise.assembly import Assembly, FrictionPair, Push, assess_settled, settle, write_scene
from poise.assembly.scene import pose_covariance_of, scene_content
from poise.assembly.statics import NO_DEADLINE
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about
from poise.nodes.assembly_message import assembly_message, assembly_of, scene_of_node
from poise.nodes.perceived_scene import PerceivedScene, PoseDoubt
from poise.nodes.request_checks import check_assembly
from poise.nodes.transforms import transform_objects

STD = pose_covariance_of(0.002, np.radians(0.5))
MU, G = 0.5, 9.80665


def raised_by(item, height):
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation + np.array([0, 0, height])))


def sunk(depth=0.003):
    """A cube that is seen 3 mm in the floor."""
    return replace(Assembly((FLOOR, raised_by(CUBE, -depth))), objects=(FLOOR, raised_by(CUBE, -depth)))


def test_rolling_and_the_covariance_of_a_pose_survive_the_message():
    pairs = (FrictionPair(("floor", "cube"), 0.3, rolling=0.05),)
    there = Assembly((FLOOR, replace(CUBE, pose_covariance=STD), LID), friction_pairs=pairs, rolling=0.01)
    sent = assembly_message(there, FRAME)
    check_assembly(sent)
    back = assembly_of(sent)
    assert (back.rolling, back.rolling_between("cube", "floor"), back.rolling_between("cube", "lid")) == (
        0.01,
        0.05,
        0.01,
    )
    np.testing.assert_array_equal(back.objects[1].pose_covariance, STD)
    assert back.objects[2].pose_covariance is None


def test_the_uncertain_masses_and_friction_of_a_scene_file_survive_the_message(tmp_path):
    content = scene_content(Assembly((FLOOR, CUBE))) | {"mass_std": 0.1, "friction_deviation": 0.05}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    there = scene_of_node(str(tmp_path / "scene.yaml"))
    sent = assembly_message(there, FRAME)
    check_assembly(sent)
    back = assembly_of(sent)
    assert back.friction_deviation == sent.friction_std == 0.05
    assert back.objects[1].covariance[0, 0] == pytest.approx((0.1 * CUBE.mass) ** 2)
    answer = assess_settled(settle(back), [Push("cube", (-0.5, 0, 0.5), (1, 0, 0))], samples=2)
    assert answer.taken_as_exact == ()


def test_a_scene_file_of_a_node_keeps_its_rolling(tmp_path):
    pairs = (FrictionPair(("floor", "cube"), 0.3, rolling=0.05),)
    write_scene(Assembly((FLOOR, CUBE), friction_pairs=pairs, rolling=0.01), tmp_path / "scene.yaml")
    found = scene_of_node(str(tmp_path / "scene.yaml"))
    assert (found.rolling, found.rolling_between("cube", "floor")) == (0.01, 0.05)


@pytest.mark.parametrize(("entry", "value"), [("rolling", -0.5), ("rolling", 2.0), ("pose_covariance", [1.0] * 35)])
def test_rolling_and_covariances_out_of_range_are_refused(entry, value):
    sent = message(CUBE)
    setattr(sent if entry == "rolling" else sent.objects[1], entry, value)
    with pytest.raises(InputError, match=entry) as raised:
        check_assembly(sent)
    assert raised.value.code == ErrorCode.BAD_INPUT


def test_the_covariance_of_a_pose_turns_with_the_frame():
    sent = message(replace(CUBE, pose_covariance=np.diag([1.0, 4.0, 9.0, 1e-4, 4e-4, 9e-4])))
    transform_objects(sent.objects, Pose(rotation_about([0.0, 0.0, 1.0], np.pi / 2), np.zeros(3)))
    np.testing.assert_allclose(
        np.diag(np.reshape(sent.objects[1].pose_covariance, (6, 6))), [4, 1, 9, 4e-4, 1e-4, 9e-4], atol=1e-12
    )


def test_poses_that_state_nothing_have_the_uncertainty_of_the_node():
    doubt = PoseDoubt(0.002, 0.5, 5)
    exact = replace(LID, pose_covariance=np.zeros((6, 6)))
    found = doubt.applied(Assembly((FLOOR, CUBE, exact)))
    assert found.objects[0].pose_covariance is None
    np.testing.assert_allclose(found.objects[1].pose_covariance, STD)
    assert not np.any(found.objects[2].pose_covariance)
    assert PoseDoubt().applied(sunk()).objects[1].pose_covariance is None


def test_the_answer_is_that_of_the_settled_scene_with_an_interval():
    scene = PerceivedScene.after(None, PoseDoubt(0.002, 0.5).applied(sunk()))
    assert scene.settled.assembly.objects[1].pose.translation[2] == pytest.approx(0.5, abs=1e-4)
    low = Push("cube", (-0.5, 0, 0.1), (1, 0, 0))
    found, intervals, notes = scene.answered([low], "", 30.0, 10)
    ((lower, upper),) = intervals
    assert lower <= found.results[0].robustness <= upper
    assert found.results[0].robustness == pytest.approx(MU * G, rel=1e-3)  # sliding: no pose changes it
    assert "over 10 draws" in notes[0]
    assert any(sentence.startswith("1 poses settled: moved by up to 3.00 mm") for sentence in scene.notes(NO_DEADLINE))


def test_points_of_pushes_may_be_on_the_object_as_it_was_seen_or_as_it_was_settled():
    """A push along the top of a tall box topples it at m g a / h, wherever its point was read."""
    seen = replace(box("tall", (0.2, 0.2, 1.0), (0, 0, 0.505)), pose_covariance=STD)
    scene = PerceivedScene.after(None, Assembly((FLOOR, seen)))
    for top in (1.005, 1.0):
        found, _, _ = scene.answered([Push("tall", (-0.05, 0, top), (1, 0, 0))], "", 30.0, 0)
        assert found.results[0].robustness == pytest.approx(G * 0.1 / 1.0, rel=2e-3)


def test_another_worker_restores_the_scene_that_was_settled():
    scene = PerceivedScene.after(None, PoseDoubt(0.002, 0.5).applied(sunk()))
    back = PerceivedScene.restored(
        None, *(assembly_of(assembly_message(each, FRAME)) for each in (scene.seen, scene.settled.assembly))
    )
    assert back.uncertain
    pairs = zip(back.settled.assembly.objects, scene.settled.assembly.objects, strict=True)
    assert all(np.allclose(one.pose.translation, other.pose.translation, atol=1e-12) for one, other in pairs)


def test_what_no_pose_explains_is_refused_by_its_code():
    far = PoseDoubt(0.002, 0.5).applied(Assembly((FLOOR, raised_by(CUBE, 0.1))))
    with pytest.raises(InputError, match="nothing holds cube") as raised:
        PerceivedScene.after(None, far)
    assert raised.value.code == ErrorCode.FLOATING
    deep = PoseDoubt(0.002, 0.5).applied(Assembly((FLOOR, CUBE, raised_by(LID, -0.04))))
    with pytest.raises(InputError) as raised:
        PerceivedScene.after(None, deep)
    assert raised.value.code in (ErrorCode.FLOATING, ErrorCode.INTERPENETRATION)
