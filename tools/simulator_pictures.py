"""Panels for docs/compare.md and docs/simulator.md: what changed, what a simulation lacks, and free runs."""

import tempfile
from pathlib import Path

import numpy as np

from poise.cli import run
from poise.commands.compare import read_alike
from poise.mismatch.application import recorded_run
from poise.mismatch.comparing import Comparison, compare
from poise.mismatch.reading import NominalModel, load_model
from poise.recording import open_recording
from poise.simulation.rollout import FreeArm, RolloutOptions, rolled_out
from poise.viewing.canvas import Panel
from poise.viewing.effort_figures import friction_panels, response_panels
from poise.viewing.mismatch_figures import residual_panels
from poise.viewing.rollout_report import window_panels

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE, PAIR = ROOT / "examples" / "simulator", ROOT / "examples" / "compare"


def compared(a: Path, b: Path, model: NominalModel) -> Comparison:
    """What changed from A to B."""
    readings = read_alike([a, b], model, {})
    return compare(readings[0].recorded, readings[1].recorded, readings[0].model)


def compare_panels() -> list[Panel]:
    """The example of docs/compare.md: the forces of the difference, without and with the change."""
    with tempfile.TemporaryDirectory() as folder:
        bags = [Path(folder) / f"{name}.mcap" for name in ("before", "after")]
        for seed, bag in enumerate(bags, 1):
            words = ["simulate", str(PAIR / f"{bag.stem}.yaml"), "--motion", str(PAIR / "motion.yaml"), "--urdf", "fr3"]
            run([*words, "--noise", "--seed", str(seed), "--out", str(bag)])
        found = compared(bags[0], bags[1], load_model(PAIR / "model.yaml"))
    return residual_panels(found.diagnosis.main, "compare")[:3]


def against_panels() -> list[Panel]:
    """The example of docs/simulator.md: the friction that the simulation lacks."""
    model = load_model(EXAMPLE / "arm.xml")
    found = compared(EXAMPLE / "simulator.mcap", EXAMPLE / "robot.mcap", model)
    examined = next(each for each in found.diagnosis.examinations if each.problem.signal == "effort")
    return [*friction_panels(examined, "against"), *response_panels(examined, "against")][:3]


def rollout_panels() -> list[Panel]:
    """Free runs of the example's model, before and after the export, beside the recording."""
    source = EXAMPLE / "arm.xml"
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "arm_found.xml"
        words = ["mismatch", str(EXAMPLE / "robot.mcap"), "--model", str(source), "--payload-link", "held"]
        run([*words, "--export", f"mjcf:{found}", "--into", str(source)])
        recorded = recorded_run(open_recording(EXAMPLE / "robot.mcap"))
        begin = float(np.quantile(recorded.seconds, 0.7))
        options = RolloutOptions((5.0,), 1, begin)
        runs = [rolled_out(FreeArm(path, recorded), options) for path in (source, found)]
    return window_panels(runs)
