"""Mesh input: every format gives the same body, broken meshes are repaired and reported, bad ones are refused."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from poise.errors import ErrorCode, InputError
from poise.shape.mesh_worker import MeshWorker
from poise.shape.meshes import CheckedMesh, check_mesh, parse_mesh, read_mesh, read_triangles

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])


def binary_stl(triangles: np.ndarray = CUBE, corners: np.ndarray = CORNERS) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[t].ravel(), 0) for t in triangles)
    return b"made by a test".ljust(80) + struct.pack("<I", len(triangles)) + facets


def text_stl() -> bytes:
    lines = ["solid cube"]
    for triangle in CUBE:
        lines += ["facet normal 0 0 0", " outer loop", *(f"  vertex {x} {y:e} {z}" for x, y, z in CORNERS[triangle])]
        lines += [" endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube"]).encode()


def obj() -> bytes:
    lines = ["mtllib http://example.org/evil.mtl", *(f"v {x} {y} {z}" for x, y, z in CORNERS)]
    return "\n".join([*lines, *("f " + " ".join(f"{c + 1}//1" for c in quad) for quad in QUADS)]).encode()


def ply(encoding: str, faces: np.ndarray = CUBE) -> bytes:
    head = f"ply\nformat {encoding} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(faces)}\nproperty uchar red\nproperty list uchar int vertex_indices\nend_header\n"
    if encoding == "ascii":
        rows = [*CORNERS.tolist(), *([9, len(face), *face] for face in faces.tolist())]
        return head.encode() + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    order = "<" if "little" in encoding else ">"
    body = CORNERS.astype(order + "f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"{order}BB{len(f)}i", 9, len(f), *f) for f in faces.tolist())


def glb() -> bytes:
    """Half as large, at a node that doubles it."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(CORNERS / 2, CUBE, process=False), transform=np.diag([2.0, 2, 2, 1]))
    return bytes(scene.export(file_type="glb"))


def usda(unit: float = 0.01) -> bytes:
    """In cm, moved by its node, and with faces of four corners."""
    points = ", ".join(f"({x / unit - 7}, {y / unit}, {z / unit})" for x, y, z in CORNERS)
    return f"""#usda 1.0
( metersPerUnit = {unit} )
def Xform "cube" {{
    double3 xformOp:translate = (7, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "surface" {{
        int[] faceVertexCounts = {[4] * 6}
        int[] faceVertexIndices = {QUADS.ravel().tolist()}
        point3f[] points = [{points}]
    }}
}}
""".encode()


FILES = {
    "binary.stl": binary_stl(), "text.stl": text_stl(), "quads.obj": obj(), "text.ply": ply("ascii", QUADS),
    "little.ply": ply("binary_little_endian"), "big.ply": ply("binary_big_endian", QUADS),
    "scene.glb": glb(), "stage.usda": usda(),
}  # fmt: skip


def volume(mesh: CheckedMesh) -> float:
    return float(np.linalg.det(mesh.vertices[mesh.triangles]).sum() / 6)


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_cube(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    mesh = read_mesh(name, tmp_path, scale=0.1)
    assert volume(mesh) == pytest.approx(1e-3)
    assert (len(mesh.vertices), len(mesh.triangles), mesh.notes) == (8, 12, ())


def test_inside_out_and_mixed_normals_are_turned_and_named() -> None:
    inside_out = check_mesh(CORNERS, CUBE[:, ::-1])
    assert volume(inside_out) == pytest.approx(1)
    assert "inside out" in inside_out.notes[0]
    mixed = CUBE.copy()
    mixed[[2, 5, 7]] = mixed[[2, 5, 7], ::-1]
    repaired = check_mesh(CORNERS, mixed)
    assert volume(repaired) == pytest.approx(1)
    assert "3 triangles were turned" in repaired.notes[0]


def test_a_hole_is_closed_and_named_and_a_sheet_is_refused() -> None:
    points, triangles = sphere()
    repaired = check_mesh(points, triangles[3:])
    assert volume(repaired) == pytest.approx(volume(check_mesh(points, triangles)), rel=0.01)
    assert "closed" in repaired.notes[0]
    with pytest.raises(InputError, match="sheet") as refused:
        check_mesh(points, triangles[: len(triangles) // 2])
    assert refused.value.code is ErrorCode.MESH_INVALID


def test_triangles_without_area_and_doubles_are_left_out_and_named() -> None:
    more = np.concatenate([CUBE, CUBE[:2], [[0, 0, 1], [2, 2, 2]]])
    mesh = check_mesh(CORNERS, more)
    assert len(mesh.triangles) == 12
    assert len(mesh.notes) == 2


def two_cubes(shift: float, turn: bool = False, size: float = 1.0) -> CheckedMesh:
    other = CUBE[:, ::-1] if turn else CUBE
    return check_mesh(np.concatenate([CORNERS, size * CORNERS + shift]), np.concatenate([CUBE, other + 8]))


def test_shells_apart_stay_and_one_that_is_inside_out_is_turned() -> None:
    assert volume(two_cubes(2.0)) == pytest.approx(2)
    assert volume(two_cubes(2.0, turn=True)) == pytest.approx(2)


def test_shells_that_overlap_count_once() -> None:
    pytest.importorskip("manifold3d")
    united = two_cubes(0.5)
    assert volume(united) == pytest.approx(2 - 0.125)
    assert "united" in united.notes[0]


def test_a_hollow_stays_hollow() -> None:
    assert volume(two_cubes(0.25, turn=True, size=0.5)) == pytest.approx(1 - 0.125)


def test_a_body_inside_another_counts_once() -> None:
    pytest.importorskip("manifold3d")
    assert volume(two_cubes(0.25, size=0.5)) == pytest.approx(1)


def test_triangles_are_read_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "open.stl"
    path.write_bytes(binary_stl(CUBE[:6]))
    points, triangles = read_triangles(path, tmp_path, scale=0.5)
    assert triangles.shape == (6, 3)
    assert len(points) == 18  # an STL names no vertex twice
    assert points.max() == 0.5
    with pytest.raises(InputError) as refused:
        read_mesh(path, tmp_path)
    assert refused.value.code is ErrorCode.MESH_INVALID
    path.write_bytes(stl_with(np.nan))
    with pytest.raises(InputError) as refused:
        read_triangles(path, tmp_path)
    assert refused.value.code is ErrorCode.NOT_FINITE


def sphere() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    triangles = hull.simplices.astype(np.int64)
    outwards = (
        np.einsum(
            "ij,ij->i", np.linalg.cross(*np.moveaxis(np.diff(points[triangles], axis=1), 1, 0)), points[triangles[:, 0]]
        )
        > 0
    )
    return points, np.where(outwards[:, None], triangles, triangles[:, ::-1])


@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("http://example.org/a.stl", ErrorCode.UNSUPPORTED),
        ("file:///etc/passwd.stl", ErrorCode.UNSUPPORTED),
        ("../outside.stl", ErrorCode.UNSUPPORTED),
        ("a/../../outside.stl", ErrorCode.UNSUPPORTED),
        ("package://poise/../../../etc/x.stl", ErrorCode.UNSUPPORTED),
        ("package://../share/x.stl", ErrorCode.FILE_UNREADABLE),
        ("package://no_such_package/x.stl", ErrorCode.FILE_UNREADABLE),
        ("package://", ErrorCode.FILE_UNREADABLE),
        ("nowhere.stl", ErrorCode.FILE_UNREADABLE),
        ("folder.stl", ErrorCode.FILE_UNREADABLE),
        ("nul\0.stl", ErrorCode.FILE_UNREADABLE),
        ("scene.dae", ErrorCode.UNSUPPORTED),
        ("/dev/zero", ErrorCode.UNSUPPORTED),
    ],
)
def test_sources_that_lead_elsewhere_are_refused(
    source: str, code: ErrorCode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "share" / "poise").mkdir(parents=True)
    (tmp_path / "folder.stl").mkdir()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with pytest.raises(InputError) as refused:
        read_mesh(source, tmp_path)
    assert refused.value.code is code


def test_a_package_uri_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "share" / "tools" / "meshes"
    folder.mkdir(parents=True)
    (folder / "cube.stl").write_bytes(binary_stl())
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert volume(read_mesh("package://tools/meshes/cube.stl")) == pytest.approx(1)


def stl_with(value: float) -> bytes:
    corners = CORNERS.copy()
    corners[3, 1] = value
    return binary_stl(corners=corners)


LITTLE, TEXT = ply("binary_little_endian"), ply("ascii")
C, N, M, U = ErrorCode.FILE_CORRUPT, ErrorCode.NOT_FINITE, ErrorCode.MESH_INVALID, ErrorCode.UNSUPPORTED
BAD: dict[str, tuple[str, bytes, ErrorCode]] = {
    "empty stl": (".stl", b"", C),
    "stl with nothing but a header": (".stl", b"x" * 84, C),
    "stl cut": (".stl", binary_stl()[:-1], C),
    "stl with a facet too many": (".stl", binary_stl() + bytes(50), C),
    "stl that boasts": (".stl", binary_stl()[:80] + b"\xff\xff\xff\xff" + binary_stl()[84:], C),
    "stl of no facets": (".stl", binary_stl()[:80] + bytes(4), M),
    "stl of one facet": (".stl", binary_stl(CUBE[:1]), M),
    "stl with nan": (".stl", stl_with(np.nan), N),
    "stl with infinity": (".stl", stl_with(np.inf), N),
    "stl flat": (".stl", binary_stl(corners=CORNERS * [1, 1, 0]), M),
    "stl on a point": (".stl", binary_stl(corners=CORNERS * 0), M),
    "stl half": (".stl", binary_stl(CUBE[:6]), M),
    "text stl with a word for a number": (".stl", text_stl().replace(b"0.0", b"zero", 1), C),
    "text stl with two corners": (".stl", text_stl().replace(b"  vertex 0.0 0.000000e+00 0.0\n", b"", 1), C),
    "text stl cut": (".stl", text_stl()[:-60], C),
    "text stl with nan": (".stl", text_stl().replace(b"vertex 0.0", b"vertex nan", 1), N),
    "text stl empty": (".stl", b"solid nothing\nendsolid", M),
    "text stl without end of loop": (".stl", text_stl().replace(b"endloop", b"", 1), C),
    "html": (".stl", b"<html><body>404 not found</body></html>" * 9, C),
    "zip": (".stl", b"PK\x03\x04" + bytes(200), C),
    "empty obj": (".obj", b"", M),
    "obj with a word for a number": (".obj", obj().replace(b"v 0.0", b"v zero", 1), C),
    "obj with two coordinates": (".obj", obj().replace(b"v 0.0 0.0 0.0", b"v 0.0 0.0", 1), C),
    "obj with a corner that is not there": (".obj", obj().replace(b"f 1//1", b"f 99//1", 1), M),
    "obj with corner zero": (".obj", obj().replace(b"f 1//1", b"f 0//1", 1), M),
    "obj with a corner far below": (".obj", obj().replace(b"f 1//1", b"f -99//1", 1), M),
    "obj with an edge for a face": (".obj", obj() + b"\nf 1 2\n", C),
    "obj with nan": (".obj", obj().replace(b"v 0.0", b"v nan", 1), N),
    "obj with a number beyond all": (".obj", obj().replace(b"v 0.0", b"v 1e999", 1), N),
    "obj with a word in a face": (".obj", obj() + b"\nf a b c\n", C),
    "obj of points": (".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", M),
    "binary as obj": (".obj", bytes(range(256)) * 20, M),
    "empty ply": (".ply", b"", C),
    "ply without end": (".ply", b"ply\nformat ascii 1.0\n", C),
    "ply of points": (".ply", LITTLE.replace(b"element face", b"element dots"), U),
    "ply that boasts of faces": (".ply", LITTLE.replace(b"face 12", b"face 99999999999"), C),
    "ply with more faces than bytes": (".ply", LITTLE.replace(b"face 12", b"face 13"), C),
    "ply with more vertices than bytes": (".ply", LITTLE.replace(b"vertex 8", b"vertex 4000000"), C),
    "ply cut": (".ply", LITTLE[:-3], C),
    "ply with nan": (".ply", LITTLE.replace(struct.pack("<f", 1), struct.pack("<f", np.nan), 1), N),
    "ply with a corner that is not there": (".ply", LITTLE[:-4] + struct.pack("<i", 8), M),
    "ply with a negative corner": (".ply", LITTLE[:-4] + struct.pack("<i", -1), M),
    "ply with a huge list": (".ply", LITTLE[:-13] + b"\xff" + LITTLE[-12:], C),
    "ply of unknown type": (".ply", LITTLE.replace(b"list uchar int", b"list uchar quark"), C),
    "ply without a list": (".ply", LITTLE.replace(b"list uchar int", b"int"), C),
    "ply without z": (".ply", LITTLE.replace(b"float z", b"float w"), C),
    "text ply cut": (".ply", TEXT[:-12], C),
    "text ply with a word": (".ply", TEXT.replace(b"0.0", b"zero", 1), C),
    "text ply with a face of two": (".ply", TEXT.replace(b"9 3 0 1 3", b"9 2 0 1", 1), C),
    "empty glb": (".glb", b"", C),
    "glb cut": (".glb", glb()[:-20], C),
    "stl as glb": (".glb", binary_stl(), C),
    "empty usd": (".usda", b"", C),
    "usd cut": (".usda", usda()[:200], C),
    "usd without a mesh": (".usda", b"#usda 1.0\n", M),
    "usd with corners that are missing": (".usda", usda().replace(b"[4, 4", b"[4, 5", 1), C),
    "another format": (".dae", b"<COLLADA/>", U),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_a_code(name: str) -> None:
    suffix, content, code = BAD[name]
    with pytest.raises(InputError) as refused:
        parse_mesh(content, suffix, name)
    assert refused.value.code is code, refused.value.message
    assert name in refused.value.message


@pytest.mark.parametrize("name", FILES)
def test_flipped_and_missing_bytes_never_raise_anything_else(name: str) -> None:
    rng = np.random.default_rng(len(name))
    for _ in range(60):
        content = bytearray(FILES[name])
        for place in rng.integers(len(content), size=rng.integers(1, 4)):
            content[place] = rng.integers(256)
        try:
            mesh = parse_mesh(bytes(content[: rng.integers(len(content) // 2, len(content) + 1)]), Path(name).suffix)
        except InputError:
            continue
        assert volume(mesh) > 0


def test_a_process_that_dies_or_takes_too_long_is_replaced() -> None:
    worker = MeshWorker(memory=700_000_000)
    hungry = b"v 0 0 0\n" * 11_000_000  # 88 MB that become far more as numbers
    with pytest.raises(InputError, match="too much memory") as refused:
        worker.parse(hungry, ".obj", "hungry.obj")
    assert refused.value.code is ErrorCode.MESH_INVALID
    assert len(worker.parse(binary_stl(), ".stl", "cube.stl")[1]) == 12
    impatient = MeshWorker(seconds=0.0)
    with pytest.raises(InputError, match="too much time"):
        impatient.parse(binary_stl(), ".stl", "cube.stl")
    worker.stop()
