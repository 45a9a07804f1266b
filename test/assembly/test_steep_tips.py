"""Steep meshes carry a plate on their tips, where no facet faces the contact."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, Mesh, RigidObject
from poise.geometry import Pose


@pytest.mark.parametrize("slope", [0.29, 0.8, 3.0])
def test_a_plate_stands_on_the_tips_of_three_pyramids(slope: float) -> None:
    """`slope`: half the base over the height; the facets of the steepest are 73 degrees from the contact's normal."""
    half = 0.1 * slope
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0], [0, 0, 0.1]])
    mesh = Mesh(corners, np.array([(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]))
    far = 1.1 * max(half, 0.03)
    places = [(2 * far * np.cos(a), 2 * far * np.sin(a), 0.0) for a in np.array([1, 5, 9]) * np.pi / 6]
    carriers = [RigidObject(f"tip_{k}", mesh, Pose(np.eye(3), np.array(p)), fixed=True) for k, p in enumerate(places)]
    plate = RigidObject("plate", Box((5 * far, 5 * far, 0.02)), Pose(np.eye(3), np.array([0, 0, 0.11])), mass=0.5)
    analysis = Analysis.of(Assembly((*carriers, plate), friction=0.5))
    assert analysis.stability().stable
    assert len(analysis.structure.interfaces) == 3
