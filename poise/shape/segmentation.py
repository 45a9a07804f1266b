"""From a cloud of surface points to parts of likely homogeneous density (thesis Algorithm 1)."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from poise.notebooks import html_table
from poise.shape.carving import carve, spacing_of
from poise.shape.clustering import Features, Weights, initial_clusters, smooth_colours
from poise.shape.coverage import check_coverage
from poise.shape.hierarchy import Hierarchy, MergeCosts, build_hierarchy
from poise.shape.solid import Solid
from poise.shape.surface_graph import surface_graph
from poise.shape.thinning import thin
from poise.shape.unbiased import unbiased
from poise.types import Array, Indices


@dataclass(frozen=True)
class SegmentationOptions:
    """How to cut.

    Args:
        points: a denser cloud is thinned to about as many.
        clusters: initial clusters of surface points; many more than parts are expected.
        limit: merging stops at the first step that costs more, in shares of the object's volume.
        weights: of the initial clusters.
        costs: of merging them.
    """

    points: int = 2500
    clusters: int = 120
    limit: float = 0.006
    weights: Weights = field(default_factory=Weights)
    costs: MergeCosts = field(default_factory=MergeCosts)


_DEFAULT = SegmentationOptions()


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A solid and its parts.

    Args:
        solid: T tetrahedra, as `unbiased` makes it; a vertex for every point, or fewer when there were too many.
        labels: (N,) part of each surface point that was given, 0..P-1.
        tetrahedron_labels: (T,) part of each tetrahedron.
        hierarchy: of all merges; its leaves are the initial clusters.
        leaves: (T,) initial cluster of each tetrahedron.
        steps: merges that were taken.
        part_colours: (P, 3) 0..1, the median of each part's points; None without colours.
        notes: what to read the answer with, one sentence each.
    """

    solid: Solid
    labels: Indices
    tetrahedron_labels: Indices
    hierarchy: Hierarchy
    leaves: Indices
    steps: int
    part_colours: Array | None = None
    notes: tuple[str, ...] = ()

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

    @cached_property
    def n_parts(self) -> int:
        return int(self.tetrahedron_labels.max()) + 1

    @cached_property
    def volumes(self) -> Array:
        """(P,) m3."""
        return np.bincount(self.tetrahedron_labels, self.solid.volumes, minlength=self.n_parts).astype(np.float64)

    @cached_property
    def centroids(self) -> Array:
        """(P, 3) m."""
        first = self.solid.volumes[:, None] * self.solid.centroids
        sums = [np.bincount(self.tetrahedron_labels, first[:, axis], minlength=self.n_parts) for axis in range(3)]
        return np.stack(sums, axis=1) / self.volumes[:, None]

    @cached_property
    def surface(self) -> tuple[Indices, Indices]:
        """(F, 3) vertex numbers of the triangles around the object, counter-clockwise from outside, and (F,) parts."""
        triangles, owners = self.solid.surface
        return triangles, self.tetrahedron_labels[owners]


def segment(points: Array, colours: Array | None = None, options: SegmentationOptions = _DEFAULT) -> Segmentation:
    """Cut an object into parts.

    Args:
        points: (N, 3) m, on its whole surface, finite (see `clouds`).
        colours: (N, 3) 0..1, or None.

    Raises:
        InputError: as `carve` and `check_coverage`.
    """
    chosen = thin(points, options.points)
    few = points[chosen]
    shades = np.zeros_like(few) if colours is None else colours[chosen]
    spacing = spacing_of(few)
    solid = carve(few, spacing)
    notes = check_coverage(solid)
    graph = surface_graph(solid)
    features = Features(few / spacing, smooth_colours(shades, graph.edges), graph.normals)
    clusters = initial_clusters(features, graph.edges, options.clusters, options.weights)
    tree = cKDTree(few)
    leaves, point_leaves = _leaves(solid, clusters, tree)
    hierarchy = build_hierarchy(solid, leaves, point_leaves, shades, graph, options.costs)
    steps = hierarchy.steps_below(options.limit)
    parts = hierarchy.labels(steps)
    nearest = np.arange(len(few)) if len(few) == len(points) else tree.query(points)[1]
    part_colours = None if colours is None else _median_colours(shades, parts[point_leaves], int(parts.max()) + 1)
    labels, solid = parts[point_leaves][nearest], unbiased(solid, parts[leaves], spacing)
    return Segmentation(solid, labels, parts[leaves], hierarchy, leaves, steps, part_colours, notes)


def _median_colours(colours: Array, labels: Indices, count: int) -> Array:
    """(count, 3); a part that has no point at the surface gets what most have."""
    medians = [colours[labels == part] for part in range(count)]
    return np.array([np.median(own if len(own) else colours, axis=0) for own in medians])


def _leaves(solid: Solid, clusters: Indices, tree: cKDTree) -> tuple[Indices, Indices]:
    """Leaf of each tetrahedron, that of its nearest point, and of each point; a leaf that has no volume joins another.

    Returns:
        (T,) and (N,), numbered from 0 without gaps.
    """
    used, leaves = np.unique(clusters[tree.query(solid.centroids)[1]], return_inverse=True)
    number = np.full(clusters.max() + 1, -1)
    number[used] = np.arange(len(used))
    point_leaves = number[clusters]
    lost = point_leaves < 0
    if np.any(lost):
        point_leaves[lost] = leaves[cKDTree(solid.centroids).query(tree.data[lost])[1]]
    return leaves, point_leaves
