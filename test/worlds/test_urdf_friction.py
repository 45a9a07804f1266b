"""Friction of URDFs beside PyBullet, of URDFs for Gazebo, and on a floor that is added."""

from pathlib import Path

import pytest

from poise.worlds import read_world

_INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx=".0017" iyy=".0017" izz=".0017" ixy="0" ixz="0" iyz="0"/></inertial>'
)
_TABLE = '<collision><origin xyz="0 0 -0.05"/><geometry><box size="2 2 0.1"/></geometry></collision>'
_BOX = f'{_INERTIAL}<collision><geometry><box size=".1 .1 .1"/></geometry></collision>'


def _contact(value: float) -> str:
    return f'<contact><lateral_friction value="{value}"/></contact>'


def _robot(*links: str, rest: str = "") -> str:
    return f'<robot name="r">{"".join(links)}{rest}</robot>'


def _scene(table: str, box: str, rest: str = "") -> str:
    """A table that is fixed to the world, and a box on it."""
    return _robot(
        f'<link name="world"/><link name="table">{_TABLE}{table}</link><link name="box">{_BOX}{box}</link>',
        '<joint name="j" type="fixed"><parent link="world"/><child link="table"/></joint>'
        '<joint name="k" type="floating"><parent link="world"/><child link="box"/><origin xyz="0 0 .05"/></joint>',
        rest=rest,
    )


def test_coefficients_are_multiplied_as_in_pybullet(tmp_path: Path) -> None:
    """The box slides there at 1.05 times the force that the product holds, and not at 0.95 times."""
    bullet = pytest.importorskip("pybullet")
    file = tmp_path / "scene.urdf"
    file.write_text(_scene(_contact(0.9), _contact(0.4)))
    assembly, _ = read_world(file)
    mu = assembly.friction_between("r::table", "r::box")
    assert mu == pytest.approx(0.36)
    for share, slides in ((0.95, False), (1.05, True)):
        client = bullet.connect(bullet.DIRECT)
        try:
            bullet.setGravity(0, 0, -9.81, physicsClientId=client)
            bodies = []
            for name, shape, value, height in (("table", _TABLE, 0.9, 0.0), ("box", _BOX, 0.4, 0.05)):
                (tmp_path / f"{name}.urdf").write_text(_robot(f'<link name="{name}">{shape}{_contact(value)}</link>'))
                fixed = name == "table"
                bodies.append(
                    bullet.loadURDF(
                        str(tmp_path / f"{name}.urdf"), [0, 0, height], useFixedBase=fixed, physicsClientId=client
                    )
                )
            for _ in range(240):
                here = bullet.getBasePositionAndOrientation(bodies[1], physicsClientId=client)[0]
                low = [here[0], here[1], here[2] - 0.05]
                force = [share * mu * 9.81, 0, 0]
                bullet.applyExternalForce(bodies[1], -1, force, low, bullet.WORLD_FRAME, physicsClientId=client)
                bullet.stepSimulation(physicsClientId=client)
            moved = bullet.getBasePositionAndOrientation(bodies[1], physicsClientId=client)[0][0]
        finally:
            bullet.disconnect(client)
        assert (moved > 0.05) == slides


def test_coefficients_for_gazebo_are_read(tmp_path: Path) -> None:
    """The smaller one of both directions and of both surfaces; a surface without one has Gazebo's default, 1."""
    file = tmp_path / "scene.urdf"
    gazebo = '<gazebo reference="box"><mu1>0.3</mu1><mu2 value="0.25"/></gazebo>'
    file.write_text(_scene("", "", gazebo))
    assembly, notes = read_world(file)
    assert assembly.friction_between("r::table", "r::box") == 0.25
    assert "1 collision shapes have no friction; the default of 1 is taken" in notes
    file.write_text(_scene("", "", gazebo + '<gazebo reference="table"><mu1>0.2</mu1></gazebo><gazebo/>'))
    assembly, notes = read_world(file)
    assert assembly.friction_between("r::table", "r::box") == 0.2
    assert not any("no friction" in note for note in notes)


def test_on_an_added_floor_a_body_has_its_own_friction(tmp_path: Path) -> None:
    """One object of a URDF, and a model of SDFormat."""
    urdf, sdf = tmp_path / "box.urdf", tmp_path / "box.sdf"
    urdf.write_text(_robot(f'<link name="box">{_BOX}{_contact(0.2)}</link>'))
    surface = "<surface><friction><ode><mu>0.3</mu></ode></friction></surface>"
    sdf.write_text(
        f'<sdf version="1.9"><model name="m"><link name="l"><inertial/><collision name="c">{surface}'
        "<geometry><box><size>1 1 1</size></box></geometry></collision></link></model></sdf>"
    )
    assert read_world(urdf, floor=-0.05)[0].friction_between("floor", "r") == 0.2
    assert read_world(sdf, floor=-0.5)[0].friction_between("floor", "m") == 0.3
