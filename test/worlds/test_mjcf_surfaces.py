"""MJCF beside MuJoCo: friction of each contact, joints of free bodies, meshes that are no solid, and flags."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from poise.errors import InputError
from poise.worlds import read_world

mujoco = pytest.importorskip("mujoco")

_FLOOR = '<geom name="floor" type="plane" size="1 1 .1" {}/>'
_BOX = '<body name="{}" pos="{} 0 {}"><freejoint/><geom name="g{}" type="box" size=".05 .05 .05" {}/></body>'


def _stack(floor: str, *boxes: str) -> str:
    """Boxes on each other, with attributes of their geoms; they overlap by 10 um, so that MuJoCo reports contacts."""
    bodies = [_BOX.format(f"b{i}", 0, 0.05 + 0.09999 * i, i, each) for i, each in enumerate(boxes)]
    return f"<worldbody>{_FLOOR.format(floor)}{''.join(bodies)}</worldbody>"


@pytest.mark.parametrize(
    "inside",
    [
        _stack('friction=".9"', 'friction=".4"', 'friction=".2"'),
        _stack('friction=".9" condim="1"', 'friction=".4" condim="1"', 'friction=".2"'),
        _stack('friction=".9" condim="1"', 'friction=".4"', 'friction=".2" condim="1"', 'friction=".2" condim="1"'),
        _stack('friction=".9"', 'friction=".3" priority="1"', 'friction=".8"', 'friction=".1" priority="2"'),
        _stack('friction=".9"', 'friction=".3" priority="1" condim="1"', 'friction=".8"'),
        '<option o_friction=".15 .15 .005 .0001 .0001"><flag override="enable"/></option>'
        + _stack('friction=".9"', 'friction=".3"'),
        _stack('friction=".9"', 'friction=".3"', 'friction=".8"')
        + '<contact><pair geom1="floor" geom2="g0" condim="1"/>'
        + '<pair geom1="g1" geom2="g0" condim="3" friction=".6 .25"/></contact>',
    ],
    ids=["greater", "condim", "condim of one", "priority", "both", "override", "pairs"],
)
def test_the_friction_of_each_contact_is_that_of_mujoco(tmp_path: Path, inside: str) -> None:
    """Of an anisotropic pair the least counts; a contact of dimension 1 has none."""
    file = tmp_path / "model.xml"
    file.write_text(f"<mujoco>{inside}</mujoco>")
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assembly, _ = read_world(file)
    names = ["floor", *(f"b{i}" for i in range(model.nbody - 1))]
    found = {}
    for contact in data.contact:
        ends = tuple(sorted(int(model.geom_bodyid[geom]) for geom in contact.geom))
        found[ends] = 0.0 if contact.dim == 1 else float(min(contact.friction[:2]))
    assert sorted(found) == list(pairwise(range(model.nbody)))
    for (one, other), truth in found.items():
        assert assembly.friction_between(names[one], names[other]) == pytest.approx(truth, abs=2e-5)


def test_what_a_free_body_carries_by_joints_is_one_body_with_it(tmp_path: Path) -> None:
    """A cart with four wheels: mass and centre of mass are those of MuJoCo's subtree, and nothing of it is fixed."""
    wheels = "".join(
        f'<body name="w{i}" pos="{x} {y} -.1"><joint axis="0 1 0"/>'
        '<geom type="cylinder" size=".1 .02" euler="90 0 0" mass="1"/></body>'
        for i, (x, y) in enumerate([(0.2, 0.22), (-0.2, 0.22), (0.2, -0.22), (-0.2, -0.22)])
    )
    file = tmp_path / "cart.xml"
    file.write_text(
        f'<mujoco><worldbody>{_FLOOR.format("")}<body name="cart" pos="0 0 .2"><freejoint/>'
        f'<geom type="box" size=".3 .2 .05" mass="10"/>{wheels}</body></worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assembly, notes = read_world(file)
    assert [item.id for item in assembly.objects] == ["floor", "cart"]
    cart = assembly.objects[1]
    assert cart.mass == pytest.approx(float(model.body_subtreemass[1]))
    np.testing.assert_allclose(cart.com_in_world, data.subtree_com[1], atol=1e-9)
    assert any("4 joints on it are taken as rigid" in note for note in notes)


def test_a_mesh_with_a_hole_is_its_hull_as_in_mujoco(tmp_path: Path) -> None:
    """A cube without its top."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.1
    squares = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
    faces = [triangle for a, b, c, d in squares for triangle in ((a, b, c), (a, c, d))]
    vertex, face = (" ".join(map(str, np.ravel(each))) for each in (corners, faces))
    file = tmp_path / "open.xml"
    file.write_text(
        f'<mujoco><asset><mesh name="open" inertia="shell" vertex="{vertex}" face="{face}"/></asset><worldbody>'
        f'{_FLOOR.format("")}<body name="bin" pos="0 0 .1"><freejoint/><geom type="mesh" mesh="open" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    assembly, notes = read_world(file)
    assert assembly.objects[1].shape.volume == pytest.approx(1e-3)
    assert any("open" in note and "convex hull is taken" in note for note in notes)


def test_flags_are_not_passed_over(tmp_path: Path) -> None:
    """Without gravity there is no scene; contacts that are off, and masks, are said."""
    file = tmp_path / "flags.xml"

    def read(option: str, attributes: str) -> str:
        file.write_text(f"<mujoco><option>{option}</option>{_stack('', attributes)}</mujoco>")
        return " ".join(read_world(file)[1])

    with pytest.raises(InputError, match="gravity is 0"):
        read('<flag gravity="disable"/>', "")
    assert "contacts are switched off" in read('<flag contact="disable"/>', "")
    assert "masks (contype, conaffinity) let floor and b0 pass" in read("", 'contype="2" conaffinity="4"')
    assert "masks" not in read("", 'contype="2" conaffinity="1"')
