"""From a cloud of surface points to parts of likely homogeneous density (thesis Algorithm 1)."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from poise.notebooks import html_table
from poise.shape.clustering import Features, Weights, initial_clusters, smooth_colours
from poise.shape.coverage import check_coverage, wide_gap
from poise.shape.hierarchy import Hierarchy, MergeCosts, build_hierarchy
from poise.shape.hollows import Hollow, hollow_of
from poise.shape.lighting import colour_steps, unlit
from poise.shape.nearest import nearest
from poise.shape.reconstruction import guarded, reconstruct
from poise.shape.solid import Solid
from poise.shape.surface_graph import SurfaceGraph, surface_graph
from poise.types import Array, Indices, Mask

_SHADING = 0.2
"""Share by which lightness may be off where lighting was taken out: normals at edges are means."""
_PLAIN, _SHARE = 0.12, 0.05
"""Distance of colours (0..1 in three channels) below which they say nothing of materials, and the share that counts."""
_WALLS = 0.1
"""`MergeCosts.blur` where colours say nothing: walls of one paint are of one piece, unless a neck says otherwise."""


@dataclass(frozen=True)
class SegmentationOptions:
    """How to cut.

    Args:
        points: a denser cloud is thinned to about as many.
        clusters: initial clusters of surface points; many more than parts are expected.
        noise: m, one sigma of the points along each axis; None: estimated from them.
        limit: merging stops at the first step that costs more (see `hierarchy`).
        plain_limit: the same when no colours say where materials meet: what has one colour likely is one piece.
        parts: this many instead.
        weights: of the initial clusters.
        costs: of merging them.
    """

    points: int = 2500
    clusters: int = 120
    noise: float | None = None
    limit: float = 0.0125
    plain_limit: float = 0.025
    parts: int | None = None
    weights: Weights = field(default_factory=Weights)
    costs: MergeCosts = field(default_factory=MergeCosts)


DEFAULT_SEGMENTATION = SegmentationOptions()


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A solid and its parts.

    Args:
        solid: T tetrahedra, as `reconstruct` makes it; a vertex for every point, or fewer when there were too many.
        noise: m, one sigma of the points along each axis.
        labels: (N,) part of each surface point that was given, 0..P-1.
        tetrahedron_labels: (T,) part of each tetrahedron.
        hierarchy: of all merges; its leaves are the initial clusters.
        leaves: (T,) initial cluster of each tetrahedron.
        steps: merges that were taken.
        part_colours: (P, 3) 0..1, the median of each part's points, without lighting; None without colours.
        hollow: space that a scan did not see into and that may be empty; None where there is none.
        notes: what to read the answer with, one sentence each.
        mesh_volume: m3 of the closed mesh on which the points are; None: there is none.
        triangle_labels: (F,) part of each of its triangles.
    """

    solid: Solid
    labels: Indices
    tetrahedron_labels: Indices
    hierarchy: Hierarchy
    leaves: Indices
    steps: int
    noise: float = 0.0
    part_colours: Array | None = None
    hollow: Hollow | None = None
    notes: tuple[str, ...] = ()
    mesh_volume: float | None = None
    triangle_labels: Indices | None = None

    def __repr__(self) -> str:
        return f"Segmentation({self.n_parts} parts, {1e6 * self.volumes.sum():.4g} cm3, {len(self.labels)} points)"

    def _repr_html_(self) -> str:
        """Volume and centroid of each part, for notebooks."""
        rows = [
            (part, f"{1e6 * volume:.4g}", ", ".join(f"{1e3 * value:.1f}" for value in centroid))
            for part, (volume, centroid) in enumerate(zip(self.volumes, self.centroids, strict=True))
        ]
        caption = f"{self.n_parts} parts, {1e6 * self.volumes.sum():.4g} cm³"
        return html_table(caption, ("part", "cm³", "centroid, mm"), rows, self.notes)

    @property
    def volume_if_hollow(self) -> float | None:
        """m3, the least that it has if it is hollow where no view saw; None: that is within the uncertainty."""
        if self.hollow is None or not self.hollow.matters(self.solid):
            return None
        return self.solid.volume - self.hollow.volume

    @cached_property
    def n_parts(self) -> int:
        return int(self.tetrahedron_labels.max()) + 1

    @property
    def volume(self) -> float:
        """m3: that of the mesh, if there is one, else that of the solid."""
        return self.solid.volume if self.mesh_volume is None else self.mesh_volume

    @property
    def volume_std(self) -> float:
        """m3, one sigma; 0 for a mesh."""
        return self.solid.volume_std if self.mesh_volume is None else 0.0

    @cached_property
    def volumes(self) -> Array:
        """(P,) m3; their sum is `volume`."""
        sums = np.bincount(self.tetrahedron_labels, self.solid.volumes, minlength=self.n_parts).astype(np.float64)
        return sums if self.mesh_volume is None else sums * (self.mesh_volume / self.solid.volume)

    @cached_property
    def centroids(self) -> Array:
        """(P, 3) m."""
        sums = [
            np.bincount(self.tetrahedron_labels, self.solid.volumes * weight, minlength=self.n_parts)
            for weight in (*self.solid.centroids.T, np.ones(len(self.solid.volumes)))
        ]
        return np.stack(sums[:3], axis=1) / sums[3][:, None]

    @cached_property
    def surface(self) -> tuple[Indices, Indices]:
        """(F, 3) vertex numbers of the triangles around the object, counter-clockwise from outside, and (F,) parts."""
        triangles, owners = self.solid.surface
        return triangles, self.tetrahedron_labels[owners]


def segment(
    points: Array,
    colours: Array | None = None,
    options: SegmentationOptions = DEFAULT_SEGMENTATION,
    *,
    normals: Array | None = None,
    seen: Mask | None = None,
    doubt: Array | None = None,
    air: Array | None = None,
) -> Segmentation:
    """Cut an object into parts.

    Args:
        points: (N, 3) m, on its whole surface, finite (see `clouds`).
        colours: (N, 3) 0..1, or None.
        options: how.
        normals: (N, 3) outward unit normals, where they were measured.
        seen: (N,) False where a scan completed the surface; None: all of it was seen.
        doubt: (N,) m, one sigma of where the surface is; None: as `reconstruct` takes it.
        air: (K, 3) m, places that a scan saw through, on a grid; None: nothing is known.

    Raises:
        InputError: as `carve` and `check_coverage`.
    """
    made = reconstruct(points, options.points, options.noise, normals, seen, doubt, air)
    notes = check_coverage(made.carved, made.solid, made.missing, made.inside, made.layers, made.blur)
    few, spacing = made.solid.vertices, made.spacing
    shades = smooth = np.zeros_like(few)
    graph, shading = surface_graph(made.solid), 0.0
    if colours is not None:
        known = np.ones(len(few), bool) if seen is None else seen[made.rows]
        shades, smooth, shading = _paint(colours[made.rows], few, graph, known)
    plain = _contrast(smooth, shading) <= _PLAIN  # then noise of the paint is no border between clusters
    features = Features(few / spacing, smooth * (not plain), graph.normals, shading)
    clusters = initial_clusters(features, graph.edges, options.clusters, options.weights)
    leaves, point_leaves = _leaves(made.carved, clusters)
    costs = _costs(options, shading, plain)
    hierarchy = build_hierarchy(made.carved, leaves, point_leaves, shades, graph, costs)
    limit = options.plain_limit if plain else options.limit
    steps = hierarchy.steps_below(limit) if options.parts is None else hierarchy.steps_to(options.parts)
    parts = hierarchy.labels(steps)
    own = np.arange(len(few)) if len(few) == len(points) else nearest(points[made.rows], points, 1)[1][:, 0]
    part_colours = None if colours is None else _median_colours(shades, parts[point_leaves], int(parts.max()) + 1)
    labels, solid = parts[point_leaves][own], guarded(made, parts[leaves])
    notes += wide_gap(solid)
    hollow = None if seen is None else hollow_of(solid, points, seen)
    if hollow is not None and hollow.matters(solid):
        notes = (*notes, hollow.sentence(solid))
    return Segmentation(solid, labels, parts[leaves], hierarchy, leaves, steps, made.noise, part_colours, hollow, notes)


def _paint(colours: Array, points: Array, graph: SurfaceGraph, seen: Mask) -> tuple[Array, Array, float]:
    """Colours (N, 3) without lighting, also without noise, and by what share their lightness may still be off."""
    smooth = smooth_colours(colours, graph.edges)
    paint = unlit(colours, graph.normals, seen, smooth)
    if paint is None:
        return colours, smooth, 0.0
    # A completed point has the shade of a seen one that faces elsewhere.
    paint[~seen] = paint[seen][cKDTree(points[seen]).query(points[~seen])[1]]
    return paint, smooth_colours(paint, graph.edges), _SHADING


def _costs(options: SegmentationOptions, shading: float, plain: bool) -> MergeCosts:
    """What merging costs where colours say nothing, and where lighting was taken out.

    There what has one colour likely is one piece, among others of other colours too.
    """
    if plain:
        return replace(options.costs, shading=shading, colour=0.0, blur=max(options.costs.blur, _WALLS))
    one_colour = options.limit / options.plain_limit if shading else options.costs.one_colour
    return replace(options.costs, shading=shading, one_colour=one_colour)


def _contrast(colours: Array, shading: float) -> float:
    """How far the colours (N, 3) of a small share of the surface are from the most common one."""
    away = colour_steps(colours, np.median(colours, axis=0), shading)
    return float(np.quantile(away, 1 - _SHARE))


def _median_colours(colours: Array, labels: Indices, count: int) -> Array:
    """(count, 3); a part that has no point at the surface gets what most have."""
    medians = [colours[labels == part] for part in range(count)]
    return np.array([np.median(own if len(own) else colours, axis=0) for own in medians])


def _leaves(solid: Solid, clusters: Indices) -> tuple[Indices, Indices]:
    """Leaf of each tetrahedron, that of its nearest point, and of each point; a leaf that has no volume joins another.

    Returns:
        (T,) and (N,), numbered from 0 without gaps.
    """
    own = clusters[nearest(solid.vertices, solid.centroids, 1)[1][:, 0]]
    used = np.bincount(own, minlength=clusters.max() + 1) > 0
    number = np.where(used, np.cumsum(used) - 1, -1)
    leaves = number[own]
    point_leaves = number[clusters]
    lost = point_leaves < 0
    if np.any(lost):
        point_leaves[lost] = leaves[cKDTree(solid.centroids).query(solid.vertices[lost])[1]]
    return leaves, point_leaves
