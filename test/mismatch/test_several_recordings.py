"""Several recordings at once: one clock, events stay in theirs, and the last is for the proof alone."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import ROBOT, make_case

from poise.cli import run
from poise.mismatch.application import run_planned
from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.reading import ModelEffect, NominalModel, dump_model, joined, spans
from poise.mismatch.reading.joining import RECORDING_GAP
from poise.mismatch.recorded import RecordedMotion
from poise.recording import write_recording
from poise.robot.model import find_urdf
from poise.robot.urdf import read_urdf
from poise.simulation import FourierTrajectory

PHI = make_case(5, duration=5.0).exact.phi
BIAS = {"force_x": 2.0, "force_y": -1.0, "force_z": 0.0, "torque_x": 0.1, "torque_y": 0.0, "torque_z": 0.0}
STEP = {"time": 8.0, "mass": 0.4, "moment_x": 0.0, "moment_y": 0.0, "moment_z": 0.04}


def component(name: str, values: dict[str, float]) -> ModelEffect:
    return ModelEffect(name, values, np.zeros((len(values), len(values))))


def recorded_bag(folder: Path, seed: int, *parts: ModelEffect) -> Path:
    """A bag of the simulator, with the effects in it."""
    rng = np.random.default_rng(seed)
    motion = FourierTrajectory.random(ROBOT, rng, duration=14.0, speed=0.3, amplitude=0.7, frequency=0.12)
    moves = np.arange(9) >= 3
    motion = replace(motion, sine=motion.sine * moves, cosine=motion.cosine * moves)
    made = run_planned(ROBOT, motion, NominalModel(sensor_frame="ft_sensor", phi=PHI, effects=parts), rng)
    assert made.joints is not None
    joints = replace(made.joints, effort=np.full_like(made.joints.effort, np.nan))
    path = folder / f"run_{seed}.mcap"
    streams = {"wrench": made.wrench, "joint_states": joints}
    write_recording(path, streams, robot_description=read_urdf(find_urdf("ridgeback_ur10")))
    return path


@pytest.fixture(scope="module")
def recorded() -> RecordedMotion:
    """Two recordings as one, their break in the middle."""
    recordings = [make_case(seed, duration=12.0).recorded() for seed in (3, 4)]
    return joined(recordings)[0]


@pytest.mark.parametrize("effect", [each for each in all_effects() if each.signal == "wrench"], ids=lambda e: e.name)
def test_effects_survive_a_break_where_there_are_no_samples(recorded: RecordedMotion, effect: Effect) -> None:
    """A burst on both sides of the break, so that windows and moments are looked for within it."""
    residual = np.random.default_rng(0).normal(size=(len(recorded), 6)) * 0.1
    middle = int(np.argmax(np.diff(recorded.seconds)))
    residual[middle - 30 : middle + 30] += 5.0
    if effect.untestable(recorded):
        pytest.skip(effect.untestable(recorded))
    for start in effect.starts(recorded, residual):
        values = {**start, **{p.name: p.scale for p in effect.parameters(recorded) if p.linear}}
        assert np.isfinite(effect.simulate(recorded, values)).all()
        assert all(np.isfinite(window).all() for window in effect.windows(recorded, values))


def test_recordings_lie_one_after_the_other_on_one_clock() -> None:
    noise = (0.0, 2e-3, 1e-3)
    recordings = [replace(make_case(3 + k, duration=6.0).recorded(), place_noise=noise[k]) for k in range(3)]
    whole, last = joined(recordings)
    assert whole.place_noise == 2e-3
    for (begin, end), each in zip(spans(recordings), recordings, strict=True):
        inside = (whole.seconds >= begin - 1e-9) & (whole.seconds <= end + 1e-9)
        assert np.array_equal(whole.wrench[inside], each.wrench)
    assert whole.seconds[last][0] - whole.seconds[~last][-1] == pytest.approx(RECORDING_GAP)
    assert last.sum() == len(recordings[-1])


def test_what_transfers_is_proven_on_the_last_and_an_event_stays_in_its_own(tmp_path: Path) -> None:
    bias = component("sensor_bias", BIAS)
    bags = [
        recorded_bag(tmp_path, 1, bias, component("mass_step", STEP)),
        recorded_bag(tmp_path, 2, bias),
    ]
    model = tmp_path / "model.yaml"
    model.write_text(dump_model(NominalModel(sensor_frame="ft_sensor", phi=PHI)))
    answer = tmp_path / "answer.json"
    assert run(["mismatch", *map(str, bags), "--model", str(model), "--json", str(answer)]) == 0
    said = json.loads(answer.read_text())
    assert {effect["name"] for effect in said["effects"]} == {"sensor_bias", "mass_step"}
    first, second = said["recordings"]
    (step,) = [effect for effect in said["effects"] if effect["name"] == "mass_step"]
    assert first["start"] < step["parameters"]["time"]["value"] < first["end"] < second["start"]
    error = said["fit"]["holdout"]
    assert error["nominal"] > 3.0
    assert error["augmented"] < 1.1
