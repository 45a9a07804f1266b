"""Diagnoses for docs/mismatch.md: a contact, a healthy robot, physics that the library lacks, a real arm shaken."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import FigureBase

from poise.inertia import InertialParameters
from poise.mismatch.answer import Diagnosis, diagnose
from poise.mismatch.reading import (
    ModelEffect,
    NominalModel,
    parse_model,
    read_recording,
    recorded_from_motion,
    with_model_effects,
)
from poise.mismatch.recorded import RecordedMotion
from poise.recording import open_recording
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory
from poise.types import Array
from poise.viewing import write_mismatch_report
from poise.viewing.canvas import Panel, add_axes, line
from poise.viewing.effort_figures import friction_panels

NOISE = np.repeat([0.1, 0.005], 3)
CONTACT = {"start": 12.3, "length": 1.8, "x": 0.0, "y": 0.0, "z": 0.17} | {
    f"force_{axis}_{k}": size * np.sin(np.pi * (k + 1) / 8)
    for axis, size in (("x", 8.6), ("y", -2.0), ("z", 1.5))
    for k in range(7)
}
ROOT = Path(__file__).resolve().parent.parent
SHAKEN = ROOT / "bags" / "kuka_vibration.mcap"
EMPS = ROOT / "examples" / "recordings" / "emps"
Effects = tuple[tuple[str, dict[str, float]], ...]
CASES: tuple[tuple[str, str, Effects, bool], ...] = (
    ("mismatch_contact", "Something in the way", (("contact", CONTACT),), False),
    ("mismatch_none", "A healthy robot", (), False),
    ("mismatch_unknown", "A stiff cable chain", (), True),
)


def chain(recorded: RecordedMotion) -> np.ndarray:
    """(N, 6) what no effect of the library says: a pull that waves with an angle of the arm."""
    out = np.zeros((len(recorded), 6))
    if recorded.joints is not None:
        out[:, 1] = 1.5 * np.sin(4.0 * recorded.joints.position[:, 2])
    return out


def diagnosed(effects: Effects, chained: bool) -> Diagnosis:
    """A UR10 that carries 2.1 kg for 30 s, with these effects, and the chain or not."""
    robot = RobotModel.from_file("ridgeback_ur10")
    seconds = np.arange(0.0, 30.0, 0.01)
    motion = FourierTrajectory.random(robot, np.random.default_rng(4), duration=30.0, speed=0.35)
    phi = InertialParameters(2.1, np.array([0.01, 0.0, 0.1]), np.diag([0.02, 0.02, 0.01])).phi
    recorded = recorded_from_motion(robot, seconds, motion.at(seconds), phi)
    components = [ModelEffect(name, values, np.zeros((len(values), len(values)))) for name, values in effects]
    said = with_model_effects(recorded, components, events=True).prediction + (chain(recorded) if chained else 0.0)
    wrench = said + np.random.default_rng(5).normal(size=said.shape) * NOISE
    return diagnose(replace(recorded, wrench=wrench), NominalModel(sensor_frame="ft_sensor", phi=phi))


def shaken() -> Diagnosis:
    """The committed recording of a KUKA arm that a person knocks; its load as identified from the static poses."""
    model = parse_model({"payload": {"mass": 0.9323, "com": [0.0, 0.0, 0.0439]}})
    reading = read_recording(open_recording(SHAKEN), model)
    return diagnose(reading.recorded, reading.model)


def arm_panels() -> list[Panel]:
    """Of the tutorial on missing physics: the friction of each joint over its velocity, recorded and fitted."""
    reading = read_recording(open_recording(ROOT / "examples" / "arm" / "run.mcap"), NominalModel())
    return friction_panels(diagnose(reading.recorded, reading.model).main, "arm")


def emps_panels() -> list[Panel]:
    """A published recording of one prismatic axis: its last 30 % without and with the effects, and its friction."""
    found = diagnose((reading := read_recording(open_recording(EMPS), NominalModel())).recorded, reading.model)
    examined = found.main
    effort, rows = examined.problem.recorded.effort, np.flatnonzero(examined.held_out)
    if effort is None:
        raise ValueError("the recording has no efforts")
    seconds, measured = effort.seconds[rows], effort.measured[rows, 0]
    nominal = examined.problem.predicted(examined.problem.recorded)[rows, 0]
    model = nominal + (examined.best.response + examined.best.calibrated)[rows, 0]

    def nrmse(predicted: Array) -> float:
        return float(np.sqrt(np.mean((measured - predicted) ** 2) / np.mean(measured**2)))

    title = f"EMPS, force (N): nrmse {nrmse(nominal):.2f} (red) to {nrmse(model):.3f} (blue)"

    def draw(figure: FigureBase) -> None:
        axes = add_axes(figure, title)
        line(axes, seconds, measured, "measured", "measured", 2.6)
        line(axes, seconds, nominal, "rejected", "without the effects", 1.2)
        line(axes, seconds, model, "accent", "with the effects", 1.0)

    names = ", ".join(finding.effect.name for finding in found.findings)
    return [Panel("emps", f"{title}; named: {names}", draw), *friction_panels(examined, "emps")]


def mismatch_pictures(photograph: Callable[[str, Path], None], **made: object) -> None:
    """Diagnose, write the reports, and hand each with its name to `photograph`."""
    cases = [(name, title, "run.mcap", partial(diagnosed, *case)) for name, title, *case in CASES]
    cases.append(("mismatch_shaken", "A KUKA LBR Med, shaken", str(SHAKEN.relative_to(ROOT)), shaken))
    for name, title, source, found_by in cases:
        found = found_by()
        print(f"{name}: {found.verdict}, {[finding.effect.name for finding in found.findings]}")
        with tempfile.TemporaryDirectory() as folder:
            page = write_mismatch_report(Path(folder), found, title, [source], **made)  # type: ignore[arg-type]
            photograph(name, page)
