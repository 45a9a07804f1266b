"""What a diagnosis found, in the user's own model: written where it belongs, and every other byte as it was."""

import json
import re
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from poise.errors import PoiseError
from poise.exporting.models import JointChange, LinkLoad, ModelChanges, model_exporter_of
from poise.inertia import InertialParameters

MJCF = b"""<?xml version="1.0"?>
<!-- Arm of the lab, by hand. -->\r
<mujoco model='arm'>
  <compiler angle="radian"/>  <!-- angles > 0 are to the left -->
  <default><joint damping="0.3" frictionloss='0.1'/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <joint   name="one" axis="0 0 1"   damping = '9'/><site name="a > b, damping = 'c'"/>
      <geom type="capsule" size=".03 .1"/>
      <body name="lower" pos="0 0 0.2"><joint name='two' axis="0 1 0"></joint>
        <geom type="capsule" size=".02 .1"/>
        <body name="held"><geom type="box" size=".02 .02 .02"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
URDF = b"""<robot name="arm">
  <link name="base"/><link name="upper"><inertial><mass value="1"/><origin xyz="0 0 .1"/>
    <inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="held"/>
  <joint name="one" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <dynamics  damping="0.2" /></joint>
  <joint name="two" type="continuous">
    <parent link="upper"/><child link="held"/>
  </joint>
</robot>
"""
SDF = b"""<sdf version="1.9"><model name="arm"><link name="upper"/><link name="held"/>
  <joint name="one" type="revolute"><parent>world</parent><child>upper</child>
    <axis><xyz>0 0 1</xyz><dynamics><damping>0.2</damping></dynamics></axis></joint>
  <joint name="two" type="revolute"><parent>upper</parent><child>held</child>
    <axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>
"""
SOURCES = {"mjcf": MJCF, "urdf": URDF, "sdf": SDF, "json": b""}
LOAD = InertialParameters(
    0.7, np.array([0.01, -0.02, 0.05]), np.array([[3e-3, 2e-4, 0], [2e-4, 2.5e-3, 0], [0, 0, 2e-3]])
)
CHANGES = ModelChanges(
    {"one": JointChange(1.25, 2.5, 0.125), "two": JointChange(friction=0.5)}, LinkLoad("held", LOAD), ("backlash, no",)
)


def written(kind: str, changes: ModelChanges = CHANGES) -> bytes:
    return model_exporter_of(kind).changed(changes, SOURCES[kind]).content


def test_mujoco_reads_what_was_written() -> None:
    model = mujoco.MjModel.from_xml_string(written("mjcf").decode())
    assert np.ravel(model.dof_frictionloss).tolist() == [1.25, 0.5]
    assert np.ravel(model.dof_damping).tolist() == [2.5, 0.3]  # the second is that of the default
    assert np.ravel(model.dof_armature).tolist() == [0.125, 0.0]
    held = model.body("held")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, held.iquat)
    principal = turn.reshape(3, 3)
    assert held.mass[0] == 0.7
    assert np.allclose(held.ipos, LOAD.com)
    assert np.allclose(principal @ np.diag(held.inertia) @ principal.T, LOAD.inertia, atol=1e-9)


def test_a_urdf_has_the_values_and_says_what_it_cannot_hold() -> None:
    text = written("urdf").decode()
    robot = ElementTree.fromstring(text)
    dynamics = {joint.get("name"): joint.find("dynamics").attrib for joint in robot.iter("joint")}  # type: ignore[union-attr]
    assert dynamics == {"one": {"damping": "2.5", "friction": "1.25"}, "two": {"friction": "0.5"}}
    masses = {link.get("name"): link.find("inertial/mass") for link in robot.iter("link")}
    assert masses["held"].get("value") == "0.7"  # type: ignore[union-attr]
    assert "not written: backlash, no" in text
    assert "not written: armature" in text


def test_an_sdf_has_the_values() -> None:
    model = ElementTree.fromstring(written("sdf"))
    found = [
        {each.tag: float(each.text or "") for each in joint.findall("axis/dynamics/*")} for joint in model.iter("joint")
    ]
    assert found == [{"friction": 1.25, "damping": 2.5}, {"friction": 0.5}]
    assert model.findtext("model/link[@name='held']/inertial/mass") == "0.7"


def test_json_has_the_names_of_isaac_lab() -> None:
    content = json.loads(written("json"))
    assert content["isaac_lab"]["viscous_friction"] == {"one": 2.5}
    assert content["isaac_lab"]["dynamic_friction"] == content["isaac_lab"]["friction"] == {"one": 1.25, "two": 0.5}
    assert content["payload"]["mass"] == 0.7
    assert content["not_written"] == ["backlash, no"]


@pytest.mark.parametrize("kind", ["mjcf", "urdf", "sdf"])
def test_every_other_byte_stays(kind: str) -> None:
    """Without what was inserted, and with the old values back, the file is the old one."""
    source, text = SOURCES[kind], written(kind, ModelChanges({"one": JointChange(damping=2.5)}))
    text = re.sub(rb"<!-- changed by poise mismatch:.*?-->\n", b"", text, flags=re.DOTALL)
    old = {"mjcf": b"damping = '9'", "urdf": b'damping="0.2"', "sdf": b"<damping>0.2<"}[kind]
    new = {"mjcf": b'damping="2.5"', "urdf": b'damping="2.5"', "sdf": b"<damping>2.5<"}[kind]
    assert text.count(new) == 1
    assert text.replace(new, old) == source


@pytest.mark.parametrize(
    ("kind", "source", "changes", "words"),
    [
        ("mjcf", MJCF, {"onne": JointChange(1.0)}, "no joint onne; it has one"),
        ("mjcf", URDF, {"one": JointChange(1.0)}, "root element is <robot>, expected <mujoco>"),
        ("mjcf", MJCF[:-20], {"one": JointChange(1.0)}, "not well-formed"),
        ("mjcf", b'<!DOCTYPE m [<!ENTITY a "b">]>' + MJCF[22:], {"one": JointChange(1.0)}, "entities"),
        ("mjcf", b'<mujoco><include file="a.xml"/></mujoco>', {"one": JointChange(1.0)}, "it names other files"),
        ("urdf", URDF.decode().encode("utf-16"), {"one": JointChange(1.0)}, "not UTF-8"),
        ("sdf", SDF.replace(b'"two"', b'"one"'), {"one": JointChange(1.0)}, "2 joints named one"),
        ("urdf", URDF, {"one": JointChange(armature=1.0)}, "nothing to write: armature"),
        ("urdf", URDF, {}, "names no effect"),
        ("dae", b"", {}, "use one of json, mjcf, sdf, urdf"),
    ],
)
def test_what_cannot_be_written_is_said(kind: str, source: bytes, changes: dict[str, JointChange], words: str) -> None:
    with pytest.raises(PoiseError, match=re.escape(words)):
        model_exporter_of(kind).changed(ModelChanges(changes), source)
