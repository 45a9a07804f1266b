"""First slips of a body on a patch: the compiled form against the one in Python."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Mesh, RigidObject
from poise.assembly.statics import single_patch
from poise.errors import InputError
from poise.geometry import Pose, rotation_about
from poise.kernels import COMPILED, first_slips
from poise.types import Array

pytestmark = pytest.mark.skipif(not COMPILED, reason="the kernels are not installed")
MANY = 300


def wedge(size: Array) -> Mesh:
    """A prism on a triangle, whose table of friction is not that of a rectangle."""
    base = np.array([[0.0, 0.0], [1.0, 0.1], [0.2, 0.8]]) - 0.4
    corners = np.array([[*point, height] for height in (-0.5, 0.5) for point in base]) * size
    faces = [[0, 2, 1], [3, 4, 5], *([i, j, j + 3] for i, j in ((0, 1), (1, 2), (2, 0)))]
    return Mesh(corners, np.array([*faces, *([i, j + 3, i + 3] for i, j in ((0, 1), (1, 2), (2, 0)))]))


def on_floor(seed: int) -> single_patch.SinglePatch:
    """The patch of a box or a prism of random size, turn and friction."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.1, 0.5, 3)
    shape = Box(tuple(size)) if seed % 2 else wedge(size)
    pose = Pose(rotation_about(np.array([0.0, 0.0, 1.0]), rng.uniform(0, 6)), np.array([0.3, -0.2, size[2] / 2]))
    floor = RigidObject("floor", Box((9.0, 9.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    body = RigidObject("body", shape, pose, mass=float(rng.uniform(0.2, 3.0)))
    found = Analysis.of(Assembly((floor, body), np.array([0.0, 0.0, -9.81]), float(rng.uniform(0.1, 1.2))))
    patch = found.blocks[0].solvers.single_patch
    assert patch is not None
    return patch


@pytest.mark.parametrize("seed", range(8))
def test_both_forms_find_the_same_collapse(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng, patch = np.random.default_rng([seed, 1]), on_floor(seed)
    loads = rng.normal(size=(MANY, 6)) * [1, 1, 1, 0.2, 0.2, 0.2] * rng.uniform(0.01, 30, (MANY, 1))
    loads[0] = 0.0
    loads[1] = [0, 0, -5.0, 0, 0, 0]
    compiled = patch.collapse(loads)
    monkeypatch.setattr(single_patch, "COMPILED", False)
    python = patch.collapse(loads)
    np.testing.assert_array_equal(compiled.slips, python.slips)
    assert 20 < compiled.slips.sum() < MANY - 20
    np.testing.assert_allclose(compiled.factor, python.factor, rtol=1e-11)


def test_a_push_at_the_centroid_slips_at_friction_times_weight() -> None:
    """The closed form: level pushes through the centroid of the patch do not turn it."""
    patch = on_floor(1)
    mu, weight, azimuth = patch._mu, patch._rest[0], np.linspace(0, 2 * np.pi, MANY)
    level = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(MANY)], axis=1)
    at = np.broadcast_to([0.3, -0.2, 0.0], level.shape)
    found = patch.collapse(np.concatenate([level, np.cross(at, level)], axis=1))
    assert found.slips.all()
    np.testing.assert_allclose(found.factor, mu * weight, rtol=3e-3)


def test_arrays_of_other_shapes_are_refused() -> None:
    with pytest.raises(InputError):
        first_slips(np.ones((5, 2)), np.ones(2), np.ones(6), np.ones((3, 3)), np.ones((4, 3)), (1.0,) * 5)
