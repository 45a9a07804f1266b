"""Surface that a cloud does not show: where it is one layer with nothing behind it, and flat faces without any point.

A reconstruction is always closed. Of a surface that was seen from one side only it is a thin shell, whose two sides
are the same layer of points; where an end was not seen, the solid is cut off flat. Such solids have the shape of a
plate, or of a shorter object: only the places of the points distinguish them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poise.geometry import cross
from poise.shape.grouping import linked
from poise.shape.nearest import nearest
from poise.shape.reflections import has_mirror_image
from poise.shape.solid import Solid
from poise.shape.spacing import Spacing
from poise.shape.surface_graph import facing_of, unit_normals
from poise.types import Array, Indices

_TWO_SIDED = 0.3
"""Length of the mean normal around a point below which it is on a sheet."""
_PLACES, _NEIGHBOURS, _LAYER, _MOST_LAYER, _LEAST_THIN = 600, 24, 30, 60, 0.02
"""Vertices that are asked for what is behind them, those around each; points that a layer is known from, for each point
that a vertex stands for, and at the most: they have to reach farther than the solid is thick; and the share of thin
places below which there is no layer."""
_REACH, _ASIDE, _OPPOSITE = 2.0, 1.2, -0.6
"""Spacings that the other side is away from a vertex, at most, also to the side; cosine between their normals."""
_ALONG = 0.7
"""Cosine between the normals of the layer and of the solid, from which on the layer is the solid's surface."""
_THIN, _EMPTY_INSIDE, _SHEET, _ONE_PEAK = 1.4, 2.45, 0.15, 2.6
"""Thickness over the spread of all points there, below or above which it is one layer; thickness over the spacing below
which it is one, too; and kurtosis of the heights. Two sides have heights of either half of the thickness (1.4 to 2.1,
with noise of up to a third of it, and kurtosis at most 2.5); what is thicker has no points on its other side."""
_CLOUD = 12_000
"""Points that are asked, at the most."""
_SAMPLES = 4000
_EMPTY, _TOUCHING, _SAME_WAY = 1.3, 2.0, 0.8
"""Spacings without a point around a bare place; distance of two places of one face, in those of the samples; and the
cosine between their normals."""
_RIM = (0.6, 2.2)
"""Spacings beyond the edge of a bare face, between which the surface around it is looked at."""
_LEAST_FACE, _FLAT, _TURNED, _LEVEL, _LEVEL_SHARE, _ABOVE_SHARE = 6.0, 0.9, 0.4, 0.6, 0.25, 0.15
"""Of a bare face: area in squared spacings; length of its mean normal; the mean cosine between it and the normals
around, and the shares of those above `_LEVEL`, and of places above the face, at the most. Of 72 whole clouds two have
such a face."""
_MOST_FACES = 4
_BY_BARE, _BARE, _BARE_NOISE = 20.0, 0.026, 0.03
"""Share of the volume that one sigma grows by for each point without anything behind it, beyond the share of those that
whole clouds have, which grows with the noise over the spacing."""
_BY_SINGLE, _SINGLE = 4.0, 0.09
"""The same for the share of the surface that is one layer."""
_BY_FACE = 0.6
"""The same where there is a bare face: of an object that goes on there, half may be missing."""
_BY_IMAGE = 0.3
"""The same where half of the solid may be a mirror image."""


@dataclass(frozen=True, eq=False)
class BareFace:
    """A flat face that ends in edges all around and has no points: an end that was not seen, or a cut.

    Args:
        area: m2.
        middle: (3,) m.
    """

    area: float
    middle: Array


@dataclass(frozen=True, eq=False)
class Missing:
    """What speaks for surface that a cloud does not show.

    Args:
        bare: share of the points that have nothing behind them.
        single: share of the surface that is one layer of points.
        faces: without points, the largest first.
        image: half of the solid is likely the mirror image of the other half.
        share: of the volume, one sigma that follows.
    """

    bare: float = 0.0
    single: float = 0.0
    faces: tuple[BareFace, ...] = ()
    image: bool = False
    share: float = 0.0


def missing_of(carved: Solid, moved: Solid, noise: float, points: Array, spacing: Spacing, taken: int) -> Missing:
    """What is missing of a solid.

    Args:
        carved: of the vertices.
        moved: the same, moved to what explains all points.
        noise: m, one sigma of the points.
        points: (N, 3) m, all of the cloud.
        spacing: of the vertices.
        taken: points of the cloud that the vertices stand for: all, or evenly thinned.
    """
    rng = np.random.default_rng(0)
    cloud = points if len(points) <= _CLOUD else points[rng.permutation(len(points))[:_CLOUD]]
    thickness = noise / spacing.usual
    bare = bare_share(carved)
    single = single_layer(moved, cloud, spacing.usual, rng)
    faces = bare_faces(moved, cloud, spacing.around * np.sqrt(min(1.0, taken / len(cloud))), rng)
    evened = taken > len(carved.vertices)  # a close view of a small place has other densities
    image = not evened and has_mirror_image(moved, points, spacing.usual)
    shares = [
        _BY_BARE * max(bare - _BARE - _BARE_NOISE * thickness, 0.0),
        _BY_SINGLE * max(single - _SINGLE, 0.0),
        _BY_FACE * bool(faces),
        _BY_IMAGE * image,
    ]
    return Missing(bare, single, faces, image, float(np.linalg.norm(shares)))


def bare_share(solid: Solid) -> float:
    """The share of points that the solid left out, or keeps as a sheet whose two sides are the same points."""
    facing, areas = facing_of(solid)
    used = np.bincount(solid.tetrahedra.ravel(), minlength=len(solid.vertices)) > 0
    sheet = (areas > 0) & (np.linalg.norm(facing, axis=1) < _TWO_SIDED * areas)
    return float(np.mean(~used | sheet))


def single_layer(solid: Solid, points: Array, spacing: float, rng: np.random.Generator) -> float:
    """Share of the surface whose other side is the same layer of points, with noise.

    Args:
        solid: moved to where its points are.
        points: (N, 3) m.
        spacing: m between its vertices.
        rng: chooses places.
    """
    normals, on_surface = unit_normals(solid)
    normals, vertices = normals[on_surface], solid.vertices[on_surface]
    asked = rng.permutation(len(vertices))[:_PLACES]
    distance, near = nearest(vertices, vertices[asked], min(_NEIGHBOURS, len(vertices)))
    own = normals[asked]
    depth = -np.einsum("nki,ni->nk", vertices[near] - vertices[asked][:, None], own)
    aside = np.sqrt(np.maximum(distance**2 - depth**2, 0.0))
    behind = np.einsum("nki,ni->nk", normals[near], own) < _OPPOSITE
    behind &= (depth > 0) & (aside < _ASIDE * spacing) & (distance < _REACH * spacing)
    thin = np.flatnonzero(behind.any(axis=1))
    if len(thin) < _LEAST_THIN * len(asked) or len(points) <= _LAYER:
        return 0.0
    nearest_behind = np.where(behind, aside, np.inf)[thin].argmin(axis=1)
    thickness, own = depth[thin, nearest_behind], own[thin]
    middles = vertices[asked[thin]] - thickness[:, None] / 2 * own
    spread, peak, way = _layers(points, middles, min(_LAYER * len(points) // len(solid.vertices), _MOST_LAYER))
    single = (thickness < np.maximum(_THIN * spread, _SHEET * spacing)) | (thickness > _EMPTY_INSIDE * spread)
    single &= peak > _ONE_PEAK
    single &= np.abs(np.einsum("ni,ni->n", way, own)) > _ALONG
    return float(np.count_nonzero(single)) / len(asked)


def _layers(points: Array, places: Array, count: int) -> tuple[Array, Array, Array]:
    """(M,) m one sigma and (M,) kurtosis of the heights of points about a quadric around places; (M, 3) its normal."""
    distance, near = cKDTree(points).query(places, k=count)
    offset = points[near] - points[near].mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))[1]
    height, u, v = np.moveaxis(np.einsum("nki,nij->nkj", offset, axes) / distance[:, -1:, None], 2, 0)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    system = np.einsum("nki,nkj->nij", terms, terms) + 1e-9 * np.eye(6)
    fitted = np.linalg.solve(system, np.einsum("nki,nk->ni", terms, height)[..., None])
    squares = (height - (terms @ fitted)[..., 0]) ** 2
    peak = (squares**2).mean(axis=1) / np.maximum(squares.mean(axis=1) ** 2, 1e-30)
    return distance[:, -1] * np.sqrt(squares.sum(axis=1) / (count - 6)), peak, axes[:, :, 0]


def bare_faces(solid: Solid, points: Array, around: Array, rng: np.random.Generator) -> tuple[BareFace, ...]:
    """Faces without points, the largest first; one that lies in a larger even surface, such as a hole, is none.

    Args:
        solid: of the points.
        points: (N, 3) m.
        around: (V,) m, spacing of the points around each vertex.
        rng: chooses places.
    """
    corners = solid.vertices[solid.surface[0]]
    across = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = float(solid.areas.sum())
    own = rng.choice(len(corners), _SAMPLES, p=solid.areas / area)
    places = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), _SAMPLES), corners[own])
    normals = across[own] / np.maximum(2 * solid.areas[own], 1e-30)[:, None]
    around = around[nearest(solid.vertices, places, 1)[1][:, 0]]
    empty = np.flatnonzero(nearest(points, places, 1)[0][:, 0] > _EMPTY * around)
    faces = []
    each = area / _SAMPLES
    for face in _faces(places[empty], normals[empty], _TOUCHING * np.sqrt(each)):
        spacing = float(np.median(around[empty[face]]))
        if len(face) * each < _LEAST_FACE * spacing**2:
            break
        if _ends_in_edges(places, normals, empty[face], spacing):
            faces.append(BareFace(len(face) * each, places[empty[face]].mean(axis=0)))
    return tuple(faces)


def _faces(places: Array, normals: Array, touching: float) -> list[Indices]:
    """Rows of places (M, 3) that lie together and face the same way, the largest faces first."""
    i, j = cKDTree(places).query_pairs(touching, output_type="ndarray").T if len(places) else np.zeros((2, 0), int)
    alike = np.einsum("ij,ij->i", normals[i], normals[j]) > _SAME_WAY
    member = linked(len(places), np.stack([i[alike], j[alike]], axis=1))
    sizes = np.bincount(member)
    return [np.flatnonzero(member == one) for one in np.argsort(-sizes)[:_MOST_FACES]]


def _ends_in_edges(places: Array, normals: Array, face: Indices, spacing: float) -> bool:
    """Whether a bare face is flat, and the surface around it turns away from it on all sides."""
    mean = normals[face].mean(axis=0)
    flat = float(np.linalg.norm(mean))
    inner, outer = ((_EMPTY + beyond) * spacing for beyond in _RIM)
    away = cKDTree(places[face]).query(places, distance_upper_bound=outer)[0]
    around = (away > inner) & np.isfinite(away)
    if flat < _FLAT or not around.any():
        return False
    cosines = normals[around] @ (mean / flat)
    above = (places[around] - places[face].mean(axis=0)) @ (mean / flat) > spacing / 2
    level, over = float(np.mean(cosines > _LEVEL)), float(np.mean(above))
    return float(cosines.mean()) < _TURNED and level < _LEVEL_SHARE and over < _ABOVE_SHARE
