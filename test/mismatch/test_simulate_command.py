"""`poise simulate`: what a model's effects add to a recording is what each of them says, and it can be read back."""

import json

import numpy as np
import pytest
import yaml
from field_robots import ARM, Recorded

from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.mismatch.effects import effect_named
from poise.mismatch.reading import (
    ModelEffect,
    NominalModel,
    acting_on_efforts,
    complete_values,
    dump_model,
    load_model,
    parse_model,
    read_recording,
    with_model_effects,
)
from poise.recording import open_recording, write_recording

PAYLOAD = {"mass": 2.1, "com": [0.0, 0.01, 0.1], "inertia": [0.01, 0, 0, 0.01, 0, 0.005]}
EFFECTS = [
    {"name": "low_pass", "parameters": {"time_constant": 0.05}},
    {"name": "world_force", "parameters": {"x": 0, "y": 0, "z": 0.1, "force_x": 2, "force_y": 0, "force_z": 1}},
    {"name": "mass_step", "parameters": {"time": 6.0, "mass": -0.4, "moment_x": 0, "moment_y": 0, "moment_z": -0.04}},
    {"name": "coulomb_friction", "parameters": {f"torque_{i}": 2.0 for i in range(1, 7)}},
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A nominal and an augmented model, a trajectory, and the nominal simulation along it."""
    tmp_path = tmp_path_factory.mktemp("simulate")
    nominal = {"sensor_frame": "ft_sensor", "payload": PAYLOAD}
    paths = {name: tmp_path / name for name in ("nominal.yaml", "augmented.yaml", "excite.yaml", "plain.mcap")}
    paths["nominal.yaml"].write_text(yaml.safe_dump(nominal))
    paths["augmented.yaml"].write_text(yaml.safe_dump(nominal | {"effects": EFFECTS}))
    paths["excite.yaml"].write_text("{fourier: {seed: 3, duration: 12, speed: 0.3}}")
    arguments = ["--motion", paths["excite.yaml"], "--urdf", "ridgeback_ur10", "--out", paths["plain.mcap"]]
    assert run(["simulate", str(paths["nominal.yaml"]), *map(str, arguments)]) == 0
    return paths


def simulated(files, model, out, *options):
    target = files["plain.mcap"].with_name(out)
    chosen = ["--motion", str(files["plain.mcap"]), "--out", str(target), *options]
    assert run(["simulate", str(files[model]), *chosen]) == 0
    return target


def test_the_nominal_simulation_agrees_with_the_nominal_world_that_reads_it(files):
    recorded = read_recording(open_recording(files["plain.mcap"]), load_model(files["nominal.yaml"])).recorded
    inner = (recorded.seconds > 1.5) & (recorded.seconds < 10.5)  # where the motion begins, jerk jumps
    assert np.abs(recorded.wrench - recorded.prediction)[inner].max() < 2e-3
    moving = (recorded.effort.seconds > 1.5) & (recorded.effort.seconds < 10.5)
    assert np.abs(recorded.effort.measured - recorded.effort.rigid)[moving].max() < 2e-2


def test_the_residual_of_the_nominal_world_is_what_the_effects_say(files):
    """Kinematics, load, event and sensor in their order, and the friction in the efforts."""
    bag = simulated(files, "augmented.yaml", "augmented.mcap")
    recorded = read_recording(open_recording(bag), load_model(files["nominal.yaml"])).recorded
    pull, filtered, dropped, rubbing = (
        (effect_named(entry["name"]), entry["parameters"]) for entry in (EFFECTS[1], EFFECTS[0], EFFECTS[2], EFFECTS[3])
    )
    said = recorded.prediction + pull[0].simulate(recorded, pull[1])
    said = said + dropped[0].simulate(recorded, dropped[1])
    said = said + filtered[0].simulate(recorded.with_prediction(said), filtered[1])
    inner = (recorded.seconds > 1.5) & (recorded.seconds < 10.5)
    assert np.abs(recorded.wrench - said)[inner].max() < 5e-3
    assert np.abs(recorded.wrench - recorded.prediction)[inner].max() > 2.0
    friction = recorded.effort.measured - recorded.effort.rigid
    inner = (recorded.effort.seconds > 1.5) & (recorded.effort.seconds < 10.5)
    exact = rubbing[0].simulate(recorded, complete_values(rubbing[0], recorded, rubbing[1]))
    for effect, values in (pull, dropped):  # the joints carry them
        exact = exact + acting_on_efforts(effect).simulate(recorded, values)
    assert np.quantile(np.abs(friction - exact)[inner], 0.99) < 0.02


def test_what_is_not_simulated_stays_as_it_was(files):
    before, after = (
        open_recording(path) for path in (files["plain.mcap"], simulated(files, "augmented.yaml", "b.mcap"))
    )
    assert after.topics == before.topics
    assert after.robot_description() == before.robot_description()
    assert after.losses == ()
    ours, theirs = after.joint_states(), before.joint_states()
    rows = np.isin(theirs.stamps, ours.stamps)
    np.testing.assert_array_equal(theirs.position[rows], ours.position)


def test_noise_is_the_models_and_the_same_for_the_same_seed(files):
    bags = [
        simulated(files, "nominal.yaml", f"{name}.mcap", "--noise", "--seed", seed)
        for name, seed in (("a", "1"), ("b", "1"), ("c", "2"))
    ]
    first, same, other = (open_recording(bag).wrench().wrench_in_sensor for bag in bags)
    np.testing.assert_array_equal(first, same)
    plain = open_recording(simulated(files, "nominal.yaml", "d.mcap")).wrench().wrench_in_sensor
    for noisy in (first, other):
        np.testing.assert_allclose((noisy - plain).std(axis=0), np.repeat([0.1, 0.005], 3), rtol=0.1)
    assert np.abs(first - other).max() > 0.05


def test_the_summary_says_what_acted(files, capsys):
    simulated(files, "augmented.yaml", "b.mcap", "--json", "-")
    content = json.loads(capsys.readouterr().out)
    assert {entry["name"]: entry["acts"] for entry in content["effects"]} == {e["name"]: True for e in EFFECTS}
    assert content["frame_id"] == "ft_sensor"
    assert content["mass"] == pytest.approx(2.1)
    assert content["effects"][1]["largest"]["force"] == pytest.approx(np.sqrt(5), rel=0.05)


@pytest.mark.parametrize(
    ("change", "arguments", "words"),
    [
        ({"effects": [{"name": "gremlins", "parameters": {}}]}, [], "gremlins"),
        ({"effects": [{"name": "low_pass", "parameters": {}}]}, [], "time_constant"),
        ({}, ["--urdf", "fr3"], "--urdf"),
    ],
)
def test_what_makes_no_sense_is_one_line(files, tmp_path, capsys, change, arguments, words):
    model = tmp_path / "bad.yaml"
    model.write_text(yaml.safe_dump({"payload": PAYLOAD} | change))
    out = tmp_path / "out.mcap"
    assert run(["simulate", str(model), "--motion", str(files["plain.mcap"]), "--out", str(out), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_a_trajectory_needs_a_robot(files, capsys):
    arguments = ["--motion", str(files["excite.yaml"]), "--out", str(files["plain.mcap"].with_name("x.mcap"))]
    assert run(["simulate", str(files["nominal.yaml"]), *arguments]) == 2
    assert "--urdf" in capsys.readouterr().err


def test_events_stay_in_their_recording_unless_asked(files):
    recorded = read_recording(open_recording(files["plain.mcap"]), load_model(files["nominal.yaml"])).recorded
    (event,) = [entry for entry in EFFECTS if entry["name"] == "mass_step"]
    component = ModelEffect("mass_step", event["parameters"], np.zeros((5, 5)))
    assert with_model_effects(recorded, [component]) is recorded
    assert with_model_effects(recorded, [component], events=True) is not recorded
    with pytest.raises(InputError) as raised:
        with_model_effects(recorded, [ModelEffect("gremlins", {}, np.zeros((0, 0)))])
    assert raised.value.code is ErrorCode.BAD_INPUT


def test_joint_efforts_alone_are_simulated_along_their_recording_and_along_a_plan(tmp_path):
    model = {"effects": [{"name": "viscous_friction", "parameters": {f"damping_{i}": 4.0 for i in (1, 2, 3)}}]}
    augmented, bag, out, plan = (tmp_path / name for name in ("a.yaml", "run.mcap", "out.mcap", "plan.csv"))
    augmented.write_text(yaml.safe_dump(model))
    joints = Recorded(rate=1000.0, seconds=6.0, effort_noise=1e-3).joints()
    write_recording(bag, {"joint_states": joints}, robot_description=ARM)
    assert run(["simulate", str(augmented), "--motion", str(bag), "--out", str(out)]) == 0
    made = open_recording(out)
    assert list(made.topics) == list(open_recording(bag).topics)
    after = made.joint_states()
    # Every state of the recording, not only the averages that were compared, has its simulated effort.
    rows = np.isin(joints.stamps, after.stamps)
    assert rows.mean() > 0.95
    added = after.effort - joints.effort[rows]
    assert np.abs(added - 4.0 * joints.velocity[rows]).max() < 0.05 * 4.0 * np.abs(joints.velocity).max()
    (tmp_path / "arm.urdf").write_text(ARM)
    times = np.arange(0.0, 6.0, 0.5)
    rows = [f"{t},{np.sin(t)},{np.cos(t) - 1},{0.3 * t}" for t in times]
    plan.write_text("\n".join(["time,shoulder,elbow,wrist", *rows]))
    arguments = ["--urdf", str(tmp_path / "arm.urdf"), "--motion", str(plan), "--out", str(out)]
    assert run(["simulate", str(augmented), *arguments]) == 0


def test_a_vibration_that_an_accelerometer_measured_is_left_out_along_a_plan(files, capsys):
    """Its values are the clock and the gain of that accelerometer, which a planned motion does not have."""
    values = {"start": 1.0, "length": 2.0, "frequency": 40.0, "accelerometer_late": 0.007, "smoothing": 0.002}
    values["gain"] = 0.8
    model = files["nominal.yaml"].with_name("felt.yaml")
    content = yaml.safe_load(files["nominal.yaml"].read_text())
    model.write_text(yaml.safe_dump(content | {"effects": [{"name": "external_vibration", "parameters": values}]}))
    arguments = ["--motion", files["excite.yaml"], "--urdf", "ridgeback_ur10", "--out", model.with_name("c.mcap")]
    assert run(["simulate", str(model), *map(str, arguments), "--json", "-"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["effects"]
    assert not entry["acts"]
    assert "accelerometer" in entry["reason"]


def test_a_saved_inertia_is_that_of_a_body_or_left_out():
    wild = InertialParameters(1.0, np.zeros(3), np.diag([0.01, 0.01, -0.02])).phi
    text = dump_model(NominalModel(phi=wild))
    assert "inertia" not in yaml.safe_load(text)["payload"]
    assert parse_model(yaml.safe_load(text)).phi is not None
