"""SDFormat: masses that follow from densities, friction of two directions, what is left out, versions of models."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from poise.errors import InputError
from poise.worlds import read_world

_FLOOR = (
    '<model name="floor"><static>true</static><link name="l"><collision name="c"><geometry><plane/></geometry>'
    "</collision></link></model>"
)


def _world(*models: str) -> str:
    return f'<sdf version="1.12"><world name="w">{_FLOOR}{"".join(models)}</world></sdf>'


def _collision(size: str, density: str = "", x: float = 0.0, surface: str = "", name: str = "c") -> str:
    inside = f"<density>{density}</density>" if density else ""
    return (
        f'<collision name="{name}"><pose>{x} 0 0 0 0 0</pose>{inside}'
        f"<geometry><box><size>{size}</size></box></geometry><surface>{surface}</surface></collision>"
    )


def _model(link: str, name: str = "m") -> str:
    return f'<model name="{name}"><pose>0 0 0.05 0 0 0.3</pose><link name="l">{link}</link></model>'


def test_masses_follow_from_densities(tmp_path: Path) -> None:
    """`inertial auto`: of the collision, else of the link, else 1000 kg/m3; two boxes have their common centre."""
    file = tmp_path / "w.sdf"
    cube = "0.1 0.1 0.1"
    file.write_text(
        _world(
            _model('<inertial auto="true"/>' + _collision("0.1 0.2 0.1"), "default"),
            _model('<inertial auto="true"><density>300</density></inertial>' + _collision(cube), "link"),
            _model(
                '<inertial auto="true"><density>300</density></inertial>'
                + _collision(cube, "2000")
                + _collision(cube, "500", 0.1, name="d"),
                "two",
            ),
            _model('<inertial auto="true"><mass>3</mass></inertial>' + _collision(cube, "500"), "mass"),
        )
    )
    assembly, notes = read_world(file)
    items = {item.id: item for item in assembly.objects}
    assert [items[name].mass for name in ("default", "link", "two", "mass")] == pytest.approx([2.0, 0.3, 2.5, 3.0])
    turn = items["two"].pose.rotation
    np.testing.assert_allclose(items["two"].com_in_world, [0, 0, 0.05] + turn @ [0.02, 0, 0], atol=1e-9)
    # Two cubes on a line, by the parallel axes: 2.5 (0.1^2 / 6) + 2 (0.02^2) + 0.5 (0.08^2) about y and z.
    about_x, about_y = 2.5 * 0.01 / 6, 2.5 * 0.01 / 6 + 2 * 0.02**2 + 0.5 * 0.08**2
    inertia = turn.T @ items["two"].inertia_in_world @ turn
    np.testing.assert_allclose(inertia, np.diag([about_x, about_y, about_y]), atol=1e-9)
    np.testing.assert_allclose(np.diag(items["mass"].inertia_in_world), 3 * 0.01 / 6)
    assert not any("1 kg" in note for note in notes)


def test_a_density_is_positive(tmp_path: Path) -> None:
    """It is named, with the collision."""
    file = tmp_path / "w.sdf"
    file.write_text(_world(_model('<inertial auto="true"/>' + _collision("1 1 1", "-2"))))
    with pytest.raises(InputError, match=r"m::l::c: density is -2 kg/m3"):
        read_world(file)


def test_the_slippery_direction_of_a_surface_counts(tmp_path: Path) -> None:
    """Of `mu` and `mu2` the least."""
    file = tmp_path / "w.sdf"
    surface = "<friction><ode><mu>0.6</mu><mu2>0.25</mu2></ode></friction>"
    file.write_text(_world(_model("<inertial/>" + _collision("0.1 0.1 0.1", surface=surface))))
    assert read_world(file)[0].friction_between("floor", "m") == 0.25


def test_what_changes_the_motion_is_said(tmp_path: Path) -> None:
    """Links without gravity, with masks, and kinematic ones; nothing is said of a link with gravity."""
    file = tmp_path / "w.sdf"
    mask = "<contact><collide_bitmask>2</collide_bitmask></contact>"
    box = "<inertial/>" + _collision("0.1 0.1 0.1")
    file.write_text(
        _world(
            _model("<gravity>false</gravity>" + box, "a"),
            _model("<inertial/>" + _collision("0.1 0.1 0.1", surface=mask), "b"),
            _model("<kinematic>1</kinematic>" + box, "c"),
            _model("<gravity>true</gravity><kinematic>0</kinematic>" + box, "d"),
        )
    )
    notes = read_world(file)[1]
    assert next(note for note in notes if note.startswith("a::l")).endswith("it has its weight")
    assert next(note for note in notes if note.startswith("b::l")).startswith("b::l: its collide_bitmask is left out")
    assert next(note for note in notes if note.startswith("c::l")).startswith("c::l: it is kinematic")
    assert not [note for note in notes if note.startswith("d::l")]


def test_the_newest_version_of_a_model_is_read(tmp_path: Path) -> None:
    """1.10 is newer than 1.9; an entry without a version is the oldest."""
    folder = tmp_path / "models" / "bin"
    folder.mkdir(parents=True)
    entries = "".join(f'<sdf version="1.{n}">{n}.sdf</sdf>' for n in (6, 10, 9)) + "<sdf>0.sdf</sdf>"
    (folder / "model.config").write_text(f"<model><name>bin</name>{entries}</model>")
    for n in (6, 9, 10):
        model = _model("<inertial/>" + _collision(f"{n} 1 1"), "bin")
        (folder / f"{n}.sdf").write_text(f'<sdf version="1.{n}">{model}</sdf>')
    file = tmp_path / "w.sdf"
    file.write_text(_world("<include><uri>models/bin</uri></include>"))
    assert read_world(file)[0].objects[1].shape.size == (10.0, 1.0, 1.0)


def test_a_submesh_is_said_to_be_the_whole_mesh(tmp_path: Path) -> None:
    """Also of what does not move."""
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "a.stl")
    mesh = "<mesh><uri>a.stl</uri>{}</mesh>"
    file = tmp_path / "w.sdf"
    whole = (
        '<model name="{0}"><static>1</static><link name="l"><collision name="c"><geometry>{1}</geometry></collision>'
        "</link></model>"
    )
    file.write_text(
        _world(
            whole.format("part", mesh.format("<submesh><name>lid</name></submesh>")),
            whole.format("all", mesh.format("")),
        )
    )
    notes = read_world(file)[1]
    assert [note for note in notes if "submesh" in note] == [
        "part::l: a submesh is not read alone; the whole mesh is taken"
    ]
