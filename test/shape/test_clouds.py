"""The door for point clouds: every format gives the same points, and bad files a coded sentence."""

from pathlib import Path

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.shape.clouds import check_cloud, read_cloud

POINTS = np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.05, 0.05, -0.3]])
COLOURS = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 51], [102, 102, 255]], dtype=np.uint8)


def ply(encoding: str, colour: str = "uchar") -> bytes:
    properties = [f"property float {axis}" for axis in "xyz"] + [
        f"property {colour} {c}" for c in ("red", "green", "blue")
    ]
    header = ["ply", f"format {encoding} 1.0", "comment a cloud", "element vertex 4", *properties]
    head = "\n".join([*header, "property uint8 segmentation", "end_header", ""]).encode()
    shades = COLOURS / 255 if colour == "float32" else COLOURS
    if encoding == "ascii":
        rows = (
            " ".join([*map(str, p), *map(str, c), "9"]) for p, c in zip(POINTS.tolist(), shades.tolist(), strict=True)
        )
        return head + "\n".join(rows).encode() + b"\n"
    order = "<" if "little" in encoding else ">"
    table = np.zeros(
        4, [("p", order + "f4", 3), ("c", order + ("f4" if colour == "float32" else "u1"), 3), ("s", "u1")]
    )
    table["p"], table["c"] = POINTS, shades
    return head + table.tobytes()


def pcd(encoding: str) -> bytes:
    rgb = (COLOURS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)).astype(np.uint32)
    fields = "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\n"
    head = f"# .PCD v0.7\nVERSION 0.7\n{fields}DATA {encoding}\n".encode()
    if encoding == "ascii":
        packed = rgb.view(np.float32)
        rows = (f"{x} {y} {z} {float(c)!r}" for (x, y, z), c in zip(POINTS.tolist(), packed, strict=True))
        return head + "\n".join(rows).encode()
    table = np.zeros(4, [("p", "<f4", 3), ("rgb", "<u4")])
    table["p"], table["rgb"] = POINTS, rgb
    return head + table.tobytes()


def packed_pcd(colour: str = "rgb") -> bytes:
    """As the Point Cloud Library packs it: one column after the other; here with literals and one copy."""
    plain = pcd("binary").replace(b"z rgb", f"z {colour}".encode())
    head, body = plain.split(b"DATA binary\n")
    rows = np.frombuffer(body, "<u4").reshape(4, 4)
    columns = np.ascontiguousarray(rows.T).tobytes()
    first = columns.index(bytes(8))  # eight zero bytes, of which the last seven are copied from one byte before
    pieces = [bytes([first]), columns[: first + 1], bytes([5 << 5, 0])]
    for start in range(first + 8, len(columns), 32):
        piece = columns[start : start + 32]
        pieces += [bytes([len(piece) - 1]), piece]
    packed = b"".join(pieces)
    return head + b"DATA binary_compressed\n" + np.array([len(packed), len(columns)], "<u4").tobytes() + packed


def text(separator: str, header: str = "") -> bytes:
    rows = (separator.join(map(str, [*p, *c])) for p, c in zip(POINTS.tolist(), COLOURS.tolist(), strict=True))
    return (header + "\n".join(rows) + "\n").encode()


FILES = {
    "ascii.ply": ply("ascii"),
    "float_colours.ply": ply("ascii", "float32"),
    "little.ply": ply("binary_little_endian"),
    "big.ply": ply("binary_big_endian", "float32"),
    "ascii.pcd": pcd("ascii"),
    "binary.pcd": pcd("binary"),
    "packed.pcd": packed_pcd(),
    "rgba.pcd": pcd("binary").replace(b"z rgb", b"z rgba").replace(b"TYPE F F F F", b"TYPE F F F U"),
    "packed_rgba.pcd": packed_pcd("rgba"),
    "blanks.xyz": text(" ", "# x y z r g b\n"),
    "commas.csv": text(",", "x,y,z,r,g,b\n"),
    "semicolons.txt": text("; "),
    "units.csv": text(",", '"X (m)","Y [m]",Z,Red,Green,Blue\n'),
    "semicolon_comments.xyz": text(" ", "; by a scanner\n;in metres\n").replace(b"\n", b" ; a point\n"),
    "ends.xyz": text(" ").replace(b"\n", b" # a point\n", 2).replace(b"\n", b" // the last\n"),
    "counted.xyz": text(" ", "4\n"),
    "titled.xyz": text(" ", "4\nscan 7 of a mug\n"),
    "counted_names.xyz": text(";", "4\nx;y;z;r;g;b\n"),
    "numbered.xyz": b"".join(b"%d %s\n" % (i, line) for i, line in enumerate(text(" ").splitlines())),
}


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_points(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-8)
    assert cloud.colours is not None
    np.testing.assert_allclose(cloud.colours, COLOURS / 255, atol=1e-6)


def test_a_semicolon_before_what_is_no_number_parts_columns(tmp_path: Path) -> None:
    path = tmp_path / "between.xyz"
    rows = [" ; ".join(map(str, point)) for point in POINTS.tolist()]
    path.write_text(
        "\n".join(["point # ; x ; y ; z", *(f"{7 * i} ; {row}" for i, row in enumerate(rows)), "9;0;nan ; inf"])
    )
    np.testing.assert_allclose(read_cloud(path).points, POINTS, atol=1e-8)


def test_arrays_with_colours_and_without(tmp_path: Path) -> None:
    np.save(tmp_path / "plain.npy", POINTS.reshape(2, 2, 3))
    np.testing.assert_array_equal(read_cloud(tmp_path / "plain.npy").points, POINTS)
    np.save(tmp_path / "coloured.npy", np.concatenate([POINTS, COLOURS], axis=1))
    coloured = read_cloud(tmp_path / "coloured.npy").colours
    assert coloured is not None
    np.testing.assert_allclose(coloured, COLOURS / 255)


def test_rows_that_are_no_point_get_the_label_minus_one() -> None:
    cloud = check_cloud(np.insert(POINTS, 1, [np.nan, 0, np.inf], axis=0))
    assert cloud.spread(np.array([5, 6, 7, 8])).tolist() == [5, -1, 6, 7, 8]
    assert "1 of 5 points" in cloud.notes[0]


def test_millimetres_are_named() -> None:
    with pytest.raises(InputError, match=r"millimetres.*--scale 0\.001") as refused:
        check_cloud(1000 * POINTS)
    assert refused.value.code is ErrorCode.BAD_INPUT
    np.testing.assert_allclose(check_cloud(1000 * POINTS, scale=0.001).points, POINTS)


HEAD = b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
BAD = {
    "empty.ply": (b"", ErrorCode.FILE_CORRUPT),
    "no_end.ply": (HEAD[:60], ErrorCode.FILE_CORRUPT),
    "cut.ply": (HEAD + b"0 0 1\n", ErrorCode.FILE_CORRUPT),
    "words.ply": (HEAD + b"0 0 1\nzero one two\n", ErrorCode.FILE_CORRUPT),
    "ragged.ply": (HEAD + b"0 0 1\n0 1\n", ErrorCode.FILE_CORRUPT),
    "nothing_finite.ply": (HEAD + b"nan 0 0\n0 inf 0\n", ErrorCode.EMPTY),
    "cut_binary.ply": (ply("binary_little_endian")[:-20], ErrorCode.FILE_CORRUPT),
    "boast.ply": (HEAD.replace(b"vertex 2", b"vertex 999999999999"), ErrorCode.FILE_CORRUPT),
    "negative.ply": (HEAD.replace(b"vertex 2", b"vertex -2"), ErrorCode.FILE_CORRUPT),
    "zero.ply": (HEAD.replace(b"vertex 2", b"vertex 0"), ErrorCode.EMPTY),
    "odd_type.ply": (HEAD.replace(b"float z", b"quark z"), ErrorCode.FILE_CORRUPT),
    "odd_format.ply": (HEAD.replace(b"ascii", b"morse"), ErrorCode.FILE_CORRUPT),
    "no_z.ply": (HEAD.replace(b"float z", b"float w") + b"0 0 1\n0 1 1\n", ErrorCode.TYPE_MISMATCH),
    "list.ply": (HEAD.replace(b"float z", b"list uchar int z"), ErrorCode.UNSUPPORTED),
    "faces_first.ply": (HEAD.replace(b"vertex", b"face"), ErrorCode.UNSUPPORTED),
    "empty.pcd": (b"", ErrorCode.FILE_CORRUPT),
    "cut.pcd": (pcd("binary")[:-9], ErrorCode.FILE_CORRUPT),
    "compressed.pcd": (pcd("binary").replace(b"DATA binary", b"DATA binary_compressed"), ErrorCode.FILE_CORRUPT),
    "cut_compressed.pcd": (packed_pcd()[:-5], ErrorCode.FILE_CORRUPT),
    "other.pcd": (pcd("binary").replace(b"DATA binary", b"DATA zipped"), ErrorCode.UNSUPPORTED),
    "fields.pcd": (pcd("binary").replace(b"SIZE 4 4 4 4", b"SIZE 4 4 4"), ErrorCode.FILE_CORRUPT),
    "huge_count.pcd": (pcd("binary").replace(b"COUNT 1 1 1 1", b"COUNT 9999999 1 1 1"), ErrorCode.FILE_CORRUPT),
    "empty.xyz": (b"", ErrorCode.EMPTY),
    "prose.xyz": (b"once upon a time\nthere was\n", ErrorCode.FILE_CORRUPT),
    "two_columns.csv": (b"1,2\n3,4\n", ErrorCode.TYPE_MISMATCH),
    "no_array.npy": (b"\x93NUMPY\x01\x00nonsense", ErrorCode.FILE_CORRUPT),
    "cloud.stl": (b"solid", ErrorCode.UNSUPPORTED),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_a_code(name: str, tmp_path: Path) -> None:
    content, code = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_cloud(tmp_path / name)
    assert refused.value.code is code
    assert name in refused.value.message


@pytest.mark.parametrize("content", [ply("ascii"), ply("binary_big_endian"), pcd("ascii"), pcd("binary")])
def test_points_after_those_that_the_header_states_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / ("cloud.ply" if content.startswith(b"ply") else "cloud.pcd")
    path.write_bytes(content + b"\n")  # an empty line is no point
    assert read_cloud(path).points == pytest.approx(POINTS)
    path.write_bytes(content.replace(b"vertex 4", b"vertex 2").replace(b"POINTS 4", b"POINTS 2"))
    with pytest.raises(InputError, match="goes on after the 2 points") as refused:
        read_cloud(path)
    assert refused.value.code == ErrorCode.FILE_CORRUPT


def test_a_file_that_is_not_there_and_pickled_arrays_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        read_cloud(tmp_path / "nowhere.ply")
    assert refused.value.code is ErrorCode.FILE_UNREADABLE
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError) as refused:
        read_cloud(tmp_path / "objects.npy")
    assert refused.value.code is ErrorCode.FILE_CORRUPT


@pytest.mark.parametrize("name", FILES)
def test_flipped_and_missing_bytes_never_raise_anything_else(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(len(name))
    path = tmp_path / name
    for _ in range(150):
        content = bytearray(FILES[name])
        for place in rng.integers(len(content), size=rng.integers(1, 4)):
            content[place] = rng.integers(256)
        path.write_bytes(content[: rng.integers(len(content) // 2, len(content) + 1)])
        try:
            cloud = read_cloud(path)
        except InputError:
            continue
        assert np.all(np.isfinite(cloud.points))


def test_places_of_pixels_without_depth_are_left_out(tmp_path: Path) -> None:
    points = np.random.default_rng(0).random((100, 3))
    for value in (0.0, -9999.0):
        cloud = check_cloud(np.concatenate([points, np.full((30, 3), value)]))
        np.testing.assert_array_equal(cloud.rows, np.arange(100))
        assert "30 of 130 points" in cloud.notes[0]
    planes = check_cloud(np.round(points, 1))  # many have one x, and none has one place
    assert len(planes.points) == 100
    thrice = check_cloud(np.repeat(0.1 * points, 12, axis=0))
    assert len(thrice.points) == 1200
    assert not thrice.notes


@pytest.mark.parametrize("suffix", [".xyz", ".npy"])
def test_unit_normals_without_names_are_no_colours(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(1)
    points, normals, path = rng.random((50, 3)), rng.normal(size=(50, 3)), tmp_path / f"cloud{suffix}"
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rows = np.concatenate([points, normals], axis=1)
    (np.save if suffix == ".npy" else np.savetxt)(path, rows)  # type: ignore[operator]
    cloud = read_cloud(path)
    assert cloud.colours is None
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, normals, atol=1e-12)


def test_a_first_line_may_say_how_many_follow(tmp_path: Path) -> None:
    path = tmp_path / "cloud.pts"
    rows = "\n".join(" ".join(map(str, point)) for point in POINTS.tolist())
    path.write_text(f"4\n{rows}\n")
    np.testing.assert_allclose(read_cloud(path).points, POINTS)
    path.write_text(f"5\n{rows}\n")
    with pytest.raises(InputError, match="columns changed from 1 to 3") as refused:
        read_cloud(path)
    assert "usecols" not in refused.value.message


def test_centimetres_are_named() -> None:
    with pytest.raises(InputError, match=r"centimetres.*--scale 0\.01"):
        check_cloud(10 * np.random.default_rng(0).random((100, 3)))


@pytest.mark.parametrize("between", [";", " ", "\t", "; "])
def test_decimal_commas_are_read(tmp_path: Path, between: str) -> None:
    path = tmp_path / "cloud.csv"
    rows = [between.join(f"{value:.3f}".replace(".", ",") for value in point) for point in POINTS.tolist()]
    path.write_text("\n".join([between.join("xyz"), *rows]))
    np.testing.assert_allclose(read_cloud(path).points, POINTS)


@pytest.mark.parametrize(("size", "said"), [(4.9, True), (0.3, False), (0.006, True)])
def test_a_size_that_few_objects_have_asks_for_the_unit(size: float, said: bool) -> None:
    """An object in inches is 2 to 5 units across, and a mesh of the size one is 1 to 1.7."""
    points = size / np.sqrt(3) * np.random.default_rng(0).random((200, 3))
    assert any("state the unit" in note for note in check_cloud(points).notes) == said
