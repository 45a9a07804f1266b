"""Each compiled kernel against the form in Python, and with bad input."""

import importlib.machinery
import importlib.util
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy._core import _multiarray_umath

from poise.errors import ErrorCode, InputError
from poise.kernels import COMPILED, Chain, CompiledSplines, chain_motion, find_records
from poise.kernels.library import _load
from poise.recording import blocks
from poise.robot import BaseMotion, RobotModel, frame_poses, kinematics, sensor_motion
from poise.robot.spline_search import SplineSearch

N = 20


def test_the_kernels_are_installed() -> None:
    assert COMPILED, "reinstall Poise with a C compiler: the nodes and the figures of the pages need the kernels"


@pytest.mark.parametrize(
    ("robot", "base"), [("fr3", "fixed"), ("xarm7", "fixed"), ("ridgeback_ur10", "fixed"), ("ur10e", "floating")]
)
def test_the_chain_moves_as_pinocchio_says(robot: str, base: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    model = RobotModel.from_file(robot, base=base)
    joints = rng.normal(size=(3, len(model.joint_names), N)).swapaxes(1, 2)  # not contiguous
    moved = BaseMotion.planar(*rng.normal(size=(3, N, 3))) if base == "floating" else None
    found = sensor_motion(model, np.arange(N), *joints, base=moved)
    poses = frame_poses(model, joints[0], base=moved)
    monkeypatch.setattr(kinematics, "COMPILED", False)
    wanted = sensor_motion(model, np.arange(N), *joints, base=moved)
    for name, one in vars(found).items():
        assert one is None or np.allclose(one, getattr(wanted, name), rtol=1e-12, atol=1e-13), name
    for one, other in zip(poses, frame_poses(model, joints[0], base=moved), strict=True):
        assert np.allclose(one, other, rtol=1e-12, atol=1e-13)


def test_a_frame_before_the_last_joints_follows_its_own_joints_only(monkeypatch: pytest.MonkeyPatch) -> None:
    model = RobotModel.from_file("fr3")
    joints = np.random.default_rng(2).normal(size=(N, 7))
    found = frame_poses(model, joints, "fr3_link4")
    monkeypatch.setattr(kinematics, "COMPILED", False)
    for one, other in zip(found, frame_poses(model, joints, "fr3_link4"), strict=True):
        assert np.allclose(one, other, rtol=1e-12, atol=1e-13)


def test_a_chain_refuses_arrays_of_other_shapes_and_takes_none_and_nan() -> None:
    chain = Chain(np.tile(np.append(np.eye(3), np.zeros(3)), (3, 1)), np.tile([0.0, 0, 1], (2, 1)), np.zeros(2, int))
    with pytest.raises(InputError) as error:
        chain_motion(chain, np.zeros((3, 5, 3)))
    assert error.value.code is ErrorCode.TYPE_MISMATCH
    with pytest.raises(InputError):
        chain_motion(chain, np.zeros((3, 5, 2)), np.zeros((4, 21)))
    with pytest.raises(InputError):
        chain_motion(replace(chain, slides=np.zeros(1, int)), np.zeros((3, 5, 2)))
    rotation, place, vectors = chain_motion(chain, np.zeros((3, 0, 2)))
    assert (rotation.shape, place.shape, vectors.shape) == ((0, 3, 3), (0, 3), (3, 0, 3))
    assert np.isnan(chain_motion(chain, np.full((3, 1, 2), np.nan))[0]).any()


@pytest.mark.parametrize(("count", "columns", "together"), [(12, 1, False), (150, 5, False), (150, 4, True)])
def test_splines_are_those_of_numpy(count: int, columns: int, together: bool) -> None:
    rng = np.random.default_rng(count)
    seconds = np.sort(np.arange(count) * 0.004 + rng.uniform(0, 0.001, count))
    pace = rng.uniform(3, 9, columns)
    values = np.sin(pace * seconds[:, None]) + 1e-5 * rng.normal(size=(count, columns)) + 7.0
    rates = pace * np.cos(pace * seconds[:, None]) + 1e-3 * rng.normal(size=(count, columns))
    rates[3, 0] = np.nan  # this column is not followed
    for given in (None, 4):
        compiled = CompiledSplines(seconds, np.asfortranarray(values), rates, given, together)
        plain = SplineSearch(seconds, values, None if together else rates, given, together)
        assert compiled.intervals.tolist() == plain.intervals.tolist()
        for k in range(columns):
            for one, other in zip(compiled.at(k, seconds), plain.at(k, seconds), strict=True):
                assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
            asked = k, slice(1, count - 1), int(plain.intervals[k]) + 2, slice(2, count - 2, 3)
            for one, other in zip(compiled.covariance(*asked), plain.covariance(*asked), strict=True):
                assert np.allclose(one, other, rtol=1e-6, atol=1e-30)


def test_splines_refuse_what_they_cannot_read() -> None:
    seconds = np.arange(20) * 0.01
    for times, values, rates in (
        (seconds[:1], np.zeros((1, 1)), None),
        (seconds[:0], np.zeros((0, 1)), None),
        (seconds, np.zeros((19, 1)), None),
        (seconds, np.zeros(20), None),
        (seconds, np.zeros((20, 2)), np.zeros((20, 1))),
    ):
        with pytest.raises(InputError):
            CompiledSplines(times, values, rates, None, False)
    splines = CompiledSplines(seconds, np.zeros((20, 2)), None, None, False)
    for column, part in ((2, slice(0, 5)), (-1, slice(0, 5)), (0, slice(0, 21)), (0, slice(-1, 4))):
        with pytest.raises(IndexError):
            splines.covariance(column, part, 3, slice(0, 20, 1))
    assert np.isnan(CompiledSplines(seconds, np.full((20, 1), np.nan), None, 2, False).at(0, seconds)).all()
    assert splines.at(0, []).shape == (3, 0)


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def test_records_are_found_as_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    messages = [record(5, struct.pack("<HIQQ", k % 3, k, 2**63 + k, 0) + bytes(k % 40)) for k in range(5000)]
    whole = (
        record(3, b"\x01\x00schema") + record(4, b"\x01\x00topic") + record(4, b"\x01\x00again") + b"".join(messages)
    )
    huge, short, zero = struct.pack("<BQ", 5, 2**64 - 1), record(5, b"short"), bytes(9)
    damaged = [
        b"",
        b"\x05",
        whole[:-1],
        whole[:57],
        *(whole + end + whole for end in (huge, short, zero)),
        record(4, b""),
    ]
    rng = np.random.default_rng(3)
    damaged += [bytes(rng.integers(0, 7, 400, dtype=np.uint8)) for _ in range(20)]
    for data in (whole, *damaged):
        monkeypatch.setattr(blocks, "COMPILED", True)
        found, definitions, end = blocks.split_records(data)
        monkeypatch.setattr(blocks, "COMPILED", False)
        wanted, contents, last = blocks.split_records(data)
        assert (definitions, end) == (contents, last)
        assert found.tolist() == wanted.tolist()
    assert len(find_records(whole)[0]) == 5000


def test_a_library_that_cannot_be_loaded_counts_as_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of another platform, of another version, or another library."""
    damaged = tmp_path / "poise_kernels.so"
    damaged.write_bytes(b"no library")
    for path in (str(damaged), _multiarray_umath.__file__):
        spec = importlib.machinery.ModuleSpec("poise_kernels", None, origin=path)
        spec.has_location = True
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, spec=spec: spec)
        assert _load() is None
    monkeypatch.undo()
    monkeypatch.setattr("poise.kernels.library._VERSION", -1)
    assert _load() is None
