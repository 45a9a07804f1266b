"""Robot descriptions as input: they are parsed, errors are named, no other file is opened."""

import contextlib

import numpy as np
import pytest
from urdf_parts import joint, link, robot

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel, frame_poses
from poise.robot.model import MODELS

FR3 = (MODELS / "fr3.urdf").read_text()


ARM = robot(
    link("base"),
    link("upper", 1.0),
    link("lower", 1.0),
    link("ft_sensor", 0.5),
    link("hand", 2.0, "0 0 0.2"),
    link("finger", 0.1, "0.1 0 0"),
    link("wheel", 3.0),
    joint("turn", "continuous", "base", "upper"),
    joint("bend", "revolute", "upper", "lower", '<mimic joint="turn" multiplier="-2" offset="0.1"/>', at="1 0 0"),
    joint("mount", "fixed", "lower", "ft_sensor", at="1 0 0"),
    joint("grip", "fixed", "ft_sensor", "hand", at="0 0 0.1"),
    joint("finger_joint", "prismatic", "hand", "finger"),
    joint("roll", "continuous", "base", "wheel"),
)


def refused(text, code=ErrorCode.ROBOT_DESCRIPTION_INVALID):
    with pytest.raises(InputError) as caught:
        RobotModel.from_urdf(text)
    assert caught.value.code is code
    return caught.value.message


def test_only_joints_that_move_the_sensor_are_asked_for():
    assert RobotModel.from_urdf(ARM).joint_names == ("turn",)  # not the mimic, the finger, nor the wheel


def test_a_mimic_joint_follows_and_a_continuous_joint_turns_without_end():
    model = RobotModel.from_urdf(ARM)
    angle = 0.7 + 2 * np.pi
    _, place = frame_poses(model, [[angle]])
    bent = angle + (-2 * angle + 0.1)
    np.testing.assert_allclose(place[0], [np.cos(angle) + np.cos(bent), np.sin(angle) + np.sin(bent), 0], atol=1e-12)
    assert np.isinf(model.upper[0])


def test_what_hangs_beyond_the_sensor_is_weighed_about_it():
    load = RobotModel.from_urdf(ARM).load_in_sensor
    assert load[0] == pytest.approx(2.1)  # hand and finger; the sensor's own link is the robot's side
    np.testing.assert_allclose(load[1:4], [0.01, 0.0, 2.0 * 0.3 + 0.1 * 0.1])
    assert load[4] == pytest.approx(0.2 + 2.0 * 0.3**2 + 0.1 * 0.1**2)


def test_joint_states_are_read_by_name_and_extra_joints_ignored():
    model = RobotModel.from_file("fr3")
    shuffled = ["finger", *reversed(model.joint_names)]
    (ordered,) = model.order(shuffled, [[99.0, 7, 6, 5, 4, 3, 2, 1]])
    np.testing.assert_array_equal(ordered, [[1, 2, 3, 4, 5, 6, 7]])


def test_another_robots_joint_states_are_not_read_as_zeros():
    with pytest.raises(InputError, match="another robot's") as caught:
        RobotModel.from_file("fr3").order(["joint1", "joint2"], [[0.0, 0.0]])
    assert caught.value.code is ErrorCode.JOINT_MISSING


def test_a_missing_joint_is_named():
    model = RobotModel.from_file("fr3")
    with pytest.raises(InputError, match=r"lack fr3_joint4;") as caught:
        model.order([name for name in model.joint_names if name != "fr3_joint4"], np.zeros((3, 6)))
    assert caught.value.data["missing"] == ["fr3_joint4"]


def test_an_unknown_frame_names_those_near_it():
    with pytest.raises(InputError, match="ft_sensor") as caught:
        RobotModel.from_urdf(FR3, "ft_sensr")
    assert caught.value.code is ErrorCode.FRAME_UNKNOWN


def test_a_file_that_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="nowhere") as caught:
        RobotModel.from_file(tmp_path / "nowhere.urdf")
    assert caught.value.code is ErrorCode.FILE_UNREADABLE


BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>'
PEEK = '<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]><robot name="&f;"><link name="ft_sensor"/></robot>'


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "well-formed"),
        ("<robot", "well-formed"),
        ("<sdf/>", "<robot>"),
        (BOMB, "entities"),
        (PEEK, "entities"),
        (" " * 10_000_001, "characters"),
        ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>', "expand it"),
        (robot(), "one root link"),
        (robot(link("a"), link("b")), "a, b"),
        (robot(link("a"), link("a")), "two links"),
        (robot("<link/>"), "no name"),
        (robot(link("a"), joint("j", "fixed", "a", "ghost")), "ghost"),
        (robot(link("a"), link("b"), joint("j", "fixed", "a", "b"), joint("k", "fixed", "b", "a")), "circle"),
        (
            robot(link("a"), link("b"), link("c"), joint("j", "fixed", "b", "c"), joint("k", "fixed", "c", "b")),
            "circle",
        ),
        (robot(link("a"), link("b"), joint("j", "fixed", "a", "b"), joint("k", "fixed", "a", "b")), "two joints"),
        (robot(link("a", "nan")), "mass"),
        (robot(link("a", "heavy")), "heavy"),
        (robot(link("a", 1, "0 0")), "three numbers"),
        (robot(link("a"), link("b"), joint("j", "revolute", "a", "b").replace("0 0 1", "0 0 0")), "length zero"),
        (
            robot(link("a"), link("b"), joint("j", "fixed", "a", "b").replace("<origin", '<origin rpy="0 -90 0"')),
            "in rad, not in degrees",
        ),
        (robot(link("a"), link("b"), joint("j", "revolute", "a", "b", at="0 0 333")), "in m, not in mm"),
        (robot(link("a"), link("b", 0.001), joint("j", "revolute", "a", "b")), "give kg m2"),
        (robot(link("a"), link("b"), joint("j", "banana", "a", "b")), "cannot be built"),
        (robot(link("a"), link("b"), joint("j", "revolute", "a", "b", '<mimic joint="ghost"/>')), "ghost"),
    ],
)
def test_a_bad_description_is_refused_with_its_reason(text, why):
    assert why in refused(text)


def test_a_planar_joint_below_the_sensor_is_refused_with_advice():
    text = robot(link("floor"), link("ft_sensor"), joint("drive", "planar", "floor", "ft_sensor"))
    assert "odom" in refused(text, ErrorCode.UNSUPPORTED)


def test_meshes_are_not_opened():
    mesh = '<visual><geometry><mesh filename="package://elsewhere/not_there.stl"/></geometry></visual>'
    RobotModel.from_urdf(FR3.replace('<link name="tcp"/>', f'<link name="tcp">{mesh}</link>'))


def test_descriptions_damaged_anywhere_are_read_or_refused():
    """Never a crash, never another exception: 300 random edits."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        at = int(rng.integers(len(FR3)))
        cut = int(rng.integers(1, 40))
        noise = "".join(chr(c) for c in rng.integers(32, 127, int(rng.integers(0, 6))))
        with contextlib.suppress(InputError):
            RobotModel.from_urdf(FR3[:at] + noise + FR3[at + cut :])
