"""A brick of known size on a table: fused, completed, refined; and everything that can be wrong with a scan."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scenes import BRICK, EXACT, SMALL, box, brick_views, views_of
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.fake_robots.rasteriser import Body, Scene
from poise.scanning import Frame, ScanOptions, View, scan, scan_ply
from poise.scanning.fusion import Surface, merged
from poise.scanning.options import DEFAULT_SCAN
from poise.scanning.sweep import Ring
from poise.shape import HIDDEN_OFF, read_cloud
from poise.shape.segmentation import segment

HALF = np.array(BRICK) / 2
MIDDLE = np.array([0.0, 0.0, HALF[2]])


@cache
def brick():
    return scan(brick_views())


def off_brick(points):
    """(N,) m from points to the surface of the brick."""
    q = np.abs(points - MIDDLE) - HALF
    return np.where(np.all(q < 0, axis=1), -q.max(axis=1), np.linalg.norm(np.maximum(q, 0), axis=1))


def refusal(code, views, options=DEFAULT_SCAN):
    with pytest.raises(InputError) as caught:
        scan(views, options)
    assert caught.value.code == code
    return caught.value.message


def test_a_brick_is_found_where_it_is():
    found = brick()
    distance = off_brick(found.points[found.seen])
    assert distance.mean() < 3e-4
    assert np.quantile(distance, 0.99) < 1.5e-3
    assert found.n_objects == 1
    np.testing.assert_allclose(found.plane.normal, [0, 0, 1], atol=2e-3)
    np.testing.assert_allclose(found.foot, [0, 0, 0], atol=1.5e-3)
    np.testing.assert_allclose(np.median(found.colours[found.seen][:, 1:], axis=0) < 0.3, True)


def test_normals_point_out_of_the_brick():
    found = brick()
    inner = MIDDLE + np.clip(found.points - MIDDLE, -0.6 * HALF, 0.6 * HALF)
    outwards = np.einsum("ni,ni->n", found.normals, found.points - inner)
    assert np.mean(outwards > 0) > 0.99


def test_the_bottom_is_completed_on_the_table_and_said():
    found = brick()
    bottom = found.points[~found.seen & (np.abs(found.normals[:, 2] + 1) < 1e-2)]
    bottom = bottom[bottom[:, 2] < 0.01]
    assert np.abs(bottom[:, 2]).max() < 1e-3
    covered = np.ptp(bottom[:, :2], axis=0)
    np.testing.assert_allclose(covered, BRICK[:2], atol=0.006)
    assert np.mean(off_brick(found.points[~found.seen])) < 1.2e-3
    assert any("completed" in note for note in found.notes)
    assert scan(brick_views(), ScanOptions(complete=False)).seen.all()


def test_its_volume_is_right():
    found = brick()
    solid = found.segmented().solid
    assert solid.volume == pytest.approx(np.prod(BRICK), rel=0.08)
    bottom = BRICK[0] * BRICK[1]  # is what was not seen
    sure = segment(found.points, found.colours, normals=found.normals).solid.volume_std
    # Its sides were seen down to the table; a file without the column `doubt` does not say so.
    hidden = np.where(found.seen, 0.0, found.doubt)
    rest = segment(found.points, found.colours, normals=found.normals, seen=found.seen, doubt=hidden).solid.volume_std
    assert np.sqrt(rest**2 - sure**2) == pytest.approx(2e-4 * bottom, rel=0.4)
    sides = bottom + 2 * BRICK[2] * (BRICK[0] + BRICK[1])
    off = found.doubt[found.seen].max()  # of the poses; the same everywhere
    assert np.sqrt(solid.volume_std**2 - rest**2) == pytest.approx(off * sides, rel=0.1)
    less = segment(found.points, found.colours, normals=found.normals, seen=found.seen).solid.volume_std
    assert np.sqrt(less**2 - sure**2) == pytest.approx(HIDDEN_OFF * bottom, rel=0.4)
    assert abs(solid.volume - np.prod(BRICK)) < 2 * solid.volume_std


def test_a_brick_may_be_a_box_upside_down():
    """Both hypotheses are stated: the solid one, and the least that a box without a bottom has."""
    found = brick().segmented()
    inner = np.array(BRICK) - [0.004, 0.004, 0.002]
    assert found.solid.volume_std < 0.1 * np.prod(BRICK)
    assert found.volume_if_hollow < 1.12 * (np.prod(BRICK) - np.prod(inner))
    assert "if it is hollow" in " ".join(found.notes)


def test_air_under_an_arm_is_not_filled():
    block, arm = box((0.05, 0.05, 0.03), (0, 0, 0.015), (0.8, 0.2, 0.1)), (0.06, 0.05, 0.012)
    scene = Scene((block, box(arm, (0.055, 0, 0.012), (0.8, 0.2, 0.1))))
    found = scan(views_of(scene, 24, target=(0.02, 0.0, 0.02))).segmented().solid
    true = 0.05 * 0.05 * 0.03 + np.prod(arm)
    assert found.volume == pytest.approx(true, rel=0.12)
    assert abs(found.volume - true) < 2 * found.volume_std


def test_air_that_views_look_through_is_known_also_from_the_file(tmp_path):
    """Between two jaws, and hardly inside of them, although pixels are 2 mm wide."""
    sides = np.array([[0.05, 0.012, 0.02], [0.04, 0.02, 0.03]])
    middles = np.array([[0, -0.008, 0.01], [0, 0.012, 0.015]])  # 4 mm apart
    bodies = [box(tuple(of), tuple(at), (0.8, 0.2, 0.1)) for of, at in zip(sides, middles, strict=True)]
    found = scan(views_of(Scene(tuple(bodies)), 48))
    depth = np.min(sides / 2 - np.abs(found.air[:, None] - middles), axis=2).max(axis=1)
    assert np.mean(depth < 6e-4) > 0.95
    between = np.all(np.abs(found.air - [0, 0, 0.01]) < [0.02, 0.002, 0.01], axis=1)
    assert between.sum() > 50
    path = tmp_path / "jaws.ply"
    path.write_bytes(scan_ply(found))
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.air, found.air)
    known = partial(segment, normals=cloud.normals, seen=cloud.seen, doubt=cloud.doubt)
    volumes = [known(cloud.points, cloud.colours, air=air).solid.volume for air in (cloud.air, None)]
    assert volumes[0] == pytest.approx(found.segmented().solid.volume, rel=1e-3)
    assert volumes[0] < 0.998 * volumes[1]


def test_a_file_has_the_parts_of_its_scan(tmp_path):
    """Colours rounded to those of a file moved the borders of clusters: a mug had 6 parts, and its file 4."""
    found, path = brick(), tmp_path / "brick.ply"
    path.write_bytes(scan_ply(found))
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.colours, found.colours)
    known = partial(segment, normals=cloud.normals, seen=cloud.seen, doubt=cloud.doubt, air=cloud.air)
    np.testing.assert_array_equal(known(cloud.points, cloud.colours).labels, found.segmented().labels)


def test_the_same_views_give_the_same_cloud():
    one, two = brick(), scan(brick_views())
    np.testing.assert_array_equal(one.points, two.points)
    np.testing.assert_array_equal(one.colours, two.colours)


def test_many_views_are_better_than_their_noise():
    found = scan(brick_views(), ScanOptions(complete=False))
    top = found.points[found.normals[:, 2] > 0.95][:, 2]
    single = brick_views()[0].frame
    assert np.std(top) < 0.35e-3
    assert np.median(single.depth[single.depth > 0]) > 0.2  # where one view has noise of 0.5 mm and steps of 1 mm


def test_poses_that_are_off_are_brought_back():
    rng = np.random.default_rng(5)
    views, wrong = brick_views(), []
    for number, view in enumerate(views):
        gap = 6 <= number < 10
        turn = Rotation.from_rotvec(rng.normal(size=3) * np.deg2rad(1.5 if gap else 0.05)).as_matrix()
        shift = rng.normal(size=3) * (6e-3 if gap else 2e-4)
        wrong.append(replace(view.moved(turn, shift), sure=not gap))
    found = scan(wrong)
    left = scan(wrong, ScanOptions(refine="never"))
    assert found.moved > 2e-3
    assert any("refined" in note for note in found.notes)
    before, after = off_brick(left.points[left.seen]), off_brick(found.points[found.seen])
    assert after.mean() < 0.6 * before.mean()
    assert after.mean() < 6e-4


def test_good_poses_are_left_alone():
    assert brick().moved == 0.0
    assert scan(brick_views(), ScanOptions(refine="always")).moved < 1.5e-3


def test_of_two_objects_the_one_in_the_middle_is_taken_or_the_one_nearest_to_a_point():
    scene = Scene((box(BRICK, (0.0, 0.0, 0.025), (1, 0, 0)), box((0.04, 0.04, 0.04), (0.0, 0.13, 0.02), (0, 0, 1))))
    views = views_of(scene, noise=EXACT, count=16)
    found = scan(views)
    assert found.n_objects == 2
    assert "2 objects" in found.notes[0]
    assert np.abs(found.points[:, 1]).max() < 0.04
    other = scan(views, ScanOptions(near=(0.0, 0.15, 0.0)))
    assert other.points[other.seen][:, 1].min() > 0.1
    assert other.colours[other.seen][:, 2].mean() > 0.4


def test_a_thin_plate_is_not_taken_for_the_table():
    views = views_of(Scene((box((0.15, 0.03, 0.002), (0.0, 0.0, 0.001), (0.9, 0.9, 0.2)),)))
    found = scan(views)
    size = np.ptp(found.points[found.seen], axis=0)
    np.testing.assert_allclose(size[:2], [0.15, 0.03], atol=0.006)
    assert found.points[found.seen][:, 2].mean() == pytest.approx(0.002, abs=4e-4)
    assert segment(found.points, found.colours).solid.volume == pytest.approx(0.15 * 0.03 * 0.002, rel=0.2)


def test_a_level_face_in_two_layers_of_voxels_keeps_its_points():
    """Noise puts the same place into both layers, and their points come to lie on one another."""
    voxel, rng = 1.5e-3, np.random.default_rng(2)
    x, y = np.meshgrid(voxel * np.arange(30), voxel * np.arange(20))
    once = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    points = np.concatenate([once, once + rng.normal(scale=0.05 * voxel, size=once.shape), [[0.5, 0.5, 0.0]]])
    weights = np.append(np.ones(len(points) - 1), 9.0)
    left = merged(Surface(points, None, np.zeros_like(points), weights), voxel).points
    assert len(left) == len(once)
    assert cKDTree(left).query(once)[0].max() < 0.25 * voxel


def test_a_thin_arm_over_the_table_keeps_the_air_below():
    arm, post = (0.08, 0.03, 0.002), (0.02, 0.05, 0.03)
    scene = Scene((box(post, (-0.04, 0.0, 0.015), (0.5, 0.5, 0.5)), box(arm, (0.01, 0.0, 0.004), (0.5, 0.5, 0.5))))
    found = scan(views_of(scene, 32, ring=Ring(low=0.4, high=1.1, sways=2))).segmented().solid
    assert found.volume == pytest.approx(np.prod(post) + np.prod(arm), rel=0.15)


def test_a_gap_under_an_overhang_stays_open():
    """A beam on two feet: seen through from the sides."""
    feet = [box((0.02, 0.04, 0.03), (x, 0.0, 0.015), (0.5, 0.5, 0.5)) for x in (-0.07, 0.07)]
    beam = box((0.16, 0.04, 0.02), (0.0, 0.0, 0.0401), (0.5, 0.5, 0.5))
    found = scan(views_of(Scene((*feet, beam)), ring=Ring(low=0.15, high=1.0, sways=3), count=32))
    below = (np.abs(found.points[:, 0]) < 0.03) & (found.points[:, 2] < 0.012)
    assert below.sum() < 0.1 * np.sum(np.abs(found.points[:, 0]) < 0.03)


def test_without_a_table_there_is_an_error():
    floating = box(BRICK, (0.0, 0.0, 0.025), (1, 0, 0))
    assert "support plane" in refusal(
        ErrorCode.EMPTY, views_of(Scene((floating,), table=None), 8)
    )  # its top is a plane
    turned = Body(floating.triangles @ Rotation.from_euler("x", 50, degrees=True).as_matrix(), floating.colours)
    assert "no support plane" in refusal(ErrorCode.SCAN_INCOMPLETE, views_of(Scene((turned,), table=None), 8))
    lying = [view.moved(Rotation.from_euler("x", 60, degrees=True).as_matrix(), np.zeros(3)) for view in brick_views()]
    assert "leans by 60 deg" in refusal(ErrorCode.SCAN_INCOMPLETE, lying)


def test_nothing_on_the_table_is_an_error():
    assert "nothing rises" in refusal(ErrorCode.EMPTY, views_of(Scene(()), 8))
    assert "no view" in refusal(ErrorCode.EMPTY, [])


def test_one_side_alone_is_refused():
    assert "sides" in refusal(ErrorCode.SCAN_INCOMPLETE, brick_views()[:1])


def test_a_transparent_hole_is_refused():
    blinded = []
    for view in brick_views():
        frame = view.frame
        there = np.moveaxis(frame.camera.rays, 0, -1) * frame.depth[..., None]
        places = np.concatenate([there, frame.depth[..., None]], axis=-1) @ view.rotation_world_camera.T
        places = places + view.translation_world_camera
        glass = (places[..., 0] > 0.0) & (np.abs(places[..., 1]) < 0.032) & (places[..., 2] > 0.002)
        beyond = (np.abs(places[..., 0] - 0.05) < 0.055) & (np.abs(places[..., 1]) < 0.035)
        blinded.append(replace(view, frame=replace(frame, depth=np.where(glass | beyond, 0, frame.depth))))
    assert "glass" in refusal(ErrorCode.SCAN_INCOMPLETE, blinded)


def test_depth_in_another_unit_or_none_is_told():
    def scaled(view, factor):
        return replace(view, frame=replace(view.frame, depth=(view.frame.depth * factor).astype(np.float32)))

    assert "unit" in refusal(ErrorCode.BAD_INPUT, [scaled(view, 10) for view in brick_views()])
    assert "have depth" in refusal(ErrorCode.SCAN_INCOMPLETE, [scaled(view, 0) for view in brick_views()])


def test_views_that_disagree_altogether_are_refused():
    rng = np.random.default_rng(0)
    wild = [view.moved(np.eye(3), [*rng.normal(scale=0.05, size=2), 0.0]) for view in brick_views()]
    with pytest.raises(InputError) as caught:
        scan(wild, ScanOptions(refine="never"))
    assert caught.value.code == ErrorCode.SCAN_INCOMPLETE


def test_a_scan_can_be_cancelled():
    shares = []
    with pytest.raises(NoAnswerError) as caught:
        scan(brick_views(), progress=shares.append, cancelled=lambda: len(shares) > 1)
    assert caught.value.code == ErrorCode.CANCELLED
    assert len(shares) == 2


def test_colours_may_be_missing():
    grey = [replace(view, frame=replace(view.frame, colours=None)) for view in brick_views()]
    assert scan(grey).colours is None
    assert isinstance(grey[0], View)
    assert isinstance(grey[0].frame, Frame)
    assert grey[0].frame.camera is SMALL


def test_views_without_colours_do_not_take_those_of_others():
    """A colour image that comes late, or not at all: what only its view shows has the colours beside it."""
    views = list(brick_views())
    whole = scan(views)
    for grey, error in ((1, 0.01), (20, 0.05)):
        found = scan([replace(view, frame=replace(view.frame, colours=None)) for view in views[:grey]] + views[grey:])
        np.testing.assert_array_equal(found.points, whole.points)
        assert np.abs(found.colours - whole.colours).mean() < error
