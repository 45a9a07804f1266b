"""Repair of surfaces: corners at one place are one, normals point outwards, holes close, overlapping shells unite."""

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from poise.errors import ErrorCode, InputError
from poise.geometry import cross, unique_rows, used_rows
from poise.types import Array, Indices

_WELD = 1e-7
"""Corners closer than this share of the mesh's size are one."""
_MOST_OPEN = 0.1
"""A surface with more than this share of its edges open is a sheet, not the skin of a body."""
_NO_VOLUME = 1e-9


def repair(points: Array, triangles: Indices, name: str) -> tuple[Array, Indices, tuple[str, ...]]:
    """A closed surface whose triangles face outwards, and what was done to have it.

    Args:
        points: (V, 3) m, finite.
        triangles: (T, 3) vertex numbers.

    Raises:
        InputError: MESH_INVALID for sheets, for edges that cannot be closed, and for no volume.
    """
    notes: list[str] = []
    points, triangles = _weld(points, triangles, notes)
    if len(triangles) < 4:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: all its triangles lie on lines or points")
    if not _is_consistent(triangles):
        triangles = _turn_alike(triangles, notes)
        points, triangles = _close(points, triangles, notes, name)
    points, triangles = _unite(points, triangles, notes)
    size = float(np.ptp(points, axis=0).max())
    if not _volume(points, triangles) > _NO_VOLUME * size**3:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: the surface encloses no volume; give a closed mesh")
    used, corners = used_rows(triangles, len(points))
    return points[used], corners, tuple(notes)


def _weld(points: Array, triangles: Indices, notes: list[str]) -> tuple[Array, Indices]:
    """One vertex per place, no triangle without three different ones, none twice."""
    grid = _WELD * max(float(np.ptp(points[triangles].reshape(-1, 3), axis=0).max()), 1e-300)
    with np.errstate(over="ignore", invalid="ignore"):
        places = np.round((points - points[triangles[0, 0]]) / grid)
    first, number = unique_rows(places)
    corners: Indices = number[triangles]
    distinct = np.all(corners != np.roll(corners, 1, axis=1), axis=1)
    if not np.all(distinct):
        notes.append(f"{np.sum(~distinct)} triangles without area were left out")
    corners = corners[distinct]
    # From its least corner on, a triangle is written in one way only.
    turn = np.argmin(corners, axis=1)[:, None] if len(corners) else np.zeros((0, 1), np.int64)
    ordered = np.take_along_axis(corners, (turn + np.arange(3)) % 3, axis=1)
    once = np.sort(unique_rows(ordered)[0])
    if len(once) < len(corners):
        notes.append(f"{len(corners) - len(once)} triangles that were there twice were left out")
    return points[first], corners[once]


def _directed(triangles: Indices) -> Indices:
    """(3 T, 2) edges in the direction of their triangles."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _is_consistent(triangles: Indices) -> bool:
    """Every edge is passed as often in one direction as in the other: closed, and turned alike."""
    edges = _directed(triangles)
    undirected = unique_rows(np.sort(edges, axis=1))[1]
    return not np.any(np.bincount(undirected, np.where(edges[:, 0] < edges[:, 1], 1, -1)))


def _turn_alike(triangles: Indices, notes: list[str]) -> Indices:
    """Turn triangles so that two which share an edge pass it in opposite directions."""
    edges = _directed(triangles)
    key = unique_rows(np.sort(edges, axis=1))[1]
    count = np.bincount(key)
    order = np.argsort(key, kind="stable")
    order = order[count[key[order]] == 2]
    first, second = order[::2], order[1::2]
    same = edges[first, 0] == edges[second, 0]
    one, other = first // 3, second // 3
    n = len(triangles)
    weight = np.where(same, 2.0, 1.0)  # the weight says whether the two have to differ
    graph = coo_array((weight, (one, other)), shape=(n, n)).tocsr()
    graph = graph.maximum(graph.T).tocsr()
    turned = np.zeros(n, dtype=bool)
    for start in np.unique(connected_components(graph, directed=False)[1], return_index=True)[1]:
        nodes, parent = breadth_first_order(graph, start, directed=False)
        if len(nodes) == 1:
            continue
        differs = np.asarray(graph[parent[nodes[1:]], nodes[1:]]).ravel() == 2.0
        for node, above, differ in zip(nodes[1:].tolist(), parent[nodes[1:]].tolist(), differs.tolist(), strict=True):
            turned[node] = turned[above] != differ
        if turned[nodes].mean() > 0.5:
            turned[nodes] = ~turned[nodes]
    if np.any(turned):
        notes.append(f"{np.sum(turned)} triangles were turned to face as their neighbours do")
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    return triangles


def _close(points: Array, triangles: Indices, notes: list[str], name: str) -> tuple[Array, Indices]:
    """Fill each loop of open edges with a fan around its middle."""
    edges = _directed(triangles)
    undirected = np.sort(edges, axis=1)
    first, number = unique_rows(undirected)
    ends = undirected[first]
    balance = np.bincount(number, np.where(edges[:, 0] < edges[:, 1], 1, -1)).astype(int)
    open_ends, times = ends[balance != 0], balance[balance != 0]
    if len(open_ends) > _MOST_OPEN * len(ends):
        message = f"{name}: the surface has holes around {len(open_ends)} of its {len(ends)} edges: a sheet? Close it"
        raise InputError(ErrorCode.MESH_INVALID, message)
    if not len(open_ends):
        return points, triangles
    needed = np.repeat(np.where(times[:, None] > 0, open_ends[:, ::-1], open_ends), np.abs(times), axis=0)
    ways: dict[int, list[int]] = {}
    for a, b in needed.tolist():
        ways.setdefault(a, []).append(b)
    middles, fans, loops = [], [], 0
    while ways:
        start = next(iter(ways))
        loop = [start]
        while not (len(loop) > 1 and loop[-1] == start):
            if loop[-1] not in ways:
                raise InputError(ErrorCode.MESH_INVALID, f"{name}: the edges of a hole form no loop; fix the mesh")
            onwards = ways[loop[-1]].pop()
            if not ways[loop[-1]]:
                del ways[loop[-1]]
            loop.append(onwards)
        middle = len(points) + loops
        middles.append(points[loop[:-1]].mean(axis=0))
        fans += [(a, b, middle) for a, b in pairwise(loop)]
        loops += 1
    notes.append(f"{loops} hole{'s' if loops > 1 else ''} in the surface, {len(needed)} edges around, were closed")
    return np.concatenate([points, np.array(middles)]), np.concatenate([triangles, np.array(fans, dtype=np.int64)])


def _unite(points: Array, triangles: Indices, notes: list[str]) -> tuple[Array, Indices]:
    """Turn shells outwards; where several reach into each other, make them one surface."""
    shells = _shells(points, triangles)
    volumes = np.array([_volume(points, shell) for shell in shells])
    if len(shells) == 1:
        if volumes[0] < 0:
            notes.append("the surface was inside out and was turned")
            return points, triangles[:, ::-1].copy()
        return points, triangles
    largest = int(np.argmax(np.abs(volumes)))
    if volumes[largest] < 0:
        notes.append("the surface was inside out and was turned")
        shells, volumes = [shell[:, ::-1].copy() for shell in shells], -volumes
    boxes = np.array([[points[shell].min(axis=(0, 1)), points[shell].max(axis=(0, 1))] for shell in shells])
    reach = np.all((boxes[:, None, 0] <= boxes[None, :, 1]) & (boxes[None, :, 0] <= boxes[:, None, 1]), axis=2)
    if np.sum(reach) == len(shells):  # no bounding boxes meet: a negative volume is inside out
        if np.any(volumes < 0):
            notes.append(f"{np.sum(volumes < 0)} of {len(shells)} shells were inside out and were turned")
        shells = [shell if volume > 0 else shell[:, ::-1] for shell, volume in zip(shells, volumes, strict=True)]
        return points, np.concatenate(shells)
    return _boolean(points, shells, volumes, notes)


def _boolean(points: Array, shells: list[Indices], volumes: Array, notes: list[str]) -> tuple[Array, Indices]:
    """The union of the shells that face outwards, less those that face inwards."""
    together = np.concatenate(shells)
    try:
        from manifold3d import Manifold, OpType, Mesh as ManifoldMesh  # noqa: I001
    except ImportError:
        notes.append(f"{len(shells)} shells may overlap and then count twice; pip install manifold3d unites them")
        return points, together

    def solid(shell: Indices) -> Manifold:
        used, corners = np.unique(shell, return_inverse=True)
        return Manifold(ManifoldMesh(points[used].astype(np.float32), corners.reshape(-1, 3).astype(np.uint32)))

    solids = [solid(shell if volume > 0 else shell[:, ::-1]) for shell, volume in zip(shells, volumes, strict=True)]
    if any(one.is_empty() for one, volume in zip(solids, volumes, strict=True) if volume):
        notes.append(f"{len(shells)} shells, some of which touch themselves, could not be united; overlaps count twice")
        return points, together
    body = Manifold.batch_boolean([s for s, volume in zip(solids, volumes, strict=True) if volume > 0], OpType.Add)
    hollows = [one for one, volume in zip(solids, volumes, strict=True) if volume < 0]
    if hollows:
        body = Manifold.batch_boolean([body, *hollows], OpType.Subtract)
    before, after = float(volumes.sum()), float(body.volume())
    if abs(after - before) <= 1e-4 * abs(before):
        return points, together  # nothing overlapped: keep the vertices as they came
    change = f"{before * 1e6:.4g} to {after * 1e6:.4g} cm3"
    notes.append(f"{len(shells)} shells reached into each other and were united: {change}")
    mesh = body.to_mesh()
    return np.asarray(mesh.vert_properties[:, :3], dtype=np.float64), np.asarray(mesh.tri_verts, dtype=np.int64)


def _shells(points: Array, triangles: Indices) -> list[Indices]:
    """The triangles that hang together, each shell's for itself."""
    edges = _directed(triangles)
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(points),) * 2)
    shell = np.unique(connected_components(graph, directed=False)[1][triangles[:, 0]], return_inverse=True)[1]
    order = np.argsort(shell, kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(shell[order])) + 1)


def _volume(points: Array, triangles: Indices) -> float:
    """m3, negative when the triangles face inwards."""
    a, b, c = (points[triangles[:, k]] - points[triangles[0, 0]] for k in range(3))
    return float(np.einsum("ij,ij->", a, cross(b, c)) / 6)
