"""Tables with a mapping give the streams of the bag with the same content; what is wrong with them is one sentence."""

import zipfile

import numpy as np
import pytest
import scipy.io
import yaml
from mapped_tables import write_csv, write_mapping
from test_bag_bad_input import refused

from poise.errors import ErrorCode
from poise.recording import LossKind, open_recording

XYZ = ("x", "y", "z")


def columns_of(streams):
    """The sample streams as tables: file name to columns, and the mapping that reads them again."""
    wrench, joints, imu, odom = (streams[name] for name in ("wrench", "joint_states", "imu", "odom"))
    fixed, tf = streams["tf_static"], streams["tf"]
    tables = {
        "wrench": {
            "t": wrench.stamps,
            **named("f", wrench.wrench_in_sensor[:, :3]),
            **named("m", wrench.wrench_in_sensor[:, 3:]),
        },
        "joints": {"t": joints.stamps, **named("q", joints.position, "cab"), **named("v", joints.velocity, "cab")},
        "imu": {"t": imu.stamps, **named("a", imu.linear_acceleration)},
        "odom": {"t": odom.stamps, **pose_columns(odom)},
        "tf": {"t": tf.stamps, **pose_columns(tf)},
        "tf_static": {"t": fixed.stamps, **pose_columns(fixed)},
    }
    translation, rotation = [f"p{axis}" for axis in XYZ], [f"r{row}{column}" for row in "123" for column in "123"]
    pose = {"translation": translation, "rotation": rotation}
    topics = {
        "wrench": {
            "file": "wrench",
            "frame": "ft_sensor",
            "force": [f"f{axis}" for axis in XYZ],
            "torque": [f"m{axis}" for axis in XYZ],
        },
        "joint_states": {
            "file": "joints",
            "joints": list("abc"),
            "position": list_of("q", "abc"),
            "velocity": list_of("v", "abc"),
        },
        "imu": {"file": "imu", "frame": "imu", "linear_acceleration": [f"a{axis}" for axis in XYZ]},
        "odom": {"file": "odom", "parent": "odom", "child": "base", **pose},
        "tf": [{"file": "tf", "parent": "base", "child": "ft_sensor", **pose}],
        "tf_static": {"file": "tf_static", "parent": "ft_sensor", "child": "imu", **pose},
    }
    return tables, {"time": {"column": "t", "unit": "ns"}, "robot_description": "robot.urdf", "topics": topics}


def list_of(letter, names):
    return [letter + name for name in names]


def named(letter, values, names=XYZ):
    """Columns by name; joints are written in the order given, their values are in the order a, b, c."""
    order = sorted(names)
    return {letter + name: values[:, order.index(name)] for name in names}


def pose_columns(poses):
    turned = poses.rotation_parent_child.reshape(len(poses), 9)
    cells = [f"r{row}{column}" for row in "123" for column in "123"]
    return named("p", poses.translation_parent_child) | {name: turned[:, at] for at, name in enumerate(cells)}


def with_ending(content, ending):
    """The mapping with this ending at every file."""
    topics = {}
    for name, entry in content["topics"].items():
        entries = entry if isinstance(entry, list) else [entry]
        topics[name] = [{**one, "file": one["file"] + ending} for one in entries]
    return {**content, "topics": topics}


@pytest.mark.parametrize("ending", [".csv", ".tsv", ".npz", ".mat"])
def test_tables_give_the_streams_of_the_bag(streams, bag, tmp_path, ending):
    tables, content = columns_of(streams)
    for name, columns in tables.items():
        path = tmp_path / (name + ending)
        if ending == ".npz":
            np.savez(path, **columns)
        elif ending == ".mat":
            scipy.io.savemat(path, columns, do_compression=True)
        else:
            write_csv(path, columns, "\t" if ending == ".tsv" else ",")
    (tmp_path / "robot.urdf").write_text("<robot name='sample'/>")
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump({**with_ending(content, ending), "gravity": 9.82085}))
    recording, whole = open_recording(tmp_path, strict=True), open_recording(bag)
    assert recording.counts == whole.counts
    assert recording.unchecked == sum(recording.counts.values())
    assert recording.metadata == whole.metadata
    assert recording.robot_description() == whole.robot_description()
    pairs = [
        (recording.wrench(), whole.wrench()),
        (recording.joint_states(), whole.joint_states()),
        (recording.imu(), whole.imu()),
        (recording.odometry(), whole.odometry()),
        (recording.poses("ft_sensor", "base"), whole.poses("ft_sensor", "base")),
        (recording.poses("imu"), whole.poses("imu")),
    ]
    for mine, other in pairs:
        for name, values in mine.arrays().items():
            np.testing.assert_allclose(values, other.arrays()[name], rtol=0, atol=1e-15, err_msg=name)
            assert name != "stamps" or (values == other.arrays()[name]).all()


def test_a_topic_can_hold_more_rows_than_a_block(tmp_path):
    rows = 10_000
    write_csv(tmp_path / "run.csv", {"t": np.arange(rows) * 0.001, "q": np.arange(rows) * 0.5})
    write_mapping(tmp_path)
    joints = open_recording(tmp_path / "run.csv").joint_states()
    np.testing.assert_array_equal(joints.position[:, 0], np.arange(rows) * 0.5)
    np.testing.assert_array_equal(joints.stamps, np.arange(rows) * 1_000_000)


@pytest.mark.parametrize(
    ("quantity", "mapped", "raw", "expected"),
    [
        ("position", {"unit": "deg"}, 180.0, np.pi),
        ("position", {"unit": "mdeg"}, 180e3, np.pi),
        ("position", {"unit": "turn"}, 0.5, np.pi),
        ("position", {"unit": "mm"}, 1500.0, 1.5),
        ("position", {"unit": "ticks", "ticks_per_turn": 4096}, 2048, np.pi),
        ("position", {"gain": -1, "offset": 0.25}, 1.0, -0.75),
        ("velocity", {"unit": "rpm"}, 60.0, 2 * np.pi),
        ("velocity", {"unit": "ticks/s", "ticks_per_turn": 1000}, 250.0, np.pi / 2),
        ("effort", {"unit": "mA", "gain": 0.5}, 2000.0, 1.0),
        ("effort", {"unit": "kgf cm"}, 10.0, 0.980665),
        ("effort", {"unit": "N"}, 3.0, 3.0),
    ],
)
def test_values_are_converted_to_si(tmp_path, quantity, mapped, raw, expected):
    write_csv(tmp_path / "run.csv", {"t": np.arange(3.0), "q": np.zeros(3), "x": np.full(3, raw)})
    write_mapping(tmp_path, **{quantity: {"column": "x", **mapped}})
    joints = open_recording(tmp_path / "columns.yaml").joint_states()
    np.testing.assert_allclose(getattr(joints, quantity), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("time", "cells", "stamps"),
    [
        (
            {"column": "t", "unit": "s"},
            ["1700000000.123456789", "1700000001"],
            [1_700_000_000_123_456_789, 17 * 10**17 + 10**9],
        ),
        ({"column": "t", "unit": "us"}, ["4.5", "20"], [4500, 20_000]),
        ({"column": "t", "unit": "ms", "start": 2}, ["0", "1"], [2 * 10**9, 2 * 10**9 + 10**6]),
        ({"rate": 400}, ["x", "y"], [0, 2_500_000]),
    ],
)
def test_times_are_exact(tmp_path, time, cells, stamps):
    (tmp_path / "run.csv").write_text("t;q\n" + "".join(f"{cell};1.5\n" for cell in cells))
    write_mapping(tmp_path, time=time)
    assert open_recording(tmp_path).joint_states().stamps.tolist() == stamps


def test_a_table_without_a_header_is_read_by_column_numbers(tmp_path):
    (tmp_path / "run.csv").write_text("0.0,7\n0.1,8\n\n0.2,-\n")
    write_mapping(tmp_path, time={"column": 1}, shared={"header": False, "missing": ["-"]}, position={"column": 2})
    joints = open_recording(tmp_path).joint_states()
    np.testing.assert_array_equal(joints.position[:, 0], [7, 8, np.nan])
    assert joints.not_finite == 1


def test_a_table_can_have_a_mapping_of_its_own(tmp_path):
    write_csv(tmp_path / "run.csv", {"t": np.arange(3.0), "q": np.ones(3)})
    write_mapping(tmp_path, position={"column": "other"})
    write_mapping(tmp_path, name="run.columns.yaml")
    assert len(open_recording(tmp_path / "run.csv").joint_states()) == 3


def test_late_rows_are_put_in_their_place_and_a_clock_set_back_is_refused(tmp_path):
    times = np.arange(100) * 0.01
    times[[50, 51]] = times[[51, 50]]
    write_csv(tmp_path / "run.csv", {"t": times, "q": times})
    write_mapping(tmp_path)
    recording = open_recording(tmp_path)
    joints = recording.joint_states()
    np.testing.assert_array_equal(joints.position[:, 0], np.sort(times))
    assert recording.reordered == {"joint_states": 1}
    times[60:] -= 0.5
    write_csv(tmp_path / "run.csv", {"t": times, "q": times})
    refused(lambda: open_recording(tmp_path).joint_states(), ErrorCode.TIME_BACKWARDS, "joint_states", "message 60")


def test_a_last_line_that_is_cut_is_skipped_and_listed(tmp_path):
    (tmp_path / "run.csv").write_text("t,q,v\n0,1,2\n1,2,3\n2,3")
    write_mapping(tmp_path)
    recording = open_recording(tmp_path)
    (loss,) = recording.losses
    assert loss.kind == LossKind.TRUNCATED
    assert "line (4) is cut" in loss.sentence
    assert len(recording.joint_states()) == 2


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("t,q\n0,1\n1,2,3\n2,3\n", ErrorCode.FILE_CORRUPT, ("line 3 has 3 cells for 2 columns",)),
        ("t,q\n0,1\n1\n2,3\n", ErrorCode.FILE_CORRUPT, ("line 3 has 1 cells",)),
        ("t,q\n0,1\n1,fast\n", ErrorCode.FILE_CORRUPT, ("line 3, column q", "'fast' is not a number")),
        ("t,q\n0,1\nnan,2\n", ErrorCode.FILE_CORRUPT, ("line 3", "is not a time")),
        ("t,q\n0,1\n1e99,2\n", ErrorCode.FILE_CORRUPT, ("line 3", "correct time.unit")),
        ("t,q\n0,1\n1e999999999,2\n", ErrorCode.FILE_CORRUPT, ("line 3",)),
        ("t,p\n0,1\n", ErrorCode.BAD_INPUT, ("no column 'q'", "it has t, p")),
        ("", ErrorCode.EMPTY, ("is empty",)),
        ("t,q\n", ErrorCode.EMPTY, ("has no rows",)),
        ('t,q\n0,"[1, 2]"\n', ErrorCode.BAD_INPUT, ("joint_states.position has 2 values",)),
        ('t,q\n0,"[1]"\n1,"[1, 2]"\n', ErrorCode.FILE_CORRUPT, ("column q",)),
        ("t,q\n0,1\0\n", ErrorCode.FILE_CORRUPT, ("run.csv",)),
        (b"t,q\n0,\xff\xfe\n", ErrorCode.FILE_CORRUPT, ("not a text table",)),
        (b"\xff\xfet,q", ErrorCode.FILE_CORRUPT, ("not a text table",)),
        ("# nothing\n", ErrorCode.EMPTY, ("has no rows",)),
        ("0,1\n1,2\n", ErrorCode.BAD_INPUT, ("no column 'q'", "header: false")),
        ("t,q,q\n0,1,2\n", ErrorCode.BAD_INPUT, ("has 2 columns 'q'", "rename")),
        ("t,q\ns,deg\n0,1\n", ErrorCode.BAD_INPUT, ("joint_states.position", "states the unit deg, the mapping rad")),
        ("t,q\nms,rad\n0,1\n", ErrorCode.BAD_INPUT, ("joint_states.time", "states the unit ms, the mapping s")),
        ("t,q\n0,1\n1,'0,5\n", ErrorCode.FILE_CORRUPT, ("line 3",)),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, text, code, words):
    content = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "run.csv").write_bytes(content)
    write_mapping(tmp_path)
    refused(lambda: open_recording(tmp_path), code, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": {"column": "q", "unit": "furlong"}}, ("joint_states.position.unit", "rad, mrad, deg")),
        ({"position": {"column": "q", "units": "rad"}}, ("position.units is not a key here",)),
        ({"position": {"column": "q", "columns": ["q"]}}, ("must have `columns`, or a `column`",)),
        ({"position": {"columns": ["q", "t"]}}, ("must be 1 columns",)),
        ({"position": {"column": "q", "offset": "x"}}, ("offset must be a number",)),
        ({"position": {"column": "q", "gain": [1, 2]}}, ("gain must be one finite number",)),
        ({"position": {"column": "q", "unit": "ticks"}}, ("ticks_per_turn is missing",)),
        ({"effort": {"column": "q", "unit": "A"}}, ("effort.gain is missing",)),
        ({"position": {"column": "q", "side": "motor"}}, ("side must be motor (with a transmission) or joint",)),
        ({"transmission": [[1, 2], [3, 4]]}, ("transmission must be 1 ratios",)),
        ({"transmission": [0]}, ("transmission is singular",)),
        ({"joints": []}, ("joints must be a name or a list",)),
        ({"joints": ["a", "a"]}, ("joints must be different names",)),
        ({"joints": "names.txt"}, ("'names.txt' is not a readable list",)),
        ({"rename": {"z": "y"}}, ("rename must map some of a",)),
        ({"file": "/etc/passwd"}, ("outside of the mapping's folder",)),
        ({"file": "../run.csv"}, ("outside of the mapping's folder",)),
        ({"time": {"column": "t", "unit": "h"}}, ("time.unit must be one of s, ms, us, ns",)),
        ({"time": {"column": "t", "rate": 5}}, ("column of the times, or the rate",)),
        ({"time": {"rate": -5}}, ("rate must be more than zero",)),
        ({"force": ["q", "q", "q"]}, ("columns of one kind of message",)),
        ({"frame": "tool"}, ("frame is not a key here",)),
    ],
)
def test_a_wrong_mapping_is_refused(tmp_path, change, words):
    write_csv(tmp_path / "run.csv", {"t": np.arange(3.0), "q": np.ones(3)})
    write_mapping(tmp_path, **change)
    refused(lambda: open_recording(tmp_path), ErrorCode.BAD_INPUT, tmp_path / "columns.yaml", *words)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("]", "is not YAML"),
        ("3", "must be a mapping"),
        ("{topics: {}}", "topics must map"),
        ("{topics: {a: {}}}", "topics.a"),
    ],
)
def test_a_mapping_without_topics_is_refused(tmp_path, text, word):
    (tmp_path / "columns.yaml").write_text(text)
    refused(lambda: open_recording(tmp_path), ErrorCode.BAD_INPUT, word)


def test_what_lies_beside_a_table_is_asked_for(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,q\n0,1\n")
    refused(lambda: open_recording(path), ErrorCode.FILE_UNREADABLE, path, "write columns.yaml", "docs/recording.md")
    mapping = write_mapping(tmp_path, shared={"robot_description": "none.urdf"})
    refused(lambda: open_recording(mapping), ErrorCode.ROBOT_DESCRIPTION_MISSING, "none.urdf")
    path.unlink()
    refused(lambda: open_recording(mapping), ErrorCode.FILE_UNREADABLE, path)


def test_tables_of_different_lengths_are_refused(tmp_path):
    write_csv(tmp_path / "run.csv", {"t": np.arange(3.0), "q": np.ones(3)})
    write_csv(tmp_path / "more.csv", {"e": np.ones(4)})
    mapping = write_mapping(tmp_path, effort={"file": "more.csv", "column": "e"})
    refused(lambda: open_recording(mapping), ErrorCode.SHAPE_MISMATCH, "position 3, effort 4")


def test_a_cut_table_is_shortened_with_the_other_table_of_its_topic(tmp_path):
    write_csv(tmp_path / "run.csv", {"t": np.arange(4.0), "q": np.arange(4.0)})
    (tmp_path / "more.csv").write_text("e,f\n0,0\n1,1\n2")
    recording = open_recording(write_mapping(tmp_path, effort={"file": "more.csv", "column": "e"}))
    assert recording.joint_states().effort[:, 0].tolist() == [0, 1]
    assert len(recording.losses) == 1


def test_a_matrix_that_is_no_rotation_is_refused(tmp_path):
    tables = {"t": np.arange(2.0), **{f"r{number}": np.ones(2) for number in range(9)}}
    write_csv(tmp_path / "run.csv", tables)
    pose = {"file": "run.csv", "parent": "a", "child": "b", "rotation": [f"r{number}" for number in range(9)]}
    content = {"time": {"column": "t"}, "topics": {"tf": pose}}
    (tmp_path / "columns.yaml").write_text(yaml.safe_dump(content))
    refused(lambda: open_recording(tmp_path), ErrorCode.BAD_INPUT, "row 1 of the table is not a rotation")


# -- arrays ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_arrays_that_cannot_be_read_are_refused(tmp_path, ending):
    path = tmp_path / f"run{ending}"
    save = np.savez if ending == ".npz" else scipy.io.savemat

    def write(**arrays):
        save(*((path,) if ending == ".npz" else (path, arrays)), **(arrays if ending == ".npz" else {}))

    mapping = write_mapping(tmp_path, file=path.name)
    write(t=np.arange(3.0), q=np.ones(4))
    refused(lambda: open_recording(mapping), ErrorCode.SHAPE_MISMATCH, path, "q 4, t 3")
    write(t=np.arange(3.0), p=np.ones(3))
    refused(lambda: open_recording(mapping), ErrorCode.BAD_INPUT, path, "no column 'q'", "t, p")
    write(t=np.array([0, np.nan, 1]), q=np.ones(3))
    refused(lambda: open_recording(mapping), ErrorCode.FILE_CORRUPT, path, "not finite")
    path.write_bytes(b"nothing of the kind")
    refused(lambda: open_recording(mapping), ErrorCode.FILE_CORRUPT, path, "is damaged")


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_small_arrays_that_unpack_to_much_are_refused(tmp_path, ending):
    zeros = np.zeros(5_000_000)
    path = tmp_path / f"run{ending}"
    if ending == ".npz":
        np.savez_compressed(path, t=zeros, q=zeros)
    else:
        scipy.io.savemat(path, {"t": zeros, "q": zeros}, do_compression=True)
    assert path.stat().st_size < 200_000
    mapping = write_mapping(tmp_path, file=path.name)
    refused(lambda: open_recording(mapping), ErrorCode.UNSUPPORTED, path, "unpacks from")


def test_pickled_and_hdf5_arrays_are_refused(tmp_path):
    np.savez(tmp_path / "run.npz", t=np.arange(3.0), q=np.array([{}, {}, {}]))
    mapping = write_mapping(tmp_path, file="run.npz")
    refused(lambda: open_recording(mapping), ErrorCode.FILE_CORRUPT, "q holds object, not numbers")
    (tmp_path / "run.mat").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    mapping = write_mapping(tmp_path, file="run.mat")
    refused(lambda: open_recording(mapping), ErrorCode.UNSUPPORTED, "save -v7")
    scipy.io.savemat(tmp_path / "run.mat", {"t": np.arange(3.0), "q": "text"})
    refused(lambda: open_recording(mapping), ErrorCode.UNSUPPORTED, "q is of class char")


def test_an_array_that_claims_more_than_it_holds_is_refused(tmp_path):
    np.savez(tmp_path / "whole.npz", t=np.arange(3.0), q=np.ones(3))
    with zipfile.ZipFile(tmp_path / "whole.npz") as whole, zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        for name in whole.namelist():
            archive.writestr(name, whole.read(name).replace(b"(3,)", b"(9**9,)"[:4] if name == "t.npy" else b"(9,)"))
    refused(lambda: open_recording(write_mapping(tmp_path, file="run.npz")), ErrorCode.FILE_CORRUPT, "is damaged")
