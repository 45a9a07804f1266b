"""Camera poses brought into agreement: each view against the cloud of the others and the table (point to plane ICP).

Points are paired by looking them up in the depth image (projective association, Blais and Levine 1995), the distance is
that to the plane of the surface (Chen and Medioni 1991), and the kinematics are a prior: where the surface leaves a
motion free, a view stays where the robot says it was.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.scanning.fusion import COARSE, SLANT, Surface, fuse
from poise.scanning.looking import each, look
from poise.scanning.support import Footprint, Plane
from poise.types import Array

_SURE, _UNSURE = (1.5e-3, np.deg2rad(0.3)), (2e-2, np.deg2rad(3.0))
"""One sigma, m and rad, of a pose by kinematics, and of one interpolated over a gap."""
_NOISE = 2e-3
"""m, one sigma of a distance; more than the camera's own, as neighbouring pixels err alike."""
_GATES = (0.02, 0.012, 0.008, 0.005, 0.004)
"""m: pairs farther apart are none; one round each."""
_MODEL_VIEWS, _MODEL_POINTS = 32, 1500
MISFIT = 7e-4
"""m: spread of the table between views from which on poses are refined."""
_LEAST = 60
"""Pairs below which a view is left alone."""


def table_misfit(views: Sequence[View], plane: Plane) -> float:
    """m: how far, robustly, single views see the table from where all of them do."""
    heights = [plane.heights(_on_table(view, plane, 0.02)) for view in views]
    middles = [float(np.median(of_view)) for of_view in heights if len(of_view)]
    return 1.4826 * float(np.median(np.abs(middles))) if middles else 0.0


def refined(views: Sequence[View], footprint: Footprint, voxel: float) -> tuple[list[View], Array]:
    """Views moved to where they agree, and (V,) m by which each moved at the object.

    Raises:
        InputError: as `fuse`.
    """
    sure = [view for view in views if view.sure] or list(views)
    chosen = [sure[i] for i in np.unique(np.linspace(0, len(sure) - 1, _MODEL_VIEWS).round().astype(int))]
    model = fuse(chosen, footprint, 1.5 * voxel)
    few = np.random.default_rng(0).permutation(len(model.points))[:_MODEL_POINTS]
    model = model.select(np.sort(few))
    middle = model.points.mean(axis=0)
    moved = each(views, lambda view: _fit(view, model, middle, footprint.plane))
    shifts = [
        after.translation_world_camera
        - before.translation_world_camera
        + (after.rotation_world_camera @ before.rotation_world_camera.T - np.eye(3))
        @ (middle - before.translation_world_camera)
        for before, after in zip(views, moved, strict=True)
    ]
    return moved, np.linalg.norm(np.array(shifts).reshape(-1, 3), axis=1)


def _fit(view: View, model: Surface, middle: Array, plane: Plane) -> View:
    """Gauss-Newton over the six motions of a camera, turned about the object."""
    place, turn = _SURE if view.sure else _UNSURE
    prior = _NOISE**2 / np.repeat([turn, place], 3) ** 2
    total = np.zeros(6)
    start, now = view, view
    for gate in _GATES:
        rows, distances, weights = _pairs(now, model, middle, plane, gate)
        if len(rows) < _LEAST:
            return view
        weighted = rows * weights[:, None]
        system = weighted.T @ rows + np.diag(prior)
        total = total - np.linalg.solve(system, weighted.T @ distances + prior * total)
        rotation = Rotation.from_rotvec(total[:3]).as_matrix()
        now = start.moved(rotation, middle + total[3:] - rotation @ middle)
    return now


def _pairs(view: View, model: Surface, middle: Array, plane: Plane, gate: float) -> tuple[Array, Array, Array]:
    """(N, 6) how each distance grows with a turn and a shift, (N,) m distances, (N,) weights; nearer pairs count more.

    The table counts as much as the object, however many of its pixels there are.
    """
    looked = look(view, model.points)
    along = np.einsum("ni,ni->n", looked.rays, model.normals)
    facing = -along / np.linalg.norm(looked.rays, axis=1)
    kept = (np.abs(looked.beyond) < gate) & (facing > SLANT)
    normals = model.normals[kept]
    on_object = model.points[kept] + looked.rays[kept] * looked.beyond[kept, None]
    table = _on_table(view, plane, gate)
    points = np.concatenate([on_object, table]) - middle
    normals = np.concatenate([normals, np.tile(plane.normal, (len(table), 1))])
    distances = np.concatenate([(along * looked.beyond)[kept], plane.heights(table)])
    weights = (1 - np.minimum(np.abs(distances) / gate, 1) ** 2) ** 2
    weights[len(on_object) :] *= min(1.0, max(len(on_object), _LEAST) / max(len(table), 1))
    return np.hstack([np.cross(points, normals), normals]), distances, weights


def _on_table(view: View, plane: Plane, gate: float) -> Array:
    """(N, 3) m: pixels that show the table."""
    step = 2 * COARSE
    depth = view.frame.depth[step // 2 :: step, step // 2 :: step]
    rays = view.frame.camera.rays[:, step // 2 :: step, step // 2 :: step]
    known = depth > 0
    there = np.stack([*(rays[:, known] * depth[known]), depth[known]], axis=1).astype(np.float64)
    points = rotated(there, view.rotation_world_camera) + view.translation_world_camera
    return np.asarray(points[np.abs(plane.heights(points)) < gate])
