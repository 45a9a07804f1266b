"""Point cloud files as tables: PLY (text, binary), PCD (text, binary), XYZ, CSV and NPY, with named columns."""

import io
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.shape.lzf import unpacked
from poise.types import Array, Mask

MAX_POINTS = 5_000_000
_MAX_HEADER = 65_536
_BLANK = b"\0\r\n\t \x1a"
"""Bytes that may follow the last point."""
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_COLOURS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
_COMMENT = re.compile(
    r"(^\s*(#|//)|(?<=[\d.])\s*(#|//)|(^|(?<=[\d.])\s)\s*;(?=\s*[^\W\d])(?!\s*(nan|inf)\b)).*", re.IGNORECASE
)
_UNIT = 0.02
"""Off from one, of the length of a normal."""
_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


@dataclass(frozen=True, eq=False)
class CloudTable:
    """Columns of a file.

    Args:
        points: (N, 3) as they are in the file.
        colours: (N, 3) 0..1, or None.
        n_faces: triangles that the file holds beside its points.
        normals: (N, 3) as they are in the file, or None.
        seen: (N,) False where a scan completed the surface (column `seen`), or None.
        doubt: (N,) one sigma of the place of a completed point (column `doubt`), or None.
        air: (K, 3) places that a scan saw through (element `air`), or None.
    """

    points: Array
    colours: Array | None
    n_faces: int = 0
    normals: Array | None = None
    seen: Mask | None = None
    doubt: Array | None = None
    air: Array | None = None


@dataclass(frozen=True)
class PlyHeader:
    """What a PLY file says about itself.

    Args:
        order: of bytes, `<` or `>`; empty for text.
        elements: name, how many, and (name, type, type of a list's length or "") of each property.
        body: where the data begin.
    """

    order: str
    elements: list[tuple[str, int, list[tuple[str, str, str]]]]
    body: int


def read_ply_header(content: bytes, name: str) -> PlyHeader:
    """Raises FILE_CORRUPT for what is no PLY header."""
    end = re.search(rb"end_header[ \t]*\r?\n", content[:_MAX_HEADER])
    if not content.startswith(b"ply") or end is None:
        raise corrupt(name, "it has no PLY header")
    encoding = ""
    elements: list[tuple[str, int, list[tuple[str, str, str]]]] = []
    for words in (line.split() for line in content[: end.start()].decode("ascii", "replace").splitlines()):
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            elements.append((words[1], _count(words[2], name), []))
        elif words[:1] == ["property"] and len(words) >= 3 and elements:
            kinds = words[2:4] if words[1] == "list" else words[1:2]
            if any(kind not in _PLY_TYPES for kind in kinds):
                raise corrupt(name, f"a property has the unknown type {' '.join(words[1:-1])!r}")
            length = _PLY_TYPES[kinds[0]] if words[1] == "list" else ""
            elements[-1][2].append((words[-1], _PLY_TYPES[kinds[-1]], length))
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    if encoding not in orders:
        raise corrupt(name, f"the format {encoding!r} is none of {', '.join(orders)}")
    return PlyHeader(orders[encoding], elements, end.end())


def read_ply(content: bytes, name: str) -> CloudTable:
    """The vertices of a PLY file, and the air of a scan; faces are only counted."""
    header = read_ply_header(content, name)
    if not header.elements or header.elements[0][0] != "vertex":
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: vertices have to be the first element of a PLY file")
    columns, rest = read_ply_vertices(content, header, name)
    n_faces = next((number for element, number, _ in header.elements if element == "face"), 0)
    table = _table(columns, name, n_faces)
    if len(header.elements) == 1:
        _refuse_more(rest, header.elements[0][1], name)
    if [element for element, *_ in header.elements[1:2]] != ["air"]:
        return table
    places, _ = _ply_columns(rest, header, 1, name)
    return replace(table, air=_table(places, name).points)


def read_ply_vertices(content: bytes, header: PlyHeader, name: str) -> tuple[dict[str, NDArray[np.generic]], bytes]:
    """The columns of the first element, and what comes after it."""
    return _ply_columns(content[header.body :], header, 0, name)


def _ply_columns(
    body: bytes, header: PlyHeader, element: int, name: str
) -> tuple[dict[str, NDArray[np.generic]], bytes]:
    """The columns of an element with which the body begins, and what comes after it."""
    what, count, properties = header.elements[element]
    if any(length for _, _, length in properties):
        raise InputError(ErrorCode.UNSUPPORTED, f"{name}: lists as properties of {what} are not read")
    names = [column for column, _, _ in properties]
    if not header.order:
        rest = body.split(b"\n", count)
        return _text_columns(body, names, count, name), rest[count] if len(rest) > count else b""
    kinds = [header.order + kind for _, kind, _ in properties]
    length = count * sum(np.dtype(kind).itemsize for kind in kinds)
    return _binary_columns(body, names, kinds, count, name), body[length:]


def read_pcd(content: bytes, name: str) -> CloudTable:
    """A PCD file, DATA ascii, binary or binary_compressed; `rgb` and `rgba` are unpacked."""
    start = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content[:_MAX_HEADER], re.MULTILINE)
    if start is None:
        raise corrupt(name, "it has no PCD header")
    header = {
        words[0]: words[1:]
        for line in content[: start.start()].decode("ascii", "replace").splitlines()
        if (words := line.split())
    }
    fields = header.get("FIELDS", [])
    sizes, letters = header.get("SIZE", []), header.get("TYPE", [])
    repeats = header.get("COUNT", ["1"] * len(fields))
    if not fields or not len(fields) == len(sizes) == len(letters) == len(repeats):
        raise corrupt(name, "FIELDS, SIZE, TYPE and COUNT do not belong together")
    names, kinds = [], []
    for field, size, letter, repeat in zip(fields, sizes, letters, repeats, strict=True):
        kind = {"F": "f", "I": "i", "U": "u"}.get(letter, "") + size
        if kind not in {"f4", "f8", *(sign + width for sign in "iu" for width in "1248")}:
            raise corrupt(name, f"{field} has the unknown type {letter}{size}")
        times = min(_count(repeat, name), _MAX_HEADER)
        names += [field if times == 1 else f"{field}[{i}]" for i in range(times)]
        kinds += ["<" + kind] * times
    count = _count((header.get("POINTS") or ["?"])[0], name)
    encoding, body = start.group(1), content[start.end() :]
    packed = next((column for column in ("rgb", "rgba") if column in names), "")
    if encoding == b"ascii":
        columns, body = _text_columns(body, names, count, name), b"".join(body.split(b"\n", count)[count:])
        if dict(zip(names, kinds, strict=True)).get(packed) == "<f4":
            columns[packed] = columns[packed].astype("<f4").view("<u4")
    elif encoding == b"binary":
        columns = _binary_columns(body, names, kinds, count, name)
        body = body[count * sum(np.dtype(kind).itemsize for kind in kinds) :]
    elif encoding == b"binary_compressed":
        columns = _packed_columns(body, names, kinds, count, name)
        body = b""
    else:
        raise InputError(
            ErrorCode.UNSUPPORTED, f"{name}: DATA {encoding.decode()} is not read; save it as binary or ascii"
        )
    _refuse_more(body, count, name)
    if packed:
        columns |= _channels(columns.pop(packed))
    return _table(columns, name)


def _channels(packed: NDArray[np.generic]) -> dict[str, NDArray[np.generic]]:
    """Red, green and blue out of one number, which may be stored as a float with the same bits."""
    rgb = np.ascontiguousarray(packed).view("<u4") if packed.dtype.itemsize == 4 else packed.astype(np.uint32)
    return {channel: (rgb >> shift & 255).astype(np.uint8) for channel, shift in (("r", 16), ("g", 8), ("b", 0))}


def read_text(content: bytes, name: str) -> CloudTable:
    """Lines of x y z [r g b ...] or x y z nx ny nz, parted by blanks, commas or semicolons.

    A comment begins with #, // or, where no numbers follow, with a semicolon; it is a line, or the end of one. A first
    line may name the columns, or say how many lines follow, also with a line of text after it (XYZ of chemistry).
    Numbers of the lines in front are left aside.
    """
    text = content.decode("utf-8", "replace").lstrip("\ufeff")
    lines = text.splitlines()
    if any(mark in text for mark in ("#", "//", ";")):
        lines = [_COMMENT.sub("", line) for line in lines]
    lines = [line for line in lines if line.strip()]
    numbers = re.split(r"[;\s]+", lines[-1].strip(" ;\t")) if lines else []
    if len(numbers) > 2 and all(map(_DECIMAL_COMMA.fullmatch, numbers)):
        lines = [line.replace(",", ".") for line in lines]
    counted = len(lines) > 2 and lines[0].strip() == str(len(lines) - 2)
    if counted or (len(lines) > 1 and lines[0].strip() == str(len(lines) - 1)):
        lines.pop(0)
    if counted and not {"x", "y", "z"} <= set(_headings(lines[0])):
        lines.pop(0)
    head = lines[0] if lines else ""
    lines = [re.sub(r"[,;\t]", " ", line) for line in lines]
    names = ["x", "y", "z", "red", "green", "blue"]
    named = False
    if lines and re.match(r"\s*[\"']?[A-Za-z_]", lines[0]) and not re.match(r"\s*(nan|inf)\b", lines[0], re.IGNORECASE):
        lines.pop(0)
        names, named = _headings(head), True
    width = len(lines[0].split()) if lines else 3
    if not named and width > 3 and _are_numbered(lines):
        names.insert(0, "number")
    names = [*names, *(f"column{i}" for i in range(len(names), width))][:width]
    columns = _text_columns("\n".join(lines).encode(), names, len(lines), name)
    colours = ("red", "green", "blue")
    if not named and "blue" in columns and _are_directions(_joined(columns, colours)):
        columns |= {axis: columns.pop(colour) for axis, colour in zip(*_NORMALS[:1], colours, strict=True)}
    return _table(columns, name)


def _are_numbered(lines: list[str]) -> bool:
    """Whether lines begin with their numbers, from 0 or 1 on."""
    first = [line.split(maxsplit=1)[0] for line in lines]
    return len(first) > 2 and first[0] in ("0", "1") and first == [str(int(first[0]) + i) for i in range(len(first))]


def _headings(line: str) -> list[str]:
    """Names of columns, in small letters, without quotes and units: `X (m)` and `Y [m]` are x and y."""
    words = re.split(r"[,;\t]", line.strip()) if re.search(r"[,;\t]", line) else line.split()
    return [re.sub(r"[\"']|\s*[\[(].*?[\])]", "", word).strip().lower() for word in words]


def _are_directions(values: Array) -> bool:
    """Whether numbers (N, 3) are unit normals and no colours: of length one, and some are negative."""
    lengths = np.linalg.norm(values, axis=1)
    return bool(np.any(values < 0) and np.all(np.abs(lengths - 1) < _UNIT))


def read_npy(content: bytes, name: str) -> CloudTable:
    """An array of shape (..., 3), or (..., 6) with colours or unit normals."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, EOFError, OSError, SyntaxError, MemoryError, OverflowError) as error:
        raise corrupt(name, f"it is no NPY array: {error}") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{name}: expected an array of numbers of shape (N, 3) or (N, 6)")
    if array.ndim < 2 or array.shape[-1] not in (3, 4, 6):
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{name}: has shape {array.shape}, expected (N, 3) or (N, 6)")
    rows = array.reshape(-1, array.shape[-1])
    colours = rows[:, 3:] if rows.shape[1] == 6 else None
    if colours is not None and _are_directions(colours.astype(np.float64)):
        return CloudTable(rows[:, :3].astype(np.float64), None, normals=colours.astype(np.float64))
    return CloudTable(rows[:, :3].astype(np.float64), None if colours is None else _shades(colours))


CLOUD_READERS = {
    ".ply": read_ply, ".pcd": read_pcd, ".xyz": read_text, ".txt": read_text, ".csv": read_text, ".asc": read_text,
    ".pts": read_text, ".npy": read_npy,
}  # fmt: skip


def _count(word: str, name: str) -> int:
    if not word.isdecimal() or len(word) > 9 or int(word) > MAX_POINTS:
        raise corrupt(name, f"it says that it holds {word[:20]} points; at most {MAX_POINTS} are read")
    return int(word)


def _refuse_more(rest: bytes, count: int, name: str) -> None:
    """Refuse points after the last one that a header states: an answer from the first ones would not show it."""
    if rest.strip(_BLANK):
        raise corrupt(name, f"it goes on after the {count} points that its header states")


def _text_columns(body: bytes, names: list[str], count: int, name: str) -> dict[str, NDArray[np.generic]]:
    if not count:
        return {column: np.zeros(0) for column in names}
    lines = body.split(b"\n", count)[:count]
    if not any(map(bytes.strip, lines)):
        raise corrupt(name, f"it ends before the first of {count} points")
    try:
        rows = np.loadtxt([line.decode("ascii") for line in lines], dtype=np.float64, ndmin=2, comments=None)
    except ValueError as error:
        raise corrupt(name, str(error).split(";")[0]) from error
    if rows.shape != (count, len(names)):
        raise corrupt(name, f"it holds {rows.shape[0]} rows of {rows.shape[1]}, expected {count} of {len(names)}")
    return {column: rows[:, i] for i, column in enumerate(names)}


def _binary_columns(
    body: bytes, names: list[str], kinds: list[str], count: int, name: str
) -> dict[str, NDArray[np.generic]]:
    if len(set(names)) != len(names):
        raise corrupt(name, "two of its columns have the same name")
    layout = np.dtype(list(zip(names, kinds, strict=True)))
    if len(body) < count * layout.itemsize:
        raise corrupt(name, f"it ends after {len(body) // max(layout.itemsize, 1)} of {count} points")
    rows = np.frombuffer(body, layout, count)
    return {column: rows[column] for column in names}


def _packed_columns(
    body: bytes, names: list[str], kinds: list[str], count: int, name: str
) -> dict[str, NDArray[np.generic]]:
    """As `_binary_columns`, packed, and one column after the other."""
    sizes = [count * np.dtype(kind).itemsize for kind in kinds]
    packed, length = np.frombuffer(body[:8].ljust(8, b"\0"), "<u4").tolist()
    if length != sum(sizes) or packed > len(body) - 8:
        raise corrupt(name, f"its {len(body)} packed bytes are not those of {count} points")
    try:
        content = unpacked(body[8 : 8 + packed], length)
    except ValueError as error:
        raise corrupt(name, str(error)) from error
    starts = np.cumsum([0, *sizes]).tolist()
    return {
        column: np.frombuffer(content, kind, count, start)
        for column, kind, start in zip(names, kinds, starts, strict=False)
    }


def _table(columns: dict[str, NDArray[np.generic]], name: str, n_faces: int = 0) -> CloudTable:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(ErrorCode.TYPE_MISMATCH, f"{name}: no column {', '.join(missing)} among {', '.join(columns)}")
    channels = next((three for three in _COLOURS if all(channel in columns for channel in three)), None)
    facing = next((three for three in _NORMALS if all(axis in columns for axis in three)), None)
    return CloudTable(
        _joined(columns, ("x", "y", "z")),
        None if channels is None else _shades(np.stack([columns[channel] for channel in channels], axis=1)),
        n_faces,
        None if facing is None else _joined(columns, facing),
        np.asarray(columns["seen"] != 0) if "seen" in columns else None,
        columns["doubt"].astype(np.float64) if "doubt" in columns else None,
    )


def _joined(columns: dict[str, NDArray[np.generic]], names: tuple[str, ...]) -> Array:
    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)


def _shades(colours: NDArray[np.generic]) -> Array:
    """(N, 3) in 0..1, whether they came as numbers up to 1, 255 or 65535."""
    values = np.nan_to_num(colours.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    largest = float(values.max(initial=0.0))
    if colours.dtype.kind == "u":
        full = float(2 ** (8 * colours.dtype.itemsize) - 1)
    else:
        full = 1.0 if largest <= 1 else 255.0 if largest <= 255 else 65535.0
    return np.clip(values / full, 0.0, 1.0)


def corrupt(name: str, what: str) -> InputError:
    """The error for a file that is not what its ending says."""
    return InputError(ErrorCode.FILE_CORRUPT, f"{name}: {what}; save it again")
