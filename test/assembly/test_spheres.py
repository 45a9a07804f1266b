"""Balls as shapes: contacts, overlap, scene files, settling, commands."""

import json
from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
import rolling_scenes as rolls
import yaml
from assembly_scenes import G
from rolling_scenes import R

from poise.assembly import (
    Analysis,
    Cylinder,
    FrictionPair,
    Push,
    RigidObject,
    Sphere,
    acceleration_limits,
    assess,
    load_scene,
    settle,
    write_scene,
)
from poise.assembly.contact import find_interfaces
from poise.assembly.scene import pose_covariance_of, read_scene
from poise.cli import run
from poise.errors import ErrorCode, InputError

CONTENT = {
    "rolling": 0.01,
    "objects": [
        {"id": "floor", "fixed": True, "box": [2, 2, 0.1], "pose": [0, 0, -0.05, 0, 0, 0, 1]},
        {"id": "marble", "sphere": 0.01, "mass": 0.01, "pose": [0, 0, 0.01, 0, 0, 0, 1]},
    ],
    "friction_pairs": [{"objects": ["floor", "marble"], "coefficient": 0.4, "rolling": 0.03}],
}


def test_a_ball_has_the_volume_and_inertia_of_one_and_a_surface_inside_it():
    shape = Sphere(R)
    assert shape.volume == pytest.approx(4 / 3 * np.pi * R**3)
    np.testing.assert_allclose(shape.inertia_per_mass, 0.4 * R**2 * np.eye(3))
    surface = shape.polyhedron
    assert surface.convex
    np.testing.assert_allclose(np.linalg.norm(surface.vertices, axis=1), R)
    corners = surface.vertices[surface.triangles]
    enclosed = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert enclosed == pytest.approx(shape.volume, rel=0.015)


EDGE = 0.1 / np.sqrt(2)
PLACES = {
    "on a face": (scenes.fixed_box("base", (1, 1, 0.2), (0, 0, -0.1)), (0.1, 0.2, R), (0.1, 0.2, 0)),
    "on an edge": (
        scenes.fixed_box("base", (0.1, 1, 0.1), (0, 0, -EDGE), scenes.turned((0, 1, 0), 45)),
        (0, 0.1, R),
        (0, 0.1, 0),
    ),
    "on a corner": (
        scenes.fixed_box("base", (0.2, 0.2, 0.2), (-0.1, -0.1, -0.1)),
        tuple(R / np.sqrt(3) * np.ones(3)),
        (0, 0, 0),
    ),
    "on a cap": (
        RigidObject("base", Cylinder(0.1, 0.2), scenes.pose((0, 0, -0.1)), fixed=True),
        (0, 0.05, R),
        (0, 0.05, 0),
    ),
    "on a side": (
        RigidObject("base", Cylinder(0.1, 0.4), scenes.pose((0, 0, -0.1), rolls.LYING), fixed=True),
        (0, 0.1, R),
        (0, 0.1, 0),
    ),
    "on a rim": (
        RigidObject("base", Cylinder(0.1, 0.2), scenes.pose((0, 0, -0.1)), fixed=True),
        (0.1 + R * np.sin(0.5), 0, R * np.cos(0.5)),
        (0.1, 0, 0),
    ),
    "on a ball": (RigidObject("base", Sphere(0.1), scenes.pose((0, 0, -0.1)), fixed=True), (0, 0, R), (0, 0, 0)),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("first", [True, False])
def test_a_ball_touches_at_one_point_and_is_pressed_towards_its_centre(place, first):
    base, centre, point = PLACES[place]
    item = RigidObject("ball", Sphere(R), scenes.pose(centre), mass=1.0)
    # A patch for the box of a corner, whose edges run away from it.
    assembly = replace(scenes.on_floor(item), objects=(item, base) if first else (base, item))
    (found,) = find_interfaces(assembly)
    np.testing.assert_allclose(found.points.mean(axis=0), point, atol=1e-9)
    outwards = (np.array(centre) - point) / R * (-1 if first else 1)
    np.testing.assert_allclose(found.normal, outwards, atol=1e-9)


def test_a_gap_is_measured_and_an_overlap_is_refused():
    (found,) = find_interfaces(scenes.on_floor(rolls.ball(z=R + 1e-3)))
    assert found.gap == pytest.approx(1e-3)
    for other in (scenes.fixed_box("other", (0.1, 0.1, 0.1), (R + 0.047, 0, R)), rolls.ball("other", 1.9 * R)):
        with pytest.raises(InputError) as caught:
            Analysis.of(scenes.on_floor(rolls.ball(), other))
        assert caught.value.code is ErrorCode.INTERPENETRATION
        assert caught.value.data["depth"] == pytest.approx(0.003 if other.fixed else 0.1 * R, rel=1e-3)


def test_a_push_beside_the_surface_of_a_ball_is_refused():
    with pytest.raises(InputError) as caught:
        assess(scenes.on_floor(rolls.ball()), [Push("ball", (R + 0.01, 0, R), (-1, 0, 0))])
    assert caught.value.code is ErrorCode.POINT_OFF_SURFACE


def test_scene_files_have_spheres_and_rolling_resistance_and_are_written_again(tmp_path):
    scene = read_scene(CONTENT)
    assert (scene.rolling, scene.rolling_between("marble", "floor")) == (0.01, 0.03)
    assert scene.objects[1].shape == Sphere(0.01)
    write_scene(scene, tmp_path / "again.yaml")
    again = load_scene(tmp_path / "again.yaml")
    assert (again.rolling, again.friction_pairs, again.objects[1].shape) == (
        0.01,
        (FrictionPair(("floor", "marble"), 0.4, rolling=0.03),),
        Sphere(0.01),
    )


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"sphere": -0.01}, ErrorCode.OBJECT_INVALID, "object marble: size is -0.01 m"),
        ({"sphere": [0.01, 0.02]}, ErrorCode.BAD_INPUT, "sphere: expected 1 numbers"),
        ({"sphere": "small"}, ErrorCode.BAD_INPUT, "sphere: expected a number"),
        ({"box": [1, 1, 1]}, ErrorCode.OBJECT_INVALID, "give one of box, cylinder, sphere or mesh"),
        ({"rolling": -1.0}, ErrorCode.BAD_INPUT, "rolling is -1; it may be 0 to 1"),
    ],
)
def test_bad_entries_are_refused_with_how_to_fix_them(change, code, words):
    content = json.loads(json.dumps(CONTENT))
    (content if "rolling" in change else content["objects"][1]).update(change)
    with pytest.raises(InputError, match=words.replace("(", r"\(")) as caught:
        read_scene(content)
    assert caught.value.code is code


def test_the_command_names_what_may_roll(tmp_path, capsys):
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(CONTENT))
    assert run(["robustness", str(tmp_path / "scene.yaml"), "--json", "-"]) == 0
    output = capsys.readouterr()
    (finding,) = json.loads(output.out)["findings"]
    assert (finding["code"], finding["name"]) == (59, "CAN_ROLL")
    assert finding["evidence"] == {"coefficient": 0.03, "force": pytest.approx(0.03 * 0.01 * 9.80665)}
    assert "marble: may roll (neutral equilibrium)" in output.err


def test_a_ball_seen_by_a_camera_is_put_on_what_carries_it():
    seen = replace(rolls.ball(z=R + 0.002), pose_covariance=pose_covariance_of(0.002, 0.01))
    settled = settle(scenes.on_floor(seen))
    assert settled.assembly.objects[1].pose.translation == pytest.approx([0, 0, R], abs=1e-6)
    assert acceleration_limits(settled.assembly, 4, turning=False).limits == pytest.approx(0.002 * G, rel=0.01)
