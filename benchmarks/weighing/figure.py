"""The picture of docs/wrench_errors.md: `python -m benchmarks.weighing.figure`, from the recordings in bags/.

Three errors are put into the wrench of a real recording. The picture shows what the best payload leaves unexplained,
and what is left with the cause that was found.
"""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from poise.files import write_whole
from poise.inertia import OnlineEstimator, identify_wrenches
from poise.inertia.model import signal_columns
from poise.recording import open_recording
from poise.robot import find_kinematics
from poise.types import Array
from poise.weighing import causes_of

ROOT = Path(__file__).resolve().parents[2]
Change = Callable[[Array, Array], Array]
TURN = 20.0
"""Degrees."""
LATE = 0.15
"""s."""


def turned(wrench: Array, seconds: Array) -> Array:
    """In axes turned about y."""
    del seconds
    matrix = Rotation.from_euler("y", TURN, degrees=True).as_matrix()
    return np.hstack([wrench[:, :3] @ matrix.T, wrench[:, 3:] @ matrix.T])


def drifting(wrench: Array, seconds: Array) -> Array:
    """By 3 N during the recording."""
    return np.asarray(wrench + np.outer(3.0 * seconds / seconds[-1], [1, 0, 0, 0, 0, 0]))


def late(wrench: Array, seconds: Array) -> Array:
    """By 150 ms."""
    return np.column_stack([np.interp(seconds - LATE, seconds, column) for column in wrench.T])


ERRORS = (
    ("kuka_static_poses", turned, f"sensor turned by {TURN:.0f} degrees"),
    ("kuka_static_poses", drifting, "drift of 3 N"),
    ("kuka_free_motion", late, f"{1e3 * LATE:.0f} ms late"),
)


def residuals(bag: str, change: Change) -> tuple[Array, Array, Array, str, str]:
    """Seconds; size of the force that stays unexplained before and after, N; the finding's name; the mass in words."""
    recording = open_recording(ROOT / "bags" / f"{bag}.mcap")
    wrench = recording.wrench("wrench")
    seconds = (wrench.stamps - wrench.stamps[0]) * 1e-9
    changed = replace(wrench, wrench_in_sensor=change(wrench.wrench_in_sensor, seconds))
    kinematics = find_kinematics(recording, wrench.frame_id)
    answer = identify_wrenches(changed, kinematics, OnlineEstimator(kinematics.source, frame_id=wrench.frame_id))
    estimate, samples = answer.estimate, answer.estimate.samples
    causes = causes_of(estimate)
    if samples is None:
        raise ValueError(f"{bag}: the estimate has no samples")
    unknowns = np.concatenate([estimate.phi, estimate.bias])
    left = wrench_left(samples.signals, samples.wrench, unknowns)
    mass = f"{estimate.parameters.mass:.3f} ± {estimate.mass_std:.3f} kg"
    if not causes:
        names = [finding.code.name for finding in estimate.findings]
        return samples.seconds, left, np.full(len(left), np.nan), ", ".join(names), mass
    residual = causes[0].explanation.residual
    when = np.linspace(0.0, samples.seconds[-1], len(residual))
    after = np.interp(samples.seconds, when, np.linalg.norm(residual[:, :3], axis=1))
    return samples.seconds, left, after, causes[0].code.name, mass


def wrench_left(signals: Array, wrench: Array, unknowns: Array) -> Array:
    """(B,) N, the force that a payload and a bias do not explain."""
    predicted = signal_columns(signals)[:, :3] @ np.nan_to_num(unknowns)
    return np.asarray(np.linalg.norm(wrench[:, :3] - predicted, axis=1))


def main() -> None:
    figure = Figure(figsize=(10.5, 3.2), dpi=144, layout="constrained")
    for axes, (bag, change, title) in zip(figure.subplots(1, 3), ERRORS, strict=True):
        seconds, before, after, name, mass = residuals(bag, change)
        axes.plot(seconds, before, ".-", color="#d55e01", markersize=3, label="a payload alone")
        if np.isfinite(after).any():
            axes.plot(seconds, after, ".-", color="#2062d4", markersize=3, label="with the cause")
        axes.set_title(f"{title}\n{name}; payload alone: {mass}", fontsize=9)
        axes.set_xlabel("time [s]")
        axes.set_ylim(bottom=0)
        axes.legend(fontsize=8)
    figure.axes[0].set_ylabel("unexplained force [N]")
    target = ROOT / "docs" / "pictures" / "wrench_errors.png"
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    write_whole(target, buffer.getvalue())
    print(f"written: {target}")


if __name__ == "__main__":
    main()
