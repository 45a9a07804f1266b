"""Trajectories from files: waypoints, stop-and-go poses and Fourier series in YAML, samples in CSV."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel
from poise.simulation.trajectories import FourierTrajectory, SplineTrajectory, Trajectory, WaypointTrajectory, home
from poise.types import Array

_MAX_BYTES = 50_000_000
_FOURIER = ("duration", "speed", "amplitude", "frequency", "harmonics", "centre")


def read_trajectory(path: str | Path, model: RobotModel) -> Trajectory:
    """Read a trajectory for a robot.

    A CSV file has a header `time, JOINT, ...` and rows of s and rad (or m); the motion is the quintic spline through
    them. A YAML file holds one of

        {joints: [..], waypoints: [{time: 0.0, position: [..], velocity: [..], acceleration: [..]}, ..]}
        {joints: [..], stop_and_go: {move: 1.5, dwell: 1.0, positions: [[..], ..]}}
        {fourier: {seed: 1, duration: 20, speed: 0.3, amplitude: 0.8, frequency: 0.1, harmonics: 5}}

    Without velocity the robot stops at every waypoint. Joints that are not named stay at `home`.

    Raises:
        InputError: FILE_UNREADABLE; BAD_INPUT with the place in the file; JOINT_MISSING when a joint is not the
            robot's.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.BAD_INPUT, f"{path}: larger than {_MAX_BYTES} bytes, not a trajectory")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: not UTF-8 text") from error
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"cannot read the trajectory {path}: {error.strerror}") from error
    try:
        return _from_csv(text, model) if path.suffix == ".csv" else _from_yaml(text, model)
    except InputError as error:
        raise InputError(error.code, f"{path}: {error.message}", **error.data) from error


def _from_csv(text: str, model: RobotModel) -> Trajectory:
    rows = [row for row in csv.reader(text.splitlines()) if row]
    if not rows or rows[0][0].strip() != "time" or len(rows) < 3:
        raise _bad("expected a header 'time, JOINT, ...' and two rows at the least")
    names = [name.strip() for name in rows[0][1:]]
    try:
        values = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except ValueError as error:
        raise _bad(f"every row needs {len(names) + 1} numbers ({error})") from error
    return SplineTrajectory(values[:, 0], _all_joints(values[:, 1:], names, model))


def _from_yaml(text: str, model: RobotModel) -> Trajectory:
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise _bad(f"not YAML ({' '.join(str(error).split())})") from error
    if not isinstance(content, Mapping):
        raise _bad("expected waypoints, stop_and_go or fourier")
    if "fourier" in content:
        return _fourier(_mapping(content["fourier"], "fourier"), model)
    names = content.get("joints", model.joint_names)
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise _bad("joints must be a list of names")
    if "stop_and_go" in content:
        plan = _mapping(content["stop_and_go"], "stop_and_go")
        positions = _all_joints(_numbers(plan.get("positions"), "positions"), names, model)
        return WaypointTrajectory.stop_and_go(positions, _number(plan, "move", 1.5), _number(plan, "dwell", 1.0))
    if "waypoints" in content:
        return _waypoints(content["waypoints"], names, model)
    raise _bad("expected waypoints, stop_and_go or fourier")


def _waypoints(points: Any, names: Sequence[str], model: RobotModel) -> Trajectory:
    if not isinstance(points, list) or not points:
        raise _bad("waypoints must be a list")
    points = [_mapping(point, f"waypoint {i}") for i, point in enumerate(points)]
    times = np.array([_number(point, "time") for point in points])

    def column(key: str) -> Array | None:
        if not any(key in point for point in points):
            return None
        rows = [point.get(key, [0.0] * len(names)) for point in points]
        return _all_joints(_numbers(rows, key), names, model, None if key == "position" else 0.0)

    position = column("position")
    if position is None:
        raise _bad("waypoints need a position each")
    return WaypointTrajectory(times, position, column("velocity"), column("acceleration"))


def _fourier(options: Mapping[str, Any], model: RobotModel) -> Trajectory:
    unknown = set(options) - {"seed", *_FOURIER}
    if unknown:
        raise _bad(f"fourier knows seed, {', '.join(_FOURIER)}; not {', '.join(sorted(map(str, unknown)))}")
    values: dict[str, Any] = {key: _number(options, key) for key in _FOURIER[:4] if key in options}
    if any(value <= 0 for value in values.values()):
        raise _bad("the numbers of fourier must be positive")
    if "harmonics" in options:
        values["harmonics"] = min(max(int(_number(options, "harmonics")), 1), 100)
    if "centre" in options:
        values["centre"] = _all_joints(_numbers([options["centre"]], "centre"), model.joint_names, model)[0]
    rng = np.random.default_rng(abs(int(_number(options, "seed", 0))))
    return FourierTrajectory.random(model, rng, **values)


def _all_joints(values: Array, names: Sequence[str], model: RobotModel, others: ArrayLike | None = None) -> Array:
    """(K, J) in the model's order, with `others` (home when None) for joints that are not named."""
    unknown = [name for name in names if name not in model.joint_names]
    if unknown:
        raise InputError(
            ErrorCode.JOINT_MISSING,
            f"the robot has no joint {', '.join(unknown)}; it has {', '.join(model.joint_names)}",
            missing=unknown,
        )
    if values.ndim != 2 or values.shape[1] != len(names):
        raise _bad(f"{len(names)} joints do not fit rows of {values.shape[1:] or 'one number'}")
    position = np.empty((len(values), len(model.joint_names)))
    position[:] = home(model) if others is None else others
    position[:, [model.joint_names.index(name) for name in names]] = values
    return position


def _numbers(value: Any, what: str) -> Array:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise _bad(f"{what} must be rows of numbers, equally long") from error


def _number(options: Mapping[str, Any], key: str, default: float | None = None) -> float:
    value = options.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise _bad(f"{key} must be a number, got {value!r}")
    return float(value)


def _mapping(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _bad(f"{what} must be a mapping")
    return value


def _bad(reason: str) -> InputError:
    return InputError(ErrorCode.BAD_INPUT, reason)
