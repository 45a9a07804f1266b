"""Compiled look-ups in depth images against their form in Python, and with bad input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poise.errors import InputError
from poise.kernels import CompiledLookup, pixels_between
from poise.scanning import Camera, Frame, View
from poise.scanning.fusion import raised_pixels
from poise.scanning.looking import Lookup, lookup

CAMERA = Camera(60, 40, 55.0, 54.0, 29.3, 20.1)
RNG = np.random.default_rng(4)


def seen_by(turn: float) -> View:
    """A bumpy wall 1 m away with holes, from a camera that is turned."""
    depth = (1 + 0.003 * RNG.normal(size=(40, 60))).astype(np.float32)
    depth[RNG.random(depth.shape) < 0.1] = 0
    return View(Frame(0, "camera", CAMERA, depth), Rotation.from_euler("y", turn).as_matrix(), RNG.normal(size=3) / 50)


VIEWS = [seen_by(turn) for turn in (-0.1, 0.0, 0.2)]
POINTS = RNG.uniform([-0.7, -0.5, 0.98], [0.7, 0.5, 1.02], (2000, 3))
POINTS[:50, 2] *= -1  # behind the cameras
NORMALS = np.tile([0.0, 0.0, -1.0], (2000, 1))


def test_points_are_looked_up_as_in_python() -> None:
    compiled, python = lookup(VIEWS), Lookup(VIEWS)
    assert isinstance(compiled, CompiledLookup)
    found = compiled.beyond(POINTS)
    np.testing.assert_array_equal(found, python.beyond(POINTS))
    assert 0.2 < np.isfinite(found).mean() < 0.9
    for one, other in zip(compiled.agreement(POINTS, 0.02), python.agreement(POINTS, 0.02), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-8)
        assert one.any()
    for one, other in zip(
        compiled.offsets(POINTS, NORMALS, 0.02, 0.95), python.offsets(POINTS, NORMALS, 0.02, 0.95), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-9)
        assert one.any()


@pytest.mark.parametrize("step", [1, 3])
def test_pixels_between_two_heights_are_those_of_python(step: int) -> None:
    plane, heights = np.array([0.01, 0.02, -1.0, 1.0]), np.array([-0.002, 0.004])
    given = (VIEWS[0].frame.depth, CAMERA.rays, (2, 60, 0, 39), step, plane, heights, 0.004)
    found = pixels_between(*given)
    np.testing.assert_array_equal(found, raised_pixels(*given))
    assert len(found) > 5


def test_lenses_that_distort_are_left_to_python() -> None:
    bent = replace(VIEWS[0], frame=replace(VIEWS[0].frame, camera=replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0))))
    assert isinstance(lookup([VIEWS[1], bent]), Lookup)


def test_bad_input_is_refused_and_none_gives_nothing() -> None:
    depth = VIEWS[0].frame.depth
    for bad in ([depth], np.zeros((2, 16))), ([depth[0]], np.zeros((1, 16))):
        with pytest.raises(InputError):
            CompiledLookup(*bad)
    with pytest.raises(InputError):
        lookup(VIEWS).beyond(POINTS[:, :2])
    with pytest.raises(InputError):
        pixels_between(depth, CAMERA.rays, (0, 61, 0, 40), 1, np.zeros(4), np.zeros(2), 0.1)
    assert lookup([]).beyond(POINTS).shape == (0, 2000)
    assert lookup(VIEWS).beyond(POINTS[:0]).shape == (3, 0)
    assert not len(pixels_between(depth, CAMERA.rays, (5, 6, 5, 5), 1, np.zeros(4), np.ones(2), 0.1))
