"""How far the centre of mass rises before an object tips: closed forms of boxes, and balls on facets."""

import manifold3d
import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Mesh, RigidObject
from poise.geometry import Pose
from poise.placement import Steady, tipping_rise

TABLE = RigidObject("table", Box((1.0, 1.0, 0.02)), Pose(np.eye(3), np.array([0.0, 0.0, -0.01])), fixed=True)


def on_table(item: RigidObject, *others: RigidObject) -> Analysis:
    return Analysis.of(Assembly((TABLE, *others, item), friction=0.5))


def box(com_x: float = 0.0) -> RigidObject:
    com = np.array([com_x, 0.0, 0.0])
    return RigidObject("box", Box((0.06, 0.04, 0.08)), Pose(np.eye(3), np.array([0.0, 0.0, 0.04])), mass=1.0, com=com)


@pytest.mark.parametrize(("com_x", "lever"), [(0.0, 0.02), (0.02, 0.01), (-0.025, 0.005)])
def test_a_box_tips_over_the_edge_that_is_nearest_to_its_centre_of_mass(com_x: float, lever: float) -> None:
    expected = np.hypot(lever, 0.04) - 0.04
    assert tipping_rise(on_table(box(com_x)), box(com_x)) == pytest.approx(expected, abs=1e-9)


def test_a_box_in_a_corner_of_walls_tips_over_the_same_edges() -> None:
    wall = RigidObject("wall", Box((0.02, 0.5, 0.2)), Pose(np.eye(3), np.array([0.04, 0.0, 0.1])), fixed=True)
    assert tipping_rise(on_table(box(), wall), box()) == pytest.approx(np.hypot(0.02, 0.04) - 0.04, abs=1e-9)


def test_a_ball_of_facets_is_not_steady_however_it_lies() -> None:
    body = manifold3d.Manifold.sphere(0.03, 24).to_mesh64()
    ball = Mesh(np.array(body.vert_properties)[:, :3], np.array(body.tri_verts, dtype=np.int64))
    normals = ball.polyhedron.normals
    for normal in normals[:: len(normals) // 8]:
        turn = turned_down(normal)
        low = float((ball.vertices @ turn.T)[:, 2].min())
        lies = RigidObject("ball", ball, Pose(turn, np.array([0.0, 0.0, -low])), mass=0.1)
        analysis = on_table(lies)
        assert tipping_rise(analysis, lies) < 5e-4
        assert not Steady(1e-3)(analysis, lies)
    assert Steady(1e-3)(on_table(box()), box())


def turned_down(normal: np.ndarray) -> np.ndarray:
    """The rotation that turns a normal downwards."""
    side = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(side, normal) * -1.0, -normal])
