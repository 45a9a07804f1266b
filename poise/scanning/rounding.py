"""A patch that bulges is no flat side: tangent planes along it, narrow enough that nothing seems to rest on one."""

from itertools import product
from typing import NamedTuple

import numpy as np

from poise.geometry import plane_axes
from poise.scanning.patches import Patch, SurfaceSamples
from poise.types import Array

_STRIP = 0.003
"""m across a tangent plane."""
_TURNED = 0.25
"""rad by which the normal turns across a patch, from which on it is round: about 14 degrees."""
_NARROW = 0.006
"""m across a patch that counts as an edge."""
_SURE = 5.0
"""Standard deviations from 0 that a curvature has to be."""
_MOST = 12
"""Tangent planes in a row."""


class Sides(NamedTuple):
    """Planes of a patch.

    Args:
        planes: (K, 4) normal . x + last = 0, that together are the surface of the patch.
        flat: it is certain that the patch does not bulge, or it is too narrow to rest on.
    """

    planes: Array
    flat: bool


def sides_of(samples: SurfaceSamples, patch: Patch) -> Sides:
    """The planes of a patch: one when it is flat or hollow.

    A quadratic surface is fitted to the points of the patch. Along a principal direction in which it bulges, planes
    touch it at places 3 mm apart.
    """
    flat = np.append(patch.normal, -patch.offset)[None]
    axes = plane_axes(patch.normal)
    points = samples.points[patch.rows]
    middle = points.mean(axis=0)
    along = (points - middle) @ axes.T
    heights = points @ patch.normal - patch.offset
    terms = np.column_stack([np.ones(len(along)), along, along**2 / 2, along.prod(axis=1)])
    if len(along) < 3 * terms.shape[1]:
        return Sides(flat, False)
    weights = np.sqrt(samples.areas[patch.rows]) / samples.noise[patch.rows]
    fitted, *_ = np.linalg.lstsq(terms * weights[:, None], heights * weights, rcond=None)
    left = (heights - terms @ fitted) * weights
    spread = np.linalg.pinv((terms * weights[:, None]).T @ (terms * weights[:, None])) * (left @ left) / len(left)
    hessian = np.array([[fitted[3], fitted[5]], [fitted[5], fitted[4]]])
    bends, turned = np.linalg.eigh(hessian)
    spans = np.ptp(np.quantile(along @ turned, [0.02, 0.98], axis=0), axis=0)
    unsure = _SURE * float(np.sqrt(np.diag(spread)[3:5].max()))
    seen = np.median(samples.noise[patch.rows]) == samples.noise.min()
    counts = [
        min(int(np.ceil(span / _STRIP)), _MOST) if seen and -bend > unsure and -bend * span > _TURNED else 1
        for bend, span in zip(bends, spans, strict=True)
    ]
    if max(counts) == 1:
        most = (np.abs(bends) + unsure) * spans
        return Sides(flat, bool(np.min(spans) < _NARROW or (seen and np.all(most < _TURNED))))
    centre = np.median(along @ turned, axis=0)
    rows = [
        mid + span * ((np.arange(count) + 0.5) / count - 0.5)
        for mid, span, count in zip(centre, spans, counts, strict=True)
    ]
    planes = []
    for place in product(*rows):
        at = turned @ np.array(place)
        height = float(np.array([1.0, *at, *(at**2 / 2), at.prod()]) @ fitted)
        slope = fitted[1:3] + hessian @ at
        normal = patch.normal - slope @ axes
        normal /= np.linalg.norm(normal)
        touched = middle + at @ axes + (height + patch.offset - middle @ patch.normal) * patch.normal
        planes.append(np.append(normal, -normal @ touched))
    return Sides(np.array(planes), False)
