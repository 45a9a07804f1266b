"""Many views into one cloud: cropped early, gathered in voxels, then each point brought to where all views see it.

Voxels alone leave a shell as thick as the noise. So every point is looked up again in every view: what others look
through is no surface (flying pixels go), and what remains moves along its normal by the mean of what the views measure
before or behind it, which is the average of a truncated signed distance (Curless and Levoy 1996) where it matters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from poise.errors import ErrorCode, InputError
from poise.kernels import COMPILED, pixels_between
from poise.scanning.camera import rotated
from poise.scanning.frames import View
from poise.scanning.looking import WORKERS, each, in_all
from poise.scanning.support import Footprint
from poise.types import Array, Indices, Mask, Single

COARSE, _COARSEST, _COARSE_PIXELS = 8, 12, 300_000
"""Pixels between those that show the table; at the most in the first look, and how many that takes of all views."""
_JUMP = 0.006
"""m between neighbouring pixels from which on they are of different surfaces."""
BAND = 0.004
"""m before and behind a point within which a measurement is of it."""
SLANT = 0.35
"""Cosine between normal and ray below which a measurement says little about the surface's place."""
_NEIGHBOURS = 14
_CLOSE = 0.25
"""Voxels between points, below which they are of one place."""
_COMPANY, _APART = 3, 5.0
"""Neighbours that a point has, and the spacings within which it has them."""
_FEWEST_VIEWS = ((12, 3), (6, 2), (0, 1))
"""From so many views on, how many have to see a point alike: a turntable's few see each side but once or twice."""
_JUDGES = 2
_THROUGH = 0.5
"""Share of the views of a point that may look through it."""
AGREED = 0.7
"""Share of the object's pixels that views have to agree on: 0.99 did with right poses, 0.75 with some 5 mm off."""
_MOST_STEP = 0.003
_ASKED, _LONELY, _SPARSE = 8, 2.5, 0.01
"""Views that are asked for pixels without neighbours; voxels that these are from all others, and their share of the
voxels, from which on there is surface of sparse depth: at most 0.009 at edges and holes of benchmarks/'s cameras."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Points on what was seen.

    Args:
        points: (N, 3) m in the world.
        colours: (N, 3) 0..1, or None.
        normals: (N, 3) out of the object.
        weights: (N,) pixels that each point was made of.
        agreed: share of what two views or more show of the object, that they agree on.
        sparse: whether some of it gives depth in single pixels only.
    """

    points: Array
    colours: Array | None
    normals: Array
    weights: Array
    agreed: float = 1.0
    sparse: bool = False

    def select(self, kept: NDArray[np.generic]) -> "Surface":
        colours = None if self.colours is None else self.colours[kept]
        some = {"points": self.points[kept], "normals": self.normals[kept], "weights": self.weights[kept]}
        return replace(self, colours=colours, **some)


def coarse_points(views: Sequence[View], farthest: float) -> Array:
    """(N, 3) m in the world: some pixels of every view, up to `farthest` m from the camera."""
    pixels = sum(view.frame.depth.size for view in views)
    step = int(np.clip(np.sqrt(pixels / _COARSE_PIXELS), 1, _COARSEST))

    def of_view(view: View) -> Single:
        depth = view.frame.depth[step // 2 :: step, step // 2 :: step]
        rays = view.frame.camera.rays[:, step // 2 :: step, step // 2 :: step]
        known = (depth > 0) & (depth < farthest)
        return _in_world(view, rays[:, known], depth[known])

    return np.concatenate([np.zeros((0, 3), np.float32), *each(views, of_view)]).astype(np.float64)


def pixels_of(view: View, count: int, farthest: float) -> Single:
    """(N, 3) m in the world: about so many pixels, evenly over the image, up to `farthest` m from the camera."""
    step = max(int(np.sqrt(view.frame.depth.size / count)), 1)
    depth = view.frame.depth[step // 2 :: step, step // 2 :: step]
    known = (depth > 0) & (depth < farthest)
    return _in_world(view, view.frame.camera.rays[:, step // 2 :: step, step // 2 :: step][:, known], depth[known])


def fewest_views(count: int) -> int:
    """How many of some views have to see a point alike."""
    return next(fewest for least, fewest in _FEWEST_VIEWS if count >= least)


def agreement(views: Sequence[View], points: Array) -> tuple[Indices, Indices, Array]:
    """(N,) views that see points (N, 3) m, (N,) that look through them, and (N, 3) toward the cameras of the former."""
    looked = in_all(views, lambda depths: depths.agreement(points, BAND))
    agree, through, toward = (np.sum(shares, axis=0) for shares in zip(*looked, strict=True))
    return agree, through, toward


def is_solid(agree: Indices, through: Indices) -> Mask:
    """(N,) whether few enough views look through a point, of those that `agreement` found."""
    return np.asarray(through <= _THROUGH * (agree + through))


def fuse(views: Sequence[View], footprint: Footprint, voxel: float, agreed: float = AGREED) -> Surface:
    """One cloud of an object, from views whose poses are right.

    Args:
        views: which see it.
        footprint: where it stands.
        voxel: m, spacing of the points.
        agreed: share of the object's pixels that views have to agree on.

    Raises:
        InputError: SCAN_INCOMPLETE when too little of it is left.
    """
    gathered = _gather(views, footprint, voxel)
    surface = _averaged(gathered, views, footprint, voxel, agreed)
    if len(surface.points) < 50:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: only {len(surface.points)} points of the object are seen alike by {fewest_views(len(views))} views;"
            " check that depth and poses fit (hand-eye transform, clocks of camera and joints), or take more views",
        )
    return surface


def _gather(views: Sequence[View], footprint: Footprint, voxel: float) -> Surface:
    """What the views show of the object, averaged in voxels; normals are not known yet."""
    parts = each(views, lambda view: object_pixels(view, footprint, voxel))
    points = np.concatenate([part[0] for part in parts])
    if sparse := _sparse(points, views, footprint, voxel):
        parts = [*parts, *sparse]
        points = np.concatenate([part[0] for part in parts])
    if not len(points):
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE, "scan: no view shows the object's surface with depth; bring the camera nearer"
        )
    if all(colours is None for _, colours in parts):
        weights, mean = voxel_means(voxel, points)
        return Surface(mean, None, np.zeros_like(mean), weights, sparse=bool(sparse))
    weights, mean, shades = voxel_means(voxel, points, np.concatenate([_shades(*part) for part in parts]))
    return Surface(mean, _coloured(mean, shades), np.zeros_like(mean), weights, sparse=bool(sparse))


def _sparse(
    points: Single, views: Sequence[View], footprint: Footprint, voxel: float
) -> list[tuple[Single, NDArray[np.uint8] | None]]:
    """Pixels and colours of surface that gives depth in single pixels only, as what is dark or shiny; none without.

    Such pixels are like those at edges, so they count only where all others (N, 3) are far, and are many.
    """
    if not len(points):
        return []
    tree = cKDTree(voxel_means(voxel, points)[1])

    def lonely(view: View) -> tuple[Single, NDArray[np.uint8] | None]:
        own, colours = object_pixels(view, footprint, voxel, sparse=True)
        if not len(own):
            return own, colours
        far = ~np.isfinite(tree.query(own, distance_upper_bound=_LONELY * voxel)[0])
        return own[far], None if colours is None else colours[far]

    some = np.concatenate([lonely(view)[0] for view in views[:: max(len(views) // _ASKED, 1)]])
    if not len(some) or len(voxel_means(voxel, some)[0]) < _SPARSE * tree.n:
        return []
    return each(views, lonely)


def _shades(points: Single, colours: NDArray[np.uint8] | None) -> Single:
    """(N, 4) RGB 0..255 of a view's points, and 1 where the view has colours; 0 where it has none."""
    shades = np.zeros((len(points), 4), np.float32)
    if colours is not None:
        shades[:, :3], shades[:, 3] = colours, 1.0
    return shades


def _coloured(points: Array, shades: Array) -> Array | None:
    """(N, 3) RGB 0..1 by the means (N, 4) of `_shades`; where no view has any, that of the nearest."""
    known = np.flatnonzero(shades[:, 3] > 0)
    if not len(known):
        return None
    colours = shades[known, :3] / shades[known, 3:] / 255
    if len(known) == len(points):
        return np.asarray(colours)
    return np.asarray(colours[cKDTree(points[known]).query(points, workers=WORKERS)[1]])


def voxel_means(voxel: float, points: Single, *others: NDArray[np.generic]) -> list[Array]:
    """(M,) how many points (N, 3) lie in each voxel, m, that has any; then (M, 3) their means, and those of others."""
    low = points.min(axis=0)
    cell = ((points - low) / np.float32(voxel)).astype(np.int64)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    order = np.argsort(key)  # quicksort is fine: sums do not depend on who comes first by more than rounding
    key = key[order]
    start = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    count = np.diff(np.append(start, len(key))).astype(np.float64)
    sums = [np.add.reduceat(values[order].astype(np.float64), start) for values in (points - low, *others)]
    means = [total / count[:, None] for total in sums]
    return [count, means[0] + low, *means[1:]]


def object_pixels(
    view: View, footprint: Footprint, voxel: float, sparse: bool = False
) -> tuple[Single, NDArray[np.uint8] | None]:
    """(N, 3) m of the pixels that show the object and no edge, and their colours; or of those without neighbours."""
    camera, colours, plane = view.frame.camera, view.frame.colours, footprint.plane
    left, right, top, bottom, distance = _window(view, footprint)
    if right - left < 3 or bottom - top < 3:
        return np.zeros((0, 3), np.float32), None if colours is None else np.zeros((0, 3), np.uint8)
    step = 1 if sparse else max(int(voxel * camera.fx / distance), 1)
    # Most pixels show the table: heights over it first, places only for the rest.
    down = np.append(view.rotation_world_camera.T @ plane.normal, plane.normal @ view.translation_world_camera)
    down[3] -= plane.offset
    part, heights = (left, right, top, bottom), np.array([footprint.floor, footprint.top + 2 * BAND])
    find = single_pixels if sparse else pixels_between if COMPILED else raised_pixels
    row, column = np.divmod(find(view.frame.depth, camera.rays, part, step, down, heights, _JUMP), camera.width)
    points = _in_world(view, camera.rays[:, row, column], view.frame.depth[row, column])
    placed = plane.placed(points)
    kept = footprint.holds(placed[:, 0], placed[:, 1])
    return points[kept], None if colours is None else colours[row[kept], column[kept]]


def raised_pixels(
    depth: Single, rays: Single, part: tuple[int, int, int, int], step: int, plane: Array, heights: Array, jump: float
) -> Indices:
    """`pixels_between` in Python."""
    left, right, top, bottom = part
    cut = depth[top:bottom, left:right]
    height, width = cut.shape
    middle = cut[1:-1:step, 1:-1:step]
    x, y = rays[:, top + 1 : bottom - 1 : step, left + 1 : right - 1 : step]
    down, (low, high) = plane.astype(np.float32), heights.astype(np.float32)
    over = middle * (down[0] * x + down[1] * y + down[2]) + down[3]
    whole = (middle > 0) & (over > low) & (over < high)
    for across, along in ((0, 1), (2, 1), (1, 0), (1, 2)):  # an edge is where a neighbour is far away, or unknown
        neighbour = cut[along : height - 2 + along : step, across : width - 2 + across : step]
        whole &= np.abs(neighbour - middle) < np.float32(jump)
    row, column = np.nonzero(whole)
    return np.asarray((top + 1 + step * row) * depth.shape[1] + left + 1 + step * column)


def single_pixels(
    depth: Single, rays: Single, part: tuple[int, int, int, int], _: int, plane: Array, heights: Array, jump: float
) -> Indices:
    """Those beside pixels without depth, and beside no edge; arguments as of `pixels_between`."""
    left, right, top, bottom = part
    cut = depth[top:bottom, left:right]
    middle, alone = cut[1:-1, 1:-1], np.zeros((bottom - top - 2, right - left - 2), bool)
    edge = middle <= 0
    for across, along in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbour = cut[along : bottom - top - 2 + along, across : right - left - 2 + across]
        unknown = neighbour <= 0
        alone |= unknown
        edge |= ~unknown & (np.abs(neighbour - middle) >= np.float32(jump))
    row, column = np.nonzero(alone & ~edge)
    x, y = rays[:, top + 1 + row, left + 1 + column]
    over = middle[row, column] * (plane[0] * x + plane[1] * y + plane[2]) + plane[3]
    raised = (over > heights[0]) & (over < heights[1])
    return np.asarray((top + 1 + row[raised]) * depth.shape[1] + left + 1 + column[raised])


def _window(view: View, footprint: Footprint) -> tuple[int, int, int, int, float]:
    """Left, right, top, bottom pixel around a footprint, and how far it is, m."""
    camera = view.frame.camera
    box = view.in_camera(footprint.corners)
    distance = float(np.clip(box[:, 2].mean(), 0.05, 5.0))
    if box[:, 2].max() < 1e-2:  # behind the camera
        return 0, 0, 0, 0, distance
    if box[:, 2].min() < 1e-2:
        return 0, camera.width, 0, camera.height, distance
    u, v = camera.project(box)
    left, right = (int(np.clip(value, 0, camera.width)) for value in (u.min(), u.max() + 1))
    top, bottom = (int(np.clip(value, 0, camera.height)) for value in (v.min(), v.max() + 1))
    return left, right, top, bottom, distance


def _averaged(surface: Surface, views: Sequence[View], footprint: Footprint, voxel: float, least: float) -> Surface:
    """Points that views agree on, each where they see it on average."""
    agree, through, toward = agreement(views, surface.points)
    solid, judges, fewest = is_solid(agree, through), min(_JUDGES, len(views)), fewest_views(len(views))
    alone = (agree >= min(_JUDGES, fewest)) & (through == 0)  # flanks of what is round, in a dozen views
    kept = (agree >= fewest) & solid | alone
    judged = agree + through >= judges  # by others than the view that it is from
    alike = solid & (agree >= min(judges, fewest))  # two views that see a place alike do not disagree about it
    agreed = float(surface.weights[alike & judged].sum() / max(surface.weights[judged].sum(), 1e-9))
    if agreed < least:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: the views agree on {agreed:.0%} of what they show of the object only: the hand-eye transform is not"
            " this camera's, the clocks of camera and joint_states differ, or the object moved",
            agreed=agreed,
            disagree=True,
        )
    surface, toward = replace(surface.select(kept), agreed=agreed), toward[kept]
    if len(surface.points) <= _NEIGHBOURS:
        return surface
    surface = replace(surface, normals=normals_of(surface.points, toward))
    offsets = in_all(views, lambda depths: depths.offsets(surface.points, surface.normals, BAND, SLANT))
    weight, sums = (sum(shares) for shares in zip(*offsets, strict=True))
    step = sums / np.maximum(weight, 1e-9)
    moved = surface.points + np.clip(step, -_MOST_STEP, _MOST_STEP)[:, None] * surface.normals
    surface = replace(surface, points=moved).select((weight > 0) & (footprint.plane.heights(moved) > footprint.floor))
    return merged(surface, voxel)


def normals_of(points: Array, toward: Array) -> Array:
    """(N, 3) of least variance among neighbours, on the side of `toward` (N, 3)."""
    tree = cKDTree(points)
    near = points[tree.query(points, k=_NEIGHBOURS, workers=WORKERS)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))[1][:, :, 0]
    return np.asarray(normals * np.where(np.einsum("ni,ni->n", normals, toward) < 0, -1.0, 1.0)[:, None])


def merged(surface: Surface, voxel: float) -> Surface:
    """Without points that came to lie on others: of each close pair the lighter one goes. Single points go, too.

    Level faces at the border of two layers of voxels have both layers on them, so that the distance of neighbours says
    nothing before. Single points are noise of the table that is as high as the lowest that counts as an object.
    """
    pairs = cKDTree(surface.points).query_pairs(_CLOSE * voxel, output_type="ndarray")
    kept = np.ones(len(surface.points), bool)
    kept[np.where(surface.weights[pairs[:, 0]] < surface.weights[pairs[:, 1]], pairs[:, 0], pairs[:, 1])] = False
    surface = surface.select(kept)
    near = cKDTree(surface.points).query(surface.points, k=_COMPANY + 1)[0]
    return surface.select(near[:, -1] < _APART * float(np.median(near[:, 1])))


def _in_world(view: View, rays: Single, depth: Single) -> Single:
    """(N, 3) m of rays (2, N) and depths (N,)."""
    points = rotated(np.stack([rays[0] * depth, rays[1] * depth, depth], axis=1), view.rotation_world_camera)
    return np.asarray(points + view.translation_world_camera.astype(np.float32))
