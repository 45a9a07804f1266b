"""Assemblies as messages: what is not given is never taken as zero, and every default is stated."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from assembly_calls import CUBE, FLOOR, FRAME, LID, message
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion, Vector3

from poise.assembly import Analysis, Assembly, Box, FrictionPair, Push, RigidObject, Sphere, assess
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.nodes.assembly_message import (
    assembly_message,
    assembly_of,
    assumptions_of,
    notes_of,
    require_body,
    robustness_message,
)
from poise.nodes.transforms import pose_of
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import Robustness as RobustnessMessage

KNOWN = RigidObject("cube", CUBE.shape, CUBE.pose, mass=1.0, com=np.array([0.0, 0.1, 0.2]), inertia=0.2 * np.eye(3))


def test_a_new_message_gives_neither_friction_nor_gravity_nor_com_nor_inertia():
    new = AssemblyMessage(objects=message(CUBE).objects)
    assert new.friction == -1.0
    with pytest.raises(InputError, match="gravity is not given"):
        assembly_of(new)
    new.gravity.z = -9.81
    there = assembly_of(new)
    assert (there.friction, there.objects[1].com, there.objects[1].inertia) == (None, None, None)
    with pytest.raises(InputError, match="friction of floor and cube is not given") as raised:
        Analysis.of(there)
    assert raised.value.code == ErrorCode.BAD_INPUT
    new.friction_pairs = assembly_message(
        Assembly((FLOOR, CUBE), friction_pairs=(FrictionPair(("floor", "cube"), 0.3),)), FRAME
    ).friction_pairs
    assert Analysis.of(assembly_of(new)).structure.interfaces[0].friction == 0.3


def test_an_unset_com_is_the_centroid_and_zero_is_zero_when_it_is_given():
    sent = message(KNOWN).objects[1]
    assert (sent.com_given, sent.inertia_given) == (True, True)
    there = message(CUBE)
    there.objects[1].com_given = True
    with pytest.raises(InputError, match=r"com: .* not finite"):  # as a scene without a centre of mass sends it
        assembly_of(there)
    there.objects[1].inertia.com = Vector3()
    assert assembly_of(there).objects[1].com.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("name", "entry", "value"), [("com", "y", 0.1), ("com", "x", math.inf), ("inertia", "ixx", 1.0)]
)
def test_a_value_without_its_flag_is_refused(name, entry, value):
    there = message(CUBE)
    inertia = there.objects[1].inertia
    setattr(inertia.com if name == "com" else inertia, entry, value)
    with pytest.raises(InputError, match=f"object cube: {name} is .* but {name}_given is false") as raised:
        assembly_of(there)
    assert raised.value.code == ErrorCode.BAD_INPUT


def test_inertia_that_is_zero_is_not_given():
    there = message(KNOWN)
    for entry in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        setattr(there.objects[1].inertia, entry, 0.0)
    with pytest.raises(InputError, match="inertia_given is true, but all numbers are 0"):
        assembly_of(there)


@pytest.mark.parametrize("shape", ["box", "file"])
@pytest.mark.parametrize(("scale", "com"), [(1e3, 0.0), (1e-3, 0.0), (1.0, 50.0), (1.0, -3.0), (1.0, 1.0)])
def test_another_unit_of_sizes_or_of_the_centre_of_mass_is_refused(shape, scale, com, tmp_path):
    there = message(replace(KNOWN, com=np.array([0.0, 0.0, com])))
    sent = there.objects[1]
    if shape == "box":
        sent.primitive.dimensions = [scale] * 3
    else:
        trimesh.creation.box().export(tmp_path / "cube.stl")
        sent.shape, sent.mesh_uri, sent.mesh_scale = sent.SHAPE_URI, str(tmp_path / "cube.stl"), scale
    if (scale, com) == (1.0, 1.0):  # the handle of a pan may be missing in its shape
        assert assembly_of(there, [tmp_path]).objects[1].com[2] == com
        return
    with pytest.raises(InputError, match=r"object cube: (mass per volume|com is .* off its shape)") as raised:
        assembly_of(there, [tmp_path])
    assert raised.value.code == ErrorCode.OBJECT_INVALID


def test_an_inertia_in_another_unit_is_refused():
    slab = RigidObject("slab", Box((2.0, 0.1, 0.1)), CUBE.pose, mass=3.0)
    assert require_body(replace(slab, inertia=slab.inertia_in_world)) is None
    with pytest.raises(InputError, match="inertia is far more than 3 kg"):
        require_body(replace(slab, inertia=1e3 * slab.inertia_in_world))


@pytest.mark.parametrize(
    ("turn", "code"),
    [
        ((0.0, 0, 0, 0), ErrorCode.BAD_INPUT),
        ((0.0, 0, 0, 2), ErrorCode.BAD_INPUT),
        ((0.0, 0, math.nan, 1), ErrorCode.NOT_FINITE),
    ],
)
def test_a_pose_without_a_unit_quaternion_is_refused_in_every_message(turn, code):
    with pytest.raises(InputError) as raised:
        pose_of(PoseMessage(orientation=Quaternion(**dict(zip("xyzw", map(float, turn), strict=True)))))
    assert raised.value.code == code


def test_a_change_gives_an_object_and_a_pair_once():
    there, pair = Assembly((FLOOR, CUBE)), FrictionPair(("floor", "cube"), 0.3)
    assert there.with_object(pairs=[pair]).with_object(pairs=[replace(pair, coefficient=0.4)]).largest_friction == 0.5
    for items, pairs in (((CUBE, CUBE), ()), ((), (pair, FrictionPair(("cube", "floor"), 0.9)))):
        with pytest.raises(InputError, match="given twice"):
            there.with_object(*items, pairs=pairs)


def test_every_default_is_stated_and_many_are_counted():
    assert assumptions_of(Assembly((FLOOR, KNOWN))) == []
    assert assumptions_of(Assembly((FLOOR, KNOWN, LID))) == [
        "lid: com not given; taken at the centroid",
        "lid: inertia not given; taken as that of uniform density",
    ]
    many = [RigidObject(f"c{i}", CUBE.shape, CUBE.pose, mass=1.0, inertia=1e-3 * np.eye(3)) for i in range(20)]
    assert assumptions_of(Assembly((FLOOR, *many)))[-1] == "12 more objects: com not given; taken at the centroid"


def test_friction_that_is_not_given_survives_the_message():
    there = Assembly((FLOOR, CUBE), friction=None, friction_pairs=(FrictionPair(("floor", "cube"), 0.3),))
    assert assembly_of(assembly_message(there, FRAME)).friction is None


def test_a_ball_survives_the_message_rolls_and_is_named():
    floor = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    ball = RigidObject("ball", Sphere(0.05), Pose(np.eye(3), np.array([0, 0, 0.05])), mass=0.4)
    assembly = assembly_of(assembly_message(Assembly((floor, ball)), "world"))
    assert assembly.objects[1].shape == Sphere(0.05)
    found = assess(assembly, [Push("ball", (-0.05, 0, 0.05), (1, 0, 0))]).results[0]
    assert robustness_message(found).mode == RobustnessMessage.MODE_ROLL
    assert any(note.startswith("ball: may roll") for note in notes_of(Analysis.of(assembly)))
