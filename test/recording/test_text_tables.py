"""Text tables as programs write them."""

import numpy as np
import pytest
import yaml
from mapped_tables import write_mapping
from test_bag_bad_input import refused

from poise.errors import ErrorCode
from poise.recording import open_recording


@pytest.mark.parametrize(
    "text",
    [
        "t;q\n0,5;1,25\n1,5;-2e-1\n",
        "t\tq\n0.5\t1.25\n1.5\t-0.2\n",
        "t,\tq\n0.5,\t1.25\n1.5,\t-0.2\n",
        ",t,q\n0,0.5,1.25\n1,1.5,-0.2\n",
        "# a,b\nt,q\n0.5,1.25\n1.5,-0.2\n",
        " t   q\n0.5  1.25\n 1.5 -0.2\n",
        "# of a logger, v1\n# t,q\n0.5,1.25\n1.5,-0.2\n",
        "%t,q\n0.5,1.25\n% a remark\n1.5,-0.2\n",
        "t,q,\n0.5,1.25,\n1.5,-0.2\n",
        "t,q\ns,[rad]\n0.5,1.25\n1.5,-0.2\n",
        "t,q\nsec,Radian\n0.5,1.25\n1.5,-0.2\n",
        "t,q\n1970-01-01T00:00:00.5,1.25\n1970-01-01 01:00:01.5+01:00,-0.2\n",
        "t,q\r\n0.5,1.25\r\n1.5,-0.2\r\n".encode("utf-16"),
    ],
)
def test_a_table_is_read_as_programs_write_it(tmp_path, text):
    (tmp_path / "run.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    write_mapping(tmp_path)
    joints = open_recording(tmp_path, strict=True).joint_states()
    assert joints.stamps.tolist() == [500_000_000, 1_500_000_000]
    np.testing.assert_array_equal(joints.position[:, 0], [1.25, -0.2])


def test_rows_of_a_shared_table_are_those_of_its_topics(tmp_path):
    (tmp_path / "run.csv").write_text("t,q,c\n0,1,\n0.5,,5\n1,2,\n1.5,,6\n2,3,\n")
    commands = {"file": "run.csv", "joints": ["a"], "position": {"column": "c"}}
    mapping = write_mapping(tmp_path)
    content = yaml.safe_load(mapping.read_text())
    content["topics"]["joint_commands"] = commands
    mapping.write_text(yaml.safe_dump(content))
    recording = open_recording(mapping)
    assert recording.joint_states().position[:, 0].tolist() == [1, 2, 3]
    assert recording.counts == {"joint_states": 3, "joint_commands": 2}
    content["topics"]["joint_commands"]["position"] = {"column": "e"}
    (tmp_path / "run.csv").write_text("t,q,e\n0,1,\n0.5,2,\n")
    mapping.write_text(yaml.safe_dump(content))
    refused(lambda: open_recording(mapping), ErrorCode.EMPTY, "topics.joint_commands has no values")


def test_a_single_column_may_have_a_name_of_two_words(tmp_path):
    (tmp_path / "run.csv").write_text("joint angle\n1\n2\n")
    write_mapping(tmp_path, time={"rate": 100}, position={"column": "joint angle"})
    assert open_recording(tmp_path).joint_states().position[:, 0].tolist() == [1, 2]


def test_decimal_commas_are_read_without_a_header(tmp_path):
    (tmp_path / "run.csv").write_text("0,5;1,25\n1,5;-2,5e-1\n")
    write_mapping(tmp_path, time={"column": 1}, shared={"header": False}, position={"column": 2})
    assert open_recording(tmp_path).joint_states().position[:, 0].tolist() == [1.25, -0.25]
