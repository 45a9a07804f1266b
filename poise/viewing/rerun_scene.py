"""The Rerun recording of an identification: the same story as the report, to scrub through in time and in 3-D."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.inertia.model import PARAMETER_NAMES
from poise.inertia.pipeline import Identification
from poise.types import Array
from poise.viewing.rerun_file import RerunFile
from poise.viewing.summary import (
    SCALES,
    UNITS,
    covariance_ellipsoid,
    equivalent_ellipsoid,
    residual,
    shown_parameters,
    shown_sigmas,
)
from poise.viewing.wording import readable, rounded

_CHANNELS = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
_PATHS = ("mass", "com_x", "com_y", "com_z", *(f"inertia_{axes}" for axes in ("xx", "xy", "xz", "yy", "yz", "zz")))

# Colours (RGB): measured grey, the estimate blue; the same as in the report.
_MEASURED = (163, 171, 182)
_ESTIMATE = (64, 128, 240)
_BOUND = (150, 180, 235)
_RESIDUAL = (230, 130, 60)
_GRAVITY = (240, 200, 60)

# Lengths drawn in the 3-D view.
_METRES_PER_NEWTON = 0.01
_GRAVITY_LENGTH = 0.12
_AXIS_LENGTH = 0.1


def write_identification_recording(path: Path, identification: Identification) -> Path:
    """Write a Rerun recording (.rrd) with its own layout; open it with `rerun FILE`.

    Entities: `wrench/CHANNEL/{measured,predicted}` and `residual/CHANNEL` (N, N m, sensor frame);
    `estimate/PARAMETER/{value,low,high}` with two standard deviations on both sides (kg, mm, 1e-3 kg m2);
    `world/sensor` turning as the sensor did, about a fixed origin, with gravity, the load's force (bias taken off,
    1 N is 1 cm), the centre of mass with its two-sigma ellipsoid, and the homogeneous ellipsoid with the payload's
    inertia; `log` with the rejected intervals. Timelines: `time` since the first wrench sample, `stamp` as recorded.

    Args:
        path: the file, usually ending in .rrd.
        identification: what to show.

    Returns:
        The path.

    Raises:
        InputError: UNSUPPORTED when rerun-sdk is not installed, FILE_UNWRITABLE.
    """
    scene = _Scene(identification)
    scene.send_wrench()
    scene.send_estimates()
    scene.send_motion()
    scene.send_log()
    return scene.write(path, _blueprint())


class _Scene(RerunFile):
    """One recording being filled."""

    def __init__(self, identification: Identification) -> None:
        stamps = identification.stamps
        origin = int(stamps[0]) if len(stamps) else int(identification.estimate.stamp)
        super().__init__("poise_identification", origin)
        self.identification = identification

    def send_wrench(self) -> None:
        """Measured, predicted and left-over wrench, channel by channel."""
        identification, left_over = self.identification, residual(self.identification)
        for channel, name in enumerate(_CHANNELS):
            curves = (
                (f"wrench/{name}/measured", identification.wrench_measured, _MEASURED, "measured"),
                (f"wrench/{name}/predicted", identification.wrench_predicted, _ESTIMATE, "predicted"),
                (f"residual/{name}", left_over, _RESIDUAL, name.replace("_", " ")),
            )
            for path, values, colour, label in curves:
                self.curve(path, identification.stamps, values[:, channel], colour, label)

    def send_estimates(self) -> None:
        """Every identified parameter with its two-sigma bounds, estimate by estimate."""
        history = self.identification.history or (self.identification.estimate,)
        stamps = np.array([int(estimate.stamp) for estimate in history], dtype=np.int64)
        values = np.array([shown_parameters(estimate) for estimate in history]) * SCALES
        sigmas = np.array([shown_sigmas(estimate) for estimate in history]) * SCALES
        for index, name in enumerate(_PATHS):
            value, sigma = values[:, index], sigmas[:, index]
            for part, series, colour in (
                ("value", value, _ESTIMATE),
                ("low", value - 2 * sigma, _BOUND),
                ("high", value + 2 * sigma, _BOUND),
            ):
                known = np.isfinite(series)
                if np.any(known):
                    label = f"{name.replace('_', ' ')} {'' if part == 'value' else part}".strip()
                    self.curve(f"estimate/{name}/{part}", stamps[known], series[known], colour, label)
        self._send_bodies(stamps)

    def send_motion(self) -> None:
        """The sensor's turning, gravity, and the force of the load on it (bias taken off)."""
        rr, motion = self.rr, self.identification.motion
        self.static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self.static(
            "world/gravity",
            rr.Arrows3D(vectors=[[0, 0, -_GRAVITY_LENGTH]], colors=[_GRAVITY], labels=["gravity"], radii=[0.0015]),
        )
        self.static("world/sensor", rr.TransformAxes3D(_AXIS_LENGTH))
        if len(motion):
            columns = rr.Transform3D.columns(quaternion=_quaternions(motion.rotation_world_sensor))
            self.columns("world/sensor", motion.stamps, columns)
        bias = np.nan_to_num(self.identification.estimate.bias[:3])
        forces = (self.identification.wrench_measured[:, :3] - bias) * _METRES_PER_NEWTON
        self.static("world/sensor/force", rr.Arrows3D.from_fields(colors=[_RESIDUAL], radii=[0.002]))
        if len(forces):
            self.columns("world/sensor/force", self.identification.stamps, rr.Arrows3D.columns(vectors=forces))

    def send_log(self) -> None:
        """Rejected intervals at their start; the answer as plain text."""
        rr = self.rr
        rejected = self.identification.estimate.rejected
        if rejected:
            texts = [
                f"{interval.n_samples} samples not used until {(int(interval.end) - self.origin) * 1e-9:.3f} s: "
                f"{readable(interval.reason)}"
                for interval in rejected
            ]
            stamps = np.array([int(interval.start) for interval in rejected], dtype=np.int64)
            self.columns("log", stamps, rr.TextLog.columns(text=texts, level=["WARN"] * len(texts)))
        self.static("summary", rr.TextDocument(_summary(self.identification), media_type="text/plain"))

    def _send_bodies(self, stamps: NDArray[np.int64]) -> None:
        """The centre of mass with its two-sigma ellipsoid, and the body with the payload's inertia."""
        rr = self.rr
        history = self.identification.history or (self.identification.estimate,)
        known = [index for index, estimate in enumerate(history) if np.all(np.isfinite(shown_parameters(estimate)[:4]))]
        centres = [history[index].parameters.com for index in known]
        if known:
            self.static("world/sensor/com", rr.Points3D.from_fields(colors=[_ESTIMATE], radii=[0.003]))
            self.columns("world/sensor/com", stamps[known], rr.Points3D.columns(positions=centres))
        for path, shape, factor, colour in (
            ("world/sensor/com_uncertainty", covariance_ellipsoid, 2.0, _BOUND),
            ("world/sensor/payload", equivalent_ellipsoid, 1.0, _MEASURED),
        ):
            bodies = [(index, *shape(history[index])) for index in known]
            bodies = [body for body in bodies if np.all(np.isfinite(body[1]))]
            if not bodies:
                continue
            indices = [index for index, _, _ in bodies]
            columns = rr.Ellipsoids3D.columns(
                centers=[history[index].parameters.com for index in indices],
                half_sizes=[factor * half_axes for _, half_axes, _ in bodies],
                quaternions=_quaternions(np.array([rotation for _, _, rotation in bodies])),
            )
            self.static(path, rr.Ellipsoids3D.from_fields(colors=[colour]))
            self.columns(path, stamps[indices], columns)


def _summary(identification: Identification) -> str:
    """The answer in a few plain lines."""
    estimate = identification.estimate
    values = shown_parameters(estimate) * SCALES
    sigmas = shown_sigmas(estimate) * SCALES
    lines = [f"In {readable(estimate.frame_id)}, method {readable(estimate.method)}, {estimate.n_samples} samples:", ""]
    for name, path, unit, value, sigma in zip(PARAMETER_NAMES, _PATHS, UNITS, values, sigmas, strict=True):
        shown, spread = rounded(float(value), float(sigma))
        known = f"{shown} ± {spread or '–'} {unit}" if np.isfinite(value) else shown
        lines.append(f"{path.replace('_', ' ')} ({name}): {known}")
    return "\n".join([*lines, "", "± is one standard deviation; the inertia is about the centre of mass."])


def _quaternions(rotation: Array) -> Array:
    """(N, 4) x y z w of rotation matrices (N, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_quat())


def _blueprint() -> Any:
    """The sensor in 3-D and the answer on the left, curves by subject on the right, the log below."""
    import rerun.blueprint as rrb

    def curves(title: str, paths: Sequence[str]) -> Any:
        views = [rrb.TimeSeriesView(origin=f"/{path}", name=path.split("/")[1].replace("_", " ")) for path in paths]
        return rrb.Vertical(*views, name=title)

    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Vertical(
                    rrb.Spatial3DView(origin="/world", name="Sensor"),
                    rrb.TextDocumentView(origin="/summary", name="Answer"),
                    row_shares=[2, 1],
                ),
                rrb.Tabs(
                    curves("Force", [f"wrench/{name}" for name in _CHANNELS[:3]]),
                    curves("Torque", [f"wrench/{name}" for name in _CHANNELS[3:]]),
                    curves("Residual", [f"residual/{name}" for name in _CHANNELS]),
                    curves("Mass and centre", [f"estimate/{name}" for name in _PATHS[:4]]),
                    curves("Inertia", [f"estimate/{name}" for name in _PATHS[4:]]),
                ),
                column_shares=[2, 3],
            ),
            rrb.TextLogView(origin="/log", name="Samples not used"),
            row_shares=[5, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline="time"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
