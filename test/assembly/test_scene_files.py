"""Scene files: what is read is what was written, and every bad entry is a numbered error that names it."""

import numpy as np
import pytest
import trimesh
import yaml

from poise.assembly import Analysis, Assembly, Box, Cylinder, Mesh, RigidObject, load_scene, write_scene
from poise.assembly.scene import read_object
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, quaternion_of_rotation, rotation_of_quaternion

SCENE = """
gravity: [0, 0, -9.81]
friction: 0.5
objects:
  - id: floor
    fixed: true
    box: [2.0, 2.0, 0.1]
    pose: [0, 0, -0.05, 0, 0, 0, 1]
  - id: crate
    box: [1, 1, 1]
    pose: [0, 0, 0.5, 0, 0, 0, 1]
    mass: 1.0
    com: [0, 0, 0]
    inertia: [1, 0, 0, 1, 0, 1]
friction_pairs:
  - {objects: [floor, crate], coefficient: 0.8}
"""


@pytest.fixture
def scene(tmp_path):
    """Write a scene with some entries changed, and read it."""

    def read(change=lambda content: None, text=None):
        content = yaml.safe_load(SCENE)
        change(content)
        path = tmp_path / "scene.yaml"
        path.write_text(text if text is not None else yaml.safe_dump(content))
        return load_scene(path)

    return read


def test_the_scene_of_the_contract_reads_as_it_says(scene):
    assembly = scene()
    floor, crate = assembly.objects
    assert floor.fixed
    assert crate.mass == 1
    assert crate.shape == Box((1.0, 1.0, 1.0))
    assert assembly.friction_between("crate", "floor") == 0.8
    np.testing.assert_allclose(crate.inertia_in_world, np.eye(3))
    np.testing.assert_allclose(assembly.gravity, [0, 0, -9.81])


def test_what_is_left_out_is_the_centroid_uniform_density_and_standard_gravity(scene):
    def without(content):
        del content["gravity"], content["friction_pairs"]
        del content["objects"][1]["com"], content["objects"][1]["inertia"]
        content["objects"][1]["box"] = [1, 2, 3]
        content["objects"][1]["pose"][2] = 1.5

    assembly = scene(without)
    crate = assembly.objects[1]
    np.testing.assert_allclose(crate.com_in_world, [0, 0, 1.5])
    np.testing.assert_allclose(crate.inertia_in_world, np.diag([13, 10, 5]) / 12)
    assert assembly.gravity[2] == -9.80665
    assert assembly.friction_between("floor", "crate") == 0.5


def test_a_written_scene_reads_back_the_same(tmp_path):
    rng = np.random.default_rng(0)
    trimesh.creation.cone(0.1, 0.3).export(tmp_path / "cone.stl")
    turn = rotation_of_quaternion(rng.normal(size=4))
    objects = (
        RigidObject("floor", Box((5.0, 5.0, 0.1)), Pose.from_vector([0, 0, -0.05, 0, 0, 0, 1]), fixed=True),
        RigidObject(
            "can",
            Cylinder(0.05, 0.2),
            Pose(turn, rng.normal(size=3)),
            mass=0.7,
            com=rng.normal(size=3),
            inertia=np.diag([1.0, 2.0, 2.5]),
            covariance=np.eye(10) * 1e-4,
        ),
    )
    cone = {"id": "cone", "mesh": "cone.stl", "scale": 2.0, "mass": 1.5}
    from poise.assembly.scene.scene_files import read_object

    first = Assembly((*objects, read_object(cone, tmp_path)), np.array([0.1, 0, -9.7]), 0.33)
    write_scene(first, tmp_path / "written.yaml")
    second = load_scene(tmp_path / "written.yaml")
    for a, b in zip(first.objects, second.objects, strict=True):
        assert (a.id, a.fixed, a.mass) == (b.id, b.fixed, b.mass)
        np.testing.assert_allclose(b.vertices, a.vertices, atol=1e-12)
        np.testing.assert_allclose(b.com_in_world, a.com_in_world, atol=1e-12)
        np.testing.assert_allclose(b.inertia_in_world, a.inertia_in_world, atol=1e-12)
    np.testing.assert_allclose(second.objects[1].covariance, objects[1].covariance)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cone.stl", "written.yaml"]


def test_a_mesh_in_memory_cannot_be_written_and_leaves_no_file(tmp_path):
    box = trimesh.creation.box()
    item = RigidObject("m", Mesh(np.array(box.vertices), np.array(box.faces)), Pose(np.eye(3), np.zeros(3)), fixed=True)
    with pytest.raises(InputError) as caught:
        write_scene(Assembly((item,)), tmp_path / "scene.yaml")
    assert caught.value.code is ErrorCode.UNSUPPORTED
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("format", ["stl", "ply", "obj"])
@pytest.mark.parametrize("inside_out", [False, True])
def test_a_mesh_has_the_mass_properties_of_its_solid(tmp_path, format, inside_out):
    solid = trimesh.creation.box((0.2, 0.4, 0.6), transform=trimesh.transformations.translation_matrix([1, 2, 3]))
    if inside_out:
        solid.invert()
    solid.export(tmp_path / f"solid.{format}")
    from poise.assembly.scene.scene_files import read_object

    shape = read_object({"id": "m", "mesh": f"solid.{format}", "mass": 1}, tmp_path).shape
    assert shape.volume == pytest.approx(0.048, rel=1e-5)
    np.testing.assert_allclose(shape.centroid, [1, 2, 3], rtol=1e-6)
    np.testing.assert_allclose(np.diag(shape.inertia_per_mass) * 12, [0.52, 0.40, 0.20], rtol=1e-4)
    assert len(shape.polyhedron.normals) == 6
    assert shape.polyhedron.convex


def test_package_uris_are_found_in_the_share_folder_and_do_not_leave_it(tmp_path, monkeypatch):
    share = tmp_path / "share" / "things"
    share.mkdir(parents=True)
    trimesh.creation.box().export(share / "cube.stl")
    trimesh.creation.box().export(tmp_path / "secret.stl")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    from poise.assembly.scene.scene_files import read_object

    assert read_object({"id": "m", "mesh": "package://things/cube.stl", "mass": 1}).shape.volume == pytest.approx(1)
    for source in ("package://things/../../secret.stl", "package://nothing/cube.stl", "http://host/cube.stl"):
        with pytest.raises(InputError):
            read_object({"id": "m", "mesh": source, "mass": 1})


def crate(**entries):
    def change(content):
        content["objects"][1].update(entries)

    return change


def root(**entries):
    return lambda content: content.update(entries)


def without(key):
    return lambda content: content["objects"][1].pop(key)


BAD = {
    "zero mass": (crate(mass=0), ErrorCode.OBJECT_INVALID, "crate: mass is 0 kg"),
    "negative mass": (crate(mass=-1.0), ErrorCode.OBJECT_INVALID, "crate: mass is -1 kg"),
    "mass not a number": (crate(mass=float("nan")), ErrorCode.NOT_FINITE, "crate: mass"),
    "mass as a word": (crate(mass="heavy"), ErrorCode.BAD_INPUT, "crate: mass"),
    "mass as true": (crate(mass=True), ErrorCode.BAD_INPUT, "crate: mass"),
    "no mass": (without("mass"), ErrorCode.OBJECT_INVALID, "crate: has no mass"),
    "no shape": (without("box"), ErrorCode.OBJECT_INVALID, "crate: give one of box"),
    "two shapes": (crate(cylinder=[1, 1]), ErrorCode.OBJECT_INVALID, "box and cylinder"),
    "negative side": (crate(box=[1, -1, 1]), ErrorCode.OBJECT_INVALID, "crate: entry 1 of size is -1 m"),
    "infinite side": (crate(box=[1, float("inf"), 1]), ErrorCode.NOT_FINITE, "crate: box"),
    "two sides": (crate(box=[1, 1]), ErrorCode.BAD_INPUT, "expected 3 numbers"),
    "short pose": (crate(pose=[0, 0, 0]), ErrorCode.BAD_INPUT, "expected 7 numbers"),
    "pose not finite": (crate(pose=[0, 0, float("nan"), 0, 0, 0, 1]), ErrorCode.NOT_FINITE, "crate: pose"),
    "quaternion of length 2": (crate(pose=[0, 0, 0, 0, 0, 0, 2]), ErrorCode.BAD_INPUT, "length 2"),
    "impossible inertia": (crate(inertia=[1, 0, 0, 1, 0, 5]), ErrorCode.OBJECT_INVALID, "inertia"),
    "com not finite": (crate(com=[0, 0, float("inf")]), ErrorCode.NOT_FINITE, "crate: com"),
    "fixed as a word": (crate(fixed="yes"), ErrorCode.BAD_INPUT, "crate: fixed"),
    "empty id": (crate(id=""), ErrorCode.OBJECT_INVALID, "id ''"),
    "number as id": (crate(id=3), ErrorCode.OBJECT_INVALID, "id 3"),
    "id twice": (crate(id="floor"), ErrorCode.BAD_INPUT, "floor is given twice"),
    "unknown entry": (crate(wieght=3), ErrorCode.BAD_INPUT, "unknown entry wieght"),
    "missing mesh file": (lambda c: (without("box")(c), crate(mesh="no.stl")(c)), ErrorCode.FILE_UNREADABLE, "no.stl"),
    "mesh of another kind": (lambda c: (without("box")(c), crate(mesh="a.dae")(c)), ErrorCode.UNSUPPORTED, "a.dae"),
    "nothing fixed": (lambda c: c["objects"].pop(0), ErrorCode.BAD_INPUT, "none is fixed"),
    "negative friction": (root(friction=-0.1), ErrorCode.BAD_INPUT, "friction is -0.1"),
    "friction not a number": (root(friction=float("nan")), ErrorCode.NOT_FINITE, "friction"),
    "gravity not finite": (root(gravity=[0, 0, float("-inf")]), ErrorCode.NOT_FINITE, "gravity"),
    "gravity as a number": (root(gravity=9.81), ErrorCode.BAD_INPUT, "gravity"),
    "objects not a list": (root(objects=3), ErrorCode.BAD_INPUT, "objects"),
    "an object that is a word": (lambda c: c["objects"].append("box"), ErrorCode.BAD_INPUT, "objects[2]"),
    "pair with an unknown id": (
        root(friction_pairs=[{"objects": ["floor", "ghost"], "coefficient": 1}]),
        ErrorCode.OBJECT_UNKNOWN,
        "ghost",
    ),
    "pair of one": (root(friction_pairs=[{"objects": ["floor"], "coefficient": 1}]), ErrorCode.BAD_INPUT, "two ids"),
    "negative pair": (
        root(friction_pairs=[{"objects": ["floor", "crate"], "coefficient": -1}]),
        ErrorCode.BAD_INPUT,
        "floor and crate: entry 0 of friction is -1",
    ),
    "pair with itself": (
        root(friction_pairs=[{"objects": ["crate", "crate"], "coefficient": 1}]),
        ErrorCode.BAD_INPUT,
        "one object",
    ),
    "pair twice": (
        root(friction_pairs=[{"objects": pair, "coefficient": 1} for pair in (["floor", "crate"], ["crate", "floor"])]),
        ErrorCode.BAD_INPUT,
        "crate and floor: given twice",
    ),
    "unknown entry at the root": (root(colour="red"), ErrorCode.BAD_INPUT, "colour"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_entry_is_a_numbered_error_that_names_it(scene, case):
    change, code, words = BAD[case]
    with pytest.raises(InputError) as caught:
        scene(change)
    assert caught.value.code is code
    assert words in caught.value.message


@pytest.mark.parametrize(
    "text", ["", "just words", "{unclosed", "- 1\n- 2", "objects: &a [*a]", "!!python/object:os.system {}", "\x00"]
)
def test_a_file_that_is_no_scene_is_refused(scene, text):
    with pytest.raises(InputError):
        scene(text=text)


def test_a_missing_file_is_unreadable(tmp_path):
    with pytest.raises(InputError) as caught:
        load_scene(tmp_path / "none.yaml")
    assert caught.value.code is ErrorCode.FILE_UNREADABLE


@pytest.mark.parametrize(
    "content", [b"", b"solid broken", b"\x80\x00garbage" * 50, b"ply\nformat ascii 1.0\nend_header\n"]
)
@pytest.mark.parametrize("suffix", ["stl", "ply", "obj"])
def test_a_broken_mesh_file_is_refused(tmp_path, content, suffix):
    from poise.assembly.scene.scene_files import read_object

    (tmp_path / f"bad.{suffix}").write_bytes(content)
    with pytest.raises(InputError):
        read_object({"id": "m", "mesh": f"bad.{suffix}", "mass": 1}, tmp_path)


def test_an_open_mesh_is_refused(tmp_path):
    from poise.assembly.scene.scene_files import read_object

    solid = trimesh.creation.box()
    solid.faces = solid.faces[:-1]
    solid.export(tmp_path / "open.stl")
    with pytest.raises(InputError, match="holes") as caught:
        read_object({"id": "m", "mesh": "open.stl", "mass": 1}, tmp_path)
    assert caught.value.code is ErrorCode.MESH_INVALID


def test_rotations_and_quaternions_are_inverse():
    rng = np.random.default_rng(2)
    for quaternion in (*rng.normal(size=(50, 4)), [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]):
        rotation = rotation_of_quaternion(quaternion)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(rotation_of_quaternion(quaternion_of_rotation(rotation)), rotation, atol=1e-12)


def test_the_scene_of_the_contract_stands(scene):
    assert Analysis.of(scene()).stability().stable


def test_every_true_inertia_is_accepted_at_every_scale():
    rng = np.random.default_rng(8)
    turns = rng.normal(size=(10_000, 4))
    seconds = rng.uniform(0, 1, (10_000, 3))  # second moments: rods (two are zero) and plates (one is) among them
    seconds[::10, :2] = 0.0
    seconds[1::10, 2] = 0.0
    for turn, second, scale in zip(turns, seconds, np.geomspace(1e-6, 1e3, 10_000), strict=True):
        rotation = rotation_of_quaternion(turn)
        inertia = scale * rotation @ np.diag(second.sum() - second) @ rotation.T
        RigidObject("body", Box((1, 1, 1)), UPRIGHT, mass=1.0, inertia=inertia)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize(
    "inertia",
    [
        [[1, 0.01, 0], [0, 1, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 2.01]],
        [[1, 0, 0], [0, -0.01, 0], [0, 0, 1]],
        [[1, 0], [0, 1]],
    ],
)
def test_an_inertia_of_no_body_is_refused_at_every_scale(inertia, scale):
    with pytest.raises(InputError) as refused:
        RigidObject("body", Box((1, 1, 1)), UPRIGHT, mass=1.0, inertia=scale * np.array(inertia, dtype=float))
    assert refused.value.code is ErrorCode.OBJECT_INVALID


UPRIGHT = Pose.from_vector([0, 0, 0, 0, 0, 0, 1])


@pytest.mark.parametrize(
    ("written", "value"),
    [("-.05", -0.05), ("+.5", 0.5), (".5", 0.5), ("1e-2", 0.01), ("-.5e-1", -0.05), ("1.e-2", 0.01), ("+.5e+0", 0.5)],
)
def test_numbers_that_yaml_takes_for_text_are_read(written, value):
    pose = yaml.safe_load(f"[{written}, 0, 0, 0, 0, 0, 1]")
    item = read_object({"id": "a", "box": [1, 1, 1], "mass": 1, "pose": pose})
    assert item.pose.translation[0] == value


@pytest.mark.parametrize("written", ["'5'", "'.'", "-.", "1.2.3", "0x", "-.5.", "yes", "1:30h"])
def test_other_text_is_no_number(written):
    pose = yaml.safe_load(f"[{written}, 0, 0, 0, 0, 0, 1]")
    with pytest.raises(InputError, match="expected a number"):
        read_object({"id": "a", "box": [1, 1, 1], "mass": 1, "pose": pose})


def test_a_covariance_may_be_given_in_rows(tmp_path):
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(6, 6)) * 1e-3, rng.normal(size=(10, 10)) * 1e-3
    pose, inertial = (root @ root.T for root in roots)
    entry = {"id": "can", "cylinder": [0.05, 0.2], "mass": 0.7}
    flat = read_object({**entry, "pose_covariance": pose.ravel().tolist(), "covariance": inertial.ravel().tolist()})
    rows = read_object({**entry, "pose_covariance": pose.tolist(), "covariance": inertial.tolist()})
    np.testing.assert_array_equal(rows.pose_covariance, flat.pose_covariance)
    np.testing.assert_array_equal(rows.covariance, flat.covariance)
    with pytest.raises(InputError, match=r"pose_covariance, row 2: expected 6 numbers"):
        read_object({**entry, "pose_covariance": [*pose.tolist()[:2], [1, 2], *pose.tolist()[3:]]})
    lopsided = pose.copy()
    lopsided[0, 1] += 1e-3
    with pytest.raises(InputError, match="symmetric"):
        read_object({**entry, "pose_covariance": lopsided.tolist()})


def test_a_scene_file_is_one_document(tmp_path):
    path = tmp_path / "two.yaml"
    path.write_text("objects: []\n---\nobjects: []\n")
    with pytest.raises(InputError, match="several documents"):
        load_scene(path)
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"not YAML: .*nest"):
        load_scene(path)
