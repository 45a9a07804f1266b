"""Mesh files as arrays: STL (binary, text), OBJ and PLY. Every facet is read, or the file is refused."""

import re
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.shape.cloud_formats import PlyHeader, corrupt, read_ply_header, read_ply_vertices
from poise.types import Array, Indices

MAX_TRIANGLES = 2_000_000
_STL_HEADER, _STL_FACET = 84, 50
_NUMBER = rb"[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?|nan|inf(?:inity)?)"
_STL_TEXT = re.compile(
    rb"\s*facet\s+normal\s+(?:\S+\s+){3}outer\s+loop\s+"
    + rb"".join(rb"vertex\s+(%s)\s+(%s)\s+(%s)\s+" % ((_NUMBER,) * 3) for _ in range(3))
    + rb"endloop\s+endfacet",
    re.IGNORECASE,
)

Arrays = tuple[Array, Indices]


def read_stl(content: bytes, name: str) -> Arrays:
    """(3 T, 3) vertices, three for each of the (T, 3) triangles."""
    says = int.from_bytes(content[80:84], "little") if len(content) >= _STL_HEADER else -1
    if says >= 0 and len(content) == _STL_HEADER + _STL_FACET * says:
        _limit(says, name)
        facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        facets = np.frombuffer(content, facet, says, _STL_HEADER)
        return facets["corners"].reshape(-1, 3).astype(np.float64), np.arange(3 * says).reshape(-1, 3)
    if not content.lstrip()[:5].lower() == b"solid":
        raise corrupt(name, f"a binary STL that says {says} facets cannot have {len(content)} bytes")
    says = len(re.findall(rb"\bfacet\s+normal\b", content, re.IGNORECASE))
    _limit(says, name)
    found = [match.groups() for match in _STL_TEXT.finditer(content)]
    if len(found) != says:
        raise corrupt(name, f"only {len(found)} of its {says} facets can be read")
    return np.array(found, dtype=np.float64).reshape(-1, 3), np.arange(3 * says).reshape(-1, 3)


def read_obj(content: bytes, name: str) -> Arrays:
    """The `v` and `f` lines of an OBJ; polygons become fans. Materials and what else it names are not opened."""
    if (plain := _plain_obj(content)) is not None:
        _limit(len(plain[1]), name)
        return plain
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    text = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                x, y, z = words[1:4]
                vertices.append([float(x), float(y), float(z)])
            elif words[:1] == ["f"]:
                corners = [int(word.partition("/")[0]) for word in words[1:]]
                polygons.append([corner - 1 if corner > 0 else len(vertices) + corner for corner in corners])
        except ValueError as error:
            raise corrupt(name, f"line {number} cannot be read: {line[:60]!r}") from error
        if len(polygons) > MAX_TRIANGLES:
            _limit(len(polygons), name)
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), fans(polygons, name)


def _plain_obj(content: bytes) -> Arrays | None:
    """An OBJ whose faces are triangles of plain vertex numbers, all at once; None for others, and for wrong ones."""
    lines = content.split(b"\n")
    rest = [line for line in lines if line[:2] not in (b"v ", b"f ")]
    if b"\\" in content or any(line.split(None, 1)[:1] in ([b"v"], [b"f"]) for line in rest):
        return None
    columns = []
    for key, kind in ((b"v", "f8"), (b"f", "i8")):
        words = np.array(b" ".join(line for line in lines if line[:2] == key + b" ").split())
        if not len(words) or len(words) % 4 or np.any(words[::4] != key):
            return None
        try:
            columns.append(words.reshape(-1, 4)[:, 1:].astype(kind))
        except ValueError:
            return None
    vertices, corners = np.asarray(columns[0], dtype=np.float64), np.asarray(columns[1], dtype=np.int64)
    return (vertices, corners - 1) if corners.min() > 0 else None


def read_ply_mesh(content: bytes, name: str) -> Arrays:
    """The vertices and the faces of a PLY, which have to come in this order."""
    header = read_ply_header(content, name)
    names = [element for element, _, _ in header.elements]
    if names[:2] != ["vertex", "face"]:
        raise InputError(
            ErrorCode.UNSUPPORTED,
            f"{name}: expected the elements vertex and face, it has {', '.join(names[:5])}",
        )
    columns, rest = read_ply_vertices(content, header, name)
    if not {"x", "y", "z"} <= columns.keys():
        raise corrupt(name, "its vertices have no x, y and z")
    _limit(header.elements[1][1], name)
    lists = [i for i, (_, _, length) in enumerate(header.elements[1][2]) if length]
    if len(lists) != 1:
        raise corrupt(name, "its faces have no list of vertices, or several")
    read = _text_faces if not header.order else _binary_faces
    vertices = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
    return vertices, read(rest, header, lists[0], name)


MESH_READERS: dict[str, Callable[[bytes, str], Arrays]] = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply_mesh}


def _text_faces(rest: bytes, header: PlyHeader, at: int, name: str) -> Indices:
    count = header.elements[1][1]
    lines = rest.split(b"\n", count)[:count]
    polygons: list[list[int]] = []
    for line in lines:
        words = line.split()
        try:
            length = int(words[at])
            polygons.append([int(word) for word in words[at + 1 : at + 1 + length]])
        except (ValueError, IndexError) as error:
            raise corrupt(name, f"a face cannot be read: {line[:60]!r}") from error
        if len(polygons[-1]) != length:
            raise corrupt(name, f"a face is cut short: {line[:60]!r}")
    if len(polygons) != count:
        raise corrupt(name, f"it ends after {len(polygons)} of {count} faces")
    return fans(polygons, name)


def _binary_faces(rest: bytes, header: PlyHeader, at: int, name: str) -> Indices:
    """Triangles all at once; polygons one by one."""
    count, properties = header.elements[1][1], header.elements[1][2]
    order = header.order
    before = sum(np.dtype(kind).itemsize for _, kind, _ in properties[:at])
    after = sum(np.dtype(kind).itemsize for _, kind, _ in properties[at + 1 :])
    length, corner = (np.dtype(order + kind) for kind in (properties[at][2], properties[at][1]))
    layout = np.dtype([("before", "V", before), ("n", length), ("corners", corner, 3), ("after", "V", after)])
    if len(rest) >= count * layout.itemsize:
        rows = np.frombuffer(rest, layout, count)
        if np.all(rows["n"] == 3):
            return rows["corners"].astype(np.int64)
    polygons: list[list[int]] = []
    place = 0
    for _ in range(count):
        start = place + before + length.itemsize
        if start > len(rest):
            raise corrupt(name, f"it ends after {len(polygons)} of {count} faces")
        size = int(np.frombuffer(rest, length, 1, place + before)[0])
        place = start + size * corner.itemsize + after
        if size < 0 or place > len(rest):
            raise corrupt(name, f"it ends after {len(polygons)} of {count} faces")
        polygons.append(np.frombuffer(rest, corner, size, start).astype(int).tolist())
    return fans(polygons, name)


def fans(polygons: Iterable[list[int]], name: str) -> Indices:
    """(T, 3) triangles of polygons.

    Raises:
        InputError: FILE_CORRUPT for a polygon of fewer than three corners; MESH_INVALID for too many triangles.
    """
    triangles = []
    for polygon in polygons:
        if len(polygon) < 3:
            raise corrupt(name, f"a face has {len(polygon)} corners")
        triangles += [(polygon[0], a, b) for a, b in pairwise(polygon[1:])]
        if len(triangles) > MAX_TRIANGLES:
            _limit(len(triangles), name)
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _limit(count: int, name: str) -> None:
    if count > MAX_TRIANGLES:
        raise InputError(ErrorCode.MESH_INVALID, f"{name}: {count} facets, at most {MAX_TRIANGLES}; simplify it")
