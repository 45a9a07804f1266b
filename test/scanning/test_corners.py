"""A table that is seen lower beside the object: found with poses that are off, said, and in the stated uncertainty."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import BRICK, EXACT, box, brick_views, views_of
from scipy.interpolate import RegularGridInterpolator
from test_moves import foreign

from poise.fake_robots.rasteriser import Scene
from poise.scanning import ScanOptions, View, scan
from poise.scanning.corners import sunken
from poise.scanning.table_top import look_at
from poise.types import Array

VOLUME = float(np.prod(BRICK))
DEEP, RADIUS = 1e-3, 0.02
"""m by which the table is seen lower, and how far from the brick."""


def exact_views() -> list[View]:
    return views_of(Scene((box(BRICK, (0.0, 0.0, 0.025), (0.8, 0.2, 0.1)),)), noise=EXACT)


def places_of(view: View) -> Array:
    """(H, W, 3) m in the world, of every pixel."""
    rays = np.concatenate([view.frame.camera.rays, np.ones((1, *view.frame.depth.shape))])
    return np.einsum("ij,jhw->hwi", view.rotation_world_camera, rays * view.frame.depth) + view.translation_world_camera


def in_corners(view: View, table: float, sides: float) -> View:
    """The view with the table beside the brick seen lower by so many m, and upright faces farther inside."""
    depth = view.frame.depth
    places = places_of(view)
    beside = np.linalg.norm(np.maximum(np.abs(places[..., :2]) - np.array(BRICK[:2]) / 2, 0), axis=2)
    on_table, upright = places[..., 2] < 1e-3, (places[..., 2] > 1e-3) & (places[..., 2] < BRICK[2] - 1e-3)
    eye = view.translation_world_camera
    falls, level = eye[2] - places[..., 2], np.linalg.norm(places[..., :2] - eye[:2], axis=2)  # per m of depth
    falls, level = (np.maximum(way, 1e-6) / np.maximum(depth, 1e-6) for way in (falls, level))
    longer = np.where(on_table & (beside < RADIUS), table / np.maximum(falls, 1e-6), 0.0)
    longer = np.where(upright, sides / np.maximum(level, 1e-6), longer)
    changed = np.where(depth > 0, depth + longer, 0).astype(np.float32)
    return replace(view, frame=replace(view.frame, depth=changed))


def found_in(views: list[View]) -> float:
    options = ScanOptions()
    return sunken(views, look_at(views, options)[1], options.farthest).low


def test_it_is_found_where_single_poses_are_off_in_height() -> None:
    views = [in_corners(view, DEEP, 0.0) for view in exact_views()]
    assert found_in(views) == pytest.approx(DEEP, rel=0.1)
    rng = np.random.default_rng(4)
    off = [replace(v, translation_world_camera=v.translation_world_camera + rng.normal(size=3) * 1e-3) for v in views]
    assert found_in(off) == pytest.approx(DEEP, rel=0.15)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 2e-3])
def test_a_flat_table_is_not_lower(noise: float) -> None:
    assert found_in(foreign(exact_views(), noise, seed=5)) == 0.0
    assert found_in(list(brick_views())) == 0.0


def test_the_volume_knows_it_and_a_note_says_so() -> None:
    """Faces pushed back by four times as much as the table: less than two sigmas, and five and more without it."""
    views = [in_corners(view, DEEP, 4 * DEEP) for view in exact_views()]
    found = scan(views, ScanOptions(refine="never"))
    assert [note for note in found.notes if "lower beside the object" in note]
    assert found.doubt is not None
    doubt, up = found.doubt[found.seen], found.normals[found.seen, 2]
    assert doubt[np.abs(up) < 0.1] == pytest.approx(np.hypot(5 * DEEP, found.posed), rel=0.25)
    assert doubt[up > 0.99].max() < 0.1 * 5 * DEEP + found.posed
    solid = found.segmented().solid
    off = VOLUME - solid.volume
    assert 0 < off < 2 * solid.volume_std
    blind = replace(found, doubt=np.where(found.seen, found.posed, found.doubt)).segmented().solid
    assert off > 4 * blind.volume_std


@dataclass(frozen=True)
class Face:
    """A Lambertian rectangle `at` + [0, 1] * `along` + [0, 1] * `up`, m, cut into patches of about 8 mm."""

    at: Array
    along: Array
    up: Array
    normal: Array

    def grid(self) -> tuple[Array, Array]:
        along, up = (
            (np.arange(count) + 0.5) / count
            for count in (max(int(np.linalg.norm(way) / 0.008), 2) for way in (self.along, self.up))
        )
        return along, up

    def patches(self) -> tuple[Array, float]:
        """(N, 3) m, their middles, and the area of each, m2."""
        along, up = self.grid()
        middles = self.at + along[:, None, None] * self.along + up[None, :, None] * self.up
        return middles.reshape(-1, 3), float(np.linalg.norm(np.cross(self.along, self.up))) / middles[..., 0].size

    def late(self, places: Array, other: "Face", eye: Array, albedo: float) -> Array:
        """(N,) m by which places (N, 3) on it are seen too far, of light that falls from the eye on `other` first.

        Each patch of `other` adds light in proportion to what it has itself, and to the solid angle it covers; depth is
        the mean of half of all ways, weighed by their light.
        """
        along, up = self.grid()
        middles, _ = self.patches()
        patches, area = other.patches()
        light, reach = lit(patches, other.normal, eye)
        direct, far = lit(middles, self.normal, eye)
        ways = patches[None] - middles[:, None]
        apart = np.linalg.norm(ways, axis=2)
        seen = np.clip(ways @ self.normal, 0, None) * np.clip(-(ways @ other.normal), 0, None) / apart**2
        share = albedo * seen * area / (np.pi * apart**2 + area) * light / direct[:, None]
        longer = np.sum(share * (apart + reach - far[:, None]) / 2, axis=1) / (1 + share.sum(axis=1))
        table = RegularGridInterpolator(
            (along, up), longer.reshape(len(along), len(up)), bounds_error=False, fill_value=None
        )
        offset = places - self.at
        on_face = [offset @ way / (way @ way) for way in (self.along, self.up)]
        return np.asarray(table(np.clip(np.column_stack(on_face), 0, 1)))


def lit(places: Array, normal: Array, eye: Array) -> tuple[Array, Array]:
    """(N,) light that falls on places from the eye, and (N,) m, how far it is."""
    ways = eye - places
    far = np.linalg.norm(ways, axis=1)
    return np.clip(ways @ normal, 0, None) / far**3, far


UP = np.array([0.0, 0.0, 1.0])
WIDE = 0.3


def shone_on(view: View, albedo: float = 0.5) -> View:
    """The view by a camera that lights the scene and measures the mean way of light, of which some took a corner."""
    eye, places, depth = view.translation_world_camera, places_of(view), view.frame.depth
    lengths = np.linalg.norm(np.concatenate([view.frame.camera.rays, np.ones((1, *depth.shape))]), axis=0)
    later = np.zeros(depth.shape)
    known = depth > 0
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        normal = np.eye(3)[axis] * sign
        half, other = BRICK[axis] / 2, BRICK[1 - axis]
        across = np.eye(3)[1 - axis]
        if (eye - normal * half) @ normal <= 0:
            continue
        wall = Face(normal * half - across * other / 2, across * other, UP * BRICK[2], normal)
        ground = Face(normal * half - across * WIDE, across * 2 * WIDE, normal * WIDE, UP)
        beyond, low = places @ normal - half, places[..., 2] < 1e-3
        on_wall = known & ~low & (np.abs(beyond) < 1e-3) & (places[..., 2] < BRICK[2] - 1e-3)
        on_ground = known & low & (beyond > 0) & (beyond < WIDE) & (np.abs(places @ across) < WIDE)
        later[on_wall] += wall.late(places[on_wall], ground, eye, albedo)
        later[on_ground] += ground.late(places[on_ground], wall, eye, albedo)
    return replace(view, frame=replace(view.frame, depth=(depth + later / lengths).astype(np.float32)))


def test_light_that_table_and_sides_reflect_onto_each_other_is_in_the_volume() -> None:
    """The table is lower at 1 to 4 cm from the sides, and next to them hardly lower than 5 cm away."""
    views = [shone_on(view) for view in exact_views()]
    found = scan(views, ScanOptions(refine="never"))
    assert [note for note in found.notes if "lower beside the object" in note]
    solid = found.segmented().solid
    off = VOLUME - solid.volume
    assert off > 0.1 * VOLUME
    assert off < 2 * solid.volume_std
