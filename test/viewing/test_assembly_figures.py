"""Pictures of assemblies: what the z-buffer sees, the colours of a map, where a mechanism moves things."""

from dataclasses import replace

import numpy as np
import pytest
from assembly_in_pictures import CAN, CUBE, FLOOR, UPRIGHT
from matplotlib.colors import to_rgb

from poise.assembly import Analysis, Assembly, Box, Push, RigidObject, acceleration_limits, assess, robustness_map
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.viewing.assembly_figures import graph_panel, limits_panel, map_panel, mechanism_panel
from poise.viewing.assembly_picture import SurfaceColours, moved, unconfirmed
from poise.viewing.canvas import write_picture
from poise.viewing.z_buffer import NOTHING, PictureCamera, see


@pytest.fixture(scope="module")
def analysis():
    return Analysis.of(Assembly((FLOOR, CUBE, CAN), np.array([0, 0, -9.81])))


def test_a_pixel_sees_the_nearest_triangle_where_it_is():
    """Two parallel triangles, the nearer one over half of the other; seen along -y."""
    far = [[-1, 1, -1], [1, 1, -1], [-1, 1, 1]]
    near = [[-1, 0, -1], [0, 0, -1], [-1, 0, 0]]
    camera = PictureCamera(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), np.array([-1.0, -1.0]), 50.0, 100, 100)
    seen = see(camera, np.array([near, far], dtype=float))
    x, z = np.meshgrid((np.arange(100) + 0.5) / 50 - 1, (np.arange(100) + 0.5) / 50 - 1)
    expected = np.where(x + z < -1, 0, np.where(x + z < 0, 1, NOTHING))
    clear = (np.abs(x + z) > 1e-9) & (np.abs(x + z + 1) > 1e-9)
    np.testing.assert_array_equal(seen.triangle[clear], expected[clear])
    hit = seen.triangle != NOTHING
    np.testing.assert_allclose(seen.points[hit][:, 1], seen.triangle[hit], atol=1e-12)
    np.testing.assert_allclose(seen.points[hit][:, ::2], np.stack([x[hit], z[hit]], axis=1), atol=1e-12)
    assert np.isnan(seen.points[~hit]).all()
    # What is in front of the same pixel is the same wherever the triangle comes in the list.
    again = see(camera, np.array([far, near], dtype=float))
    np.testing.assert_array_equal(again.triangle[hit], 1 - seen.triangle[hit])


def test_the_camera_sees_all_it_is_asked_to_see():
    points = np.random.default_rng(0).normal(size=(50, 3))
    camera = PictureCamera.around(points, (-1, -1, 1), 300, 200, 0.05)
    pixels = camera.project(points)
    assert np.all(pixels >= [0.05 * 300 - 1, 0.05 * 200 - 1])
    assert np.all(pixels <= [0.95 * 300 + 1, 0.95 * 200 + 1])
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)


def test_the_surface_has_the_colours_of_the_points_of_its_own_face(analysis):
    found = robustness_map(analysis, 2000, 0.05)
    towards = found.surface.directions
    colours = np.abs(towards)  # red where pushed along x, green along y, blue along z
    surface = SurfaceColours(found, colours)
    points, normals = np.array([[0.5, 0.2, 0.97], [0.4, 0.2, 1.0]]), np.array([[1.0, 0, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(surface.at(points, normals, np.array([1, 1])), [[1, 0, 0], [0, 0, 1]], atol=1e-9)


def test_a_mechanism_moves_what_moves_as_far_as_asked(analysis):
    push = Push("cube", (-0.5, 0, 0.9), (1, 0, 0))
    (result,) = assess(analysis, [push]).results
    assert result.mode == "slip"
    there = moved(analysis.assembly, result.moves, result.mechanism, 0.3)
    for before, after in zip(analysis.assembly.objects, there.objects, strict=True):
        shift = [0.3, 0, 0] if before.id in result.moves else [0, 0, 0]
        np.testing.assert_allclose(
            after.vertices - before.vertices, np.broadcast_to(shift, before.vertices.shape), atol=1e-6
        )


def test_every_picture_is_written_and_shows_bodies_in_their_colours(analysis, tmp_path):
    push = Push("can", (-0.1, 0, 1.45), (1, 0, 0))
    (result,) = assess(analysis, [push]).results
    panels = [
        map_panel(robustness_map(analysis, 500, 0.1)),
        graph_panel(analysis),
        mechanism_panel(analysis, push, result),
        limits_panel(acceleration_limits(analysis, 12)),
    ]
    for panel in panels:
        assert panel.alt
        path = write_picture([panel], tmp_path / f"{panel.key}.png")
        assert path.read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in write_picture([panels[1]], tmp_path / "graph.svg").read_bytes()[:1000]
    assert "can" in panels[2].alt
    with pytest.raises(InputError) as raised:
        write_picture([panels[0]], tmp_path / "map.gif")
    assert raised.value.code == ErrorCode.UNSUPPORTED
    from matplotlib.image import imread

    picture = imread(tmp_path / "mechanism.png")[..., :3]
    golden = np.array(to_rgb("#e3b23c"))
    hue = picture - picture.mean(axis=-1, keepdims=True)
    assert np.mean(np.linalg.norm(hue - (golden - golden.mean()), axis=-1) < 0.15) > 0.01


def test_a_polar_plot_of_directions_out_of_the_plane_is_refused(analysis):
    with pytest.raises(InputError) as raised:
        limits_panel(acceleration_limits(analysis, np.array([[0.0, 0.0, 1.0]])))
    assert raised.value.code == ErrorCode.UNSUPPORTED


def doubtful_row():
    """Two boxes side by side, asked without time: nothing of the first is confirmed."""
    boxes = [RigidObject(f"b{x}", Box((1, 1, 1)), Pose.from_vector([x, 0, 0.5, *UPRIGHT]), mass=1.0) for x in (0, 1)]
    return Analysis.of(Assembly((FLOOR, *boxes), np.array([0, 0, -9.81])))


def test_doubtful_points_are_striped_and_have_the_colour_of_their_lower_bound():
    row = doubtful_row()
    found = robustness_map(row, 400, 0.1, "limit")
    count = len(found.doubtful)
    assert found.doubtful.all()
    surface = SurfaceColours(found, np.ones((count, 3)))
    places = np.full(400, row.assembly.index["b0"])
    points = np.stack([np.linspace(-0.4, 0.4, 400), np.zeros(400), np.ones(400)], axis=1)
    colours = surface.at(points, np.tile([0.0, 0, 1], (400, 1)), places)[:, 0]
    assert 0.3 < np.mean(colours < 0.5) < 0.7
    surface = SurfaceColours(replace(found, doubtful=np.zeros(count, dtype=bool)), np.ones((count, 3)))
    np.testing.assert_allclose(surface.at(points, np.tile([0.0, 0, 1], (400, 1)), places), 1.0)
    assert f"{count} of {count} points are doubtful" in map_panel(found).alt


def test_what_was_not_computed_in_time_is_not_shown_as_holding_any_force(tmp_path):
    late = robustness_map(doubtful_row(), 100, deadline=0.0)
    assert np.isinf(late.upper).all()
    assert unconfirmed(late).all()
    panel = map_panel(late)
    assert "points are doubtful" in panel.alt
    from matplotlib.image import imread

    picture = imread(write_picture([panel], tmp_path / "late.png"))[..., :3]
    # Red and dark red, the colours of the least force; grey would say that it holds any.
    assert np.mean(picture[..., 0] > 2 * picture[..., 1]) > 0.03


def test_doubtful_limits_and_pushes_say_so(tmp_path):
    row, push = doubtful_row(), Push("b0", (-0.5, 0, 0.9), (1, 0, 0))
    limits = limits_panel(acceleration_limits(row, 12, deadline=0.0))
    assert "12 of 12 are doubtful" in limits.alt
    assert write_picture([limits], tmp_path / "limits.png").stat().st_size > 0
    (result,) = assess(row, [push], "limit").results
    assert "doubtful" in mechanism_panel(row, push, result).alt
    assert "doubtful" not in mechanism_panel(row, push, assess(row, [push]).results[0]).alt
