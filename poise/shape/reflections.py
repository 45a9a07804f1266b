"""The mirror image of an object in a glossy table, which a camera sees below the table as if it were there.

Object and image together are one solid, twice as large, and symmetric about the table. So are many objects; but of the
image fewer points are seen, and their density changes at the plane of symmetry, and nowhere else.
"""

import numpy as np
from scipy.spatial import cKDTree

from poise.shape.solid import Solid, part_moments
from poise.types import Array

_FEWER, _SIGMAS = 1.5, 6.0
"""Ratio of the numbers of points on both sides of the plane, and its sigmas, from which on one side may be an image."""
_NEAR, _FAR = 0.25, 0.6
"""Shares of the height over the plane up to which they are counted: the ratio holds beside the plane, too."""
_ALIKE, _MOST_OFF = 0.95, 2.0
"""Share of the image's points that lie within these spacings of a point of the object, when it is reflected."""


def has_mirror_image(solid: Solid, points: Array, spacing: float) -> bool:
    """Whether one half of a solid is likely the mirror image of the other half.

    Args:
        solid: of the points.
        points: (N, 3) m, all of the cloud.
        spacing: m between the vertices of the solid.
    """
    middle, axes = principal_axes(solid)
    for axis in axes:
        height = (points - middle) @ axis
        if np.count_nonzero(height > 0) < np.count_nonzero(height < 0):
            height, axis = -height, -axis
        top = float(np.quantile(np.abs(height), 0.99))
        if not all(_sparser(height, share * top) for share in (_NEAR, _FAR)):
            continue
        image = height < 0
        reflected = points[image] - 2 * height[image, None] * axis
        off = cKDTree(points[~image]).query(reflected)[0]
        if np.mean(off < _MOST_OFF * spacing) > _ALIKE:
            return True
    return False


def principal_axes(solid: Solid) -> tuple[Array, Array]:
    """(3,) m, the centre of the volume, and (3, 3) principal axes as rows."""
    (moments,) = part_moments(solid, np.zeros(len(solid.tetrahedra), dtype=np.int64))
    middle = moments[:3, 3] / moments[3, 3]
    return middle, np.linalg.eigh(moments[:3, :3] / moments[3, 3] - np.outer(middle, middle))[1].T


def _sparser(height: Array, reach: float) -> bool:
    """Whether clearly fewer points are below than above a plane, as far as a reach."""
    above, below = np.count_nonzero((height > 0) & (height < reach)), np.count_nonzero((height < 0) & (height > -reach))
    return bool(above > _FEWER * below and above - below > _SIGMAS * np.sqrt(above + below))
