"""Cameras and depth images: rays and projection undo each other, and invalid calibrations are refused."""

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.scanning.camera import Camera, rotated
from poise.scanning.frames import depth_in_metres

D435_COLOUR = (0.13, -0.25, 0.0006, -0.0004, 0.12)


@pytest.mark.parametrize("distortion", [(), D435_COLOUR, (*D435_COLOUR, 0.1, -0.2, 0.1)])
def test_projecting_what_a_pixel_sees_gives_the_pixel(distortion):
    camera = Camera(160, 120, 150.0, 152.0, 81.0, 58.0, distortion)
    x, y = camera.rays.astype(float)
    points = 0.7 * np.stack([x, y, np.ones_like(x)], axis=-1)
    u, v = camera.project(points)
    columns, rows = np.meshgrid(np.arange(160), np.arange(120))
    np.testing.assert_allclose(u, columns, atol=2e-3)
    np.testing.assert_allclose(v, rows, atol=2e-3)


def test_the_middle_of_the_lens_bends_as_opencv_says():
    # cv2.projectPoints([[0.1, -0.05, 1]], K=(150, 152, 81, 58), D435_COLOUR): by hand, term for term
    x, y = 0.1, -0.05
    r2 = x * x + y * y
    k1, k2, p1, p2, k3 = D435_COLOUR
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = 150 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 81
    v = 152 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 58
    found = Camera(160, 120, 150.0, 152.0, 81.0, 58.0, D435_COLOUR).project(np.array([[x, y, 1.0]]))
    np.testing.assert_allclose(np.ravel(found), [u, v])


def test_rotating_by_components_is_the_matrix_product():
    rng = np.random.default_rng(0)
    points, turn = rng.normal(size=(50, 3)), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    np.testing.assert_allclose(rotated(points, turn), points @ turn.T, atol=1e-14)


@pytest.mark.parametrize(
    ("k", "model", "d", "code"),
    [
        ([0.0] * 9, "plumb_bob", [0.0] * 5, ErrorCode.BAD_INPUT),
        ([np.nan, 0, 1, 0, 1, 1, 0, 0, 1], "plumb_bob", [], ErrorCode.BAD_INPUT),
        ([100, 0, 50, 0, 100, 50, 0, 0, 1], "equidistant", [0.1, 0, 0, 0], ErrorCode.UNSUPPORTED),
        ([100, 0, 50, 0, 100, 50, 0, 0, 1], "plumb_bob", [0.1, 0.0], ErrorCode.UNSUPPORTED),
    ],
)
def test_camera_infos_that_are_none_are_refused(k, model, d, code):
    with pytest.raises(InputError) as caught:
        Camera.from_info(160, 120, k, model, d)
    assert caught.value.code == code


def test_depth_comes_in_millimetres_or_metres():
    whole = depth_in_metres(np.array([[0, 400, 65535]], np.uint16), "16UC1")
    np.testing.assert_allclose(whole, [[0, 0.4, 0]])  # too far is unknown
    broken = depth_in_metres(np.array([[np.nan, 0.4, np.inf, -1.0]], np.float32), "32FC1")
    np.testing.assert_allclose(broken, [[0, 0.4, 0, 0]])
    np.testing.assert_allclose(depth_in_metres(np.array([[4000]], np.uint16), "16UC1", unit=1e-4), [[0.4]])


def test_millimetres_in_floats_are_seen_and_said():
    with pytest.raises(InputError, match="millimetres") as caught:
        depth_in_metres(np.full((10, 10), 400.0, np.float32), "32FC1")
    assert caught.value.code == ErrorCode.BAD_INPUT
    with pytest.raises(InputError, match="rgb8") as caught:
        depth_in_metres(np.zeros((4, 4)), "rgb8")
    assert caught.value.code == ErrorCode.UNSUPPORTED
