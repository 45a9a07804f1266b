"""The bias of carving undone: chords cut edges off, and the outermost of noisy points make the surface."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from poise.shape.solid import Solid, tetrahedron_moments
from poise.shape.surface_graph import surface_edges, unit_normals
from poise.types import Array, Indices

_PUSH = 0.5
"""Of how far a point of the surface stands out from the middle of its neighbours."""
_LAYER = 0.5
"""Spacings under the surface in which points are taken for its own; farther in they belong to something else."""
_TOGETHER = 16
"""Points of the surface whose buried neighbours are averaged."""
_LEAST_KEPT = 0.3
"""Share of its volume and second moments that every part keeps, or its points move less."""
_ROUNDS = 6
_FLAT = 1e14
"""Condition of a pseudo-inertia above which it is singular."""


def unbiased(solid: Solid, labels: Indices, spacing: float) -> Solid:
    """The solid with its edges sharpened, and its surface moved into the middle of the points that show it.

    Tetrahedra may turn inside out; then they count as negative, so that volume and moments are those of the surface.
    The constants were chosen on random objects.

    Args:
        solid: as carved.
        labels: (T,) part of each tetrahedron, 0..P-1.
        spacing: m between neighbouring points.
    """
    moves = _PUSH * _standing_out(solid) - _depth(solid, _LAYER * spacing)
    before = _moments(solid, labels)
    solid_parts = np.linalg.cond(before) < _FLAT  # a part of flat tetrahedra has no volume to keep
    kept = np.ones(len(before))
    for _ in range(_ROUNDS):
        found = replace(solid, vertices=solid.vertices + moves)
        change = np.linalg.solve(before[solid_parts], _moments(found, labels)[solid_parts])
        kept[solid_parts] = np.linalg.eigvals(change).real.min(axis=1)
        spoilt = kept < _LEAST_KEPT
        if not spoilt.any():
            return found
        moves[solid.tetrahedra[spoilt[labels]]] /= 2
    return solid


def _moments(solid: Solid, labels: Indices) -> Array:
    """(P, 4, 4) pseudo-inertia of each part at unit density."""
    moments = np.zeros((int(labels.max()) + 1, 4, 4))
    np.add.at(moments, labels, tetrahedron_moments(solid.vertices[solid.tetrahedra]))
    return moments


def _standing_out(solid: Solid) -> Array:
    """(V, 3) m from the middle of a vertex's neighbours on the surface to itself; zero inside.

    On flat ground this lies in the surface. At an edge it points outwards, and half of it is about what chords cut off;
    in a fold it points inwards, where they fill (the inflating half of Taubin's smoothing, 1995).
    """
    edges = surface_edges(solid)
    edges = np.concatenate([edges, edges[:, ::-1]])
    count = len(solid.vertices)
    degree = np.bincount(edges[:, 0], minlength=count)
    sums = [np.bincount(edges[:, 0], solid.vertices[edges[:, 1], axis], minlength=count) for axis in range(3)]
    middles = np.stack(sums, axis=1) / np.maximum(degree, 1)[:, None]
    return np.asarray(np.where(degree[:, None] > 0, solid.vertices - middles, 0.0))


def _depth(solid: Solid, layer: float) -> Array:
    """(V, 3) m outwards, as long as the points around a vertex lie under the surface on average; zero inside."""
    normals, on_surface = unit_normals(solid)
    outer, buried = np.flatnonzero(on_surface), np.flatnonzero(~on_surface)
    tree = cKDTree(solid.vertices[outer])
    above = tree.query(solid.vertices[buried])[1]
    offsets = solid.vertices[outer[above]] - solid.vertices[buried]
    under = np.einsum("ij,ij->i", offsets, normals[outer[above]])
    own = (under > 0) & (under < layer)
    sums = np.bincount(above[own], under[own], minlength=len(outer))
    counts = np.bincount(above[own], minlength=len(outer)) + 1
    around = tree.query(solid.vertices[outer], k=min(_TOGETHER, len(outer)))[1]
    depth = np.zeros(len(normals))
    depth[outer] = sums[around].sum(axis=1) / counts[around].sum(axis=1)
    return np.asarray(depth[:, None] * normals)
