"""The benchmark of concealed effects keeps its labels to itself, and its scorer counts right."""

import dataclasses
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the benchmark's engine is an extra: pip install '.[sim]'")

from benchmarks.concealed import run
from benchmarks.concealed.case import Case, Plan, make_case
from benchmarks.concealed.changes import DECOYS, DEPENDS_ON, LIBRARY, UNKNOWNS
from benchmarks.concealed.changes.chain import Bias, Clock, Encoders, Gain, Turned
from benchmarks.concealed.changes.honest import TOLERANCE, honest_errors
from benchmarks.concealed.changes.weight import OtherPayload
from benchmarks.concealed.confusion import counts, draw
from benchmarks.concealed.plan import PAIRS, SEEDS, draw_plans, plans_of
from benchmarks.concealed.recorder import PERIODS, WHITE
from benchmarks.concealed.run import judge as run_tool
from benchmarks.concealed.seals import open_seals, private_file, sealed, write_seals
from benchmarks.concealed.table import brier, calibration_error, score
from benchmarks.concealed.tally import judge, overlap, parameter_errors, removed_share, states_of
from benchmarks.concealed.twins import TWINS
from poise.mismatch.reading import load_model
from poise.recording import WrenchStream, open_recording

ISSUE = [
    "sensor_bias",
    "bias_drift",
    "sensor_creep",
    "sensor_gain",
    "sensor_nonlinearity",
    "sensor_rotation",
    "quantisation",
    "saturation",
    "low_pass",
    "clock_offset",
    "clock_skew",
    "base_tilt",
    "base_motion",
    "joint_offset",
    "payload_parameters",
    "mass_step",
    "mass_leak",
    "world_force",
    "cable",
    "air_drag",
    "slosh",
    "hanging_chain",
    "loose_part",
    "grasp_compliance",
    "flexible_mode",
    "flywheel",
    "contact",
    "external_vibration",
    "viscous_friction",
    "coulomb_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "joint_coupling",
    "gear_ripple",
    "backlash",
    "motor_inertia",
]


@pytest.fixture(scope="module")
def pair() -> Case:
    """A case with two effects, with all that honest robots have."""
    return make_case(Plan("pair", ("sensor_bias", "mass_step"), 1.0, False, (77, 1)))


@pytest.fixture(scope="module")
def folder(pair: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case as `make` leaves it."""
    place = tmp_path_factory.mktemp("concealed") / "bags"
    place.mkdir()
    pair.write(place, "case_0001")
    write_seals(place, {"case_0001": sealed(pair.label.document())})
    return place


def test_the_generator_has_every_effect_of_the_issue_and_six_that_no_library_has() -> None:
    assert set(LIBRARY) == set(ISSUE)
    assert len(UNKNOWNS) >= 6
    assert set(DEPENDS_ON) == set(UNKNOWNS)
    assert set(DECOYS) >= {"dropped_samples", "outliers", "loud_noise", "clock_jitter", "swaying_floor"}


def test_nothing_in_the_folder_of_bags_tells_the_label(folder: Path, pair: Case) -> None:
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["case_0001.mcap", "case_0001.yaml", "seals.json"]
    words = [*LIBRARY, *UNKNOWNS, *DECOYS, "strength", pair.label.motion]
    # The tolerances of model.yaml are named like the effects that exceed them; nothing else is.
    text = (folder / "case_0001.yaml").read_text()
    assert text.index("tolerance:") < min(text.find(word) for word in words if word in text)
    recording = open_recording(folder / "case_0001.mcap")
    content = b"".join(message.data for message in recording.messages())
    said = json.dumps([recording.metadata, list(recording.topics)]).encode() + content
    assert len(content) > 10**6
    assert not [word for word in words if word.encode() in said]


def test_a_bag_is_what_the_contract_says(folder: Path) -> None:
    recording = open_recording(folder / "case_0001.mcap")
    wrench, joints, odom = recording.wrench(), recording.joint_states(), recording.odometry()
    text = recording.robot_description()
    assert (odom.parent, odom.child) == ("odom", "base_link")
    assert wrench.frame_id == "ft_sensor"
    assert len(joints.names) == 6
    assert np.isfinite(joints.velocity).all()
    assert np.isnan(joints.effort).all()
    assert 'name="ft_sensor"' in text
    assert "gripper" not in text
    for stream, topic in ((wrench, "wrench"), (joints, "joint_states")):
        assert abs(np.diff(stream.seconds).mean() - PERIODS[topic]) < 1e-5
        assert 2e-4 < np.diff(stream.seconds).std() < 6e-4
    model = load_model(folder / "case_0001.yaml")
    assert model.tolerance.clock_offset == TOLERANCE.clock_offset
    assert model.phi is not None


@pytest.mark.parametrize("names", [(), ("dropped_samples",)])
def test_a_quiet_honest_free_recording_is_the_nominal_one(names: tuple[str, ...]) -> None:
    case = make_case(Plan("decoy" if names else "null", names, 1.0, True, (77, 2)), honest=False, quiet=True)
    assert case.label.nominal_rms < 1e-6
    assert case.label.effects == []


def test_the_noise_of_the_wrench_is_as_stated() -> None:
    plan = Plan("null", (), 0.0, False, (77, 3))
    noisy, quiet = (make_case(plan, honest=False, quiet=quiet).recorded.streams["wrench"] for quiet in (False, True))
    assert isinstance(noisy, WrenchStream)
    assert isinstance(quiet, WrenchStream)
    noise = noisy.wrench_in_sensor - quiet.wrench_in_sensor
    # White noise shows in the differences, where the slow part does not.
    white = np.diff(noise, 2, axis=0).std(axis=0) / np.sqrt(6)
    np.testing.assert_allclose(white, WHITE, rtol=0.15)
    assert (noise.std(axis=0) > 1.05 * WHITE).all()


def test_honest_errors_lie_inside_the_tolerances() -> None:
    for seed in range(60):
        for error in honest_errors(np.random.default_rng(seed), frozenset()):
            match error:
                case Bias():
                    assert (np.abs(error.bias) <= np.repeat(TOLERANCE.bias, 3)).all()
                    assert (np.abs(error.drift) <= np.repeat(TOLERANCE.drift, 3)).all()
                case Gain():
                    assert (np.abs(error.error) <= TOLERANCE.gain).all()
                case Turned():
                    assert (np.abs(error.rotation) <= TOLERANCE.rotation).all()
                case Encoders():
                    assert (np.abs(error.offset) <= TOLERANCE.joint_offset).all()
                case Clock():
                    assert abs(error.offset) <= TOLERANCE.clock_offset
                    assert error.skew == 0.0
                case OtherPayload():
                    assert abs(error.mass) <= TOLERANCE.mass
                    assert (np.abs(error.com) <= TOLERANCE.com).all()
                    assert abs(error.inertia) <= TOLERANCE.inertia


def test_an_effect_on_calibration_exceeds_the_tolerance_at_its_weakest() -> None:
    rng = np.random.default_rng(0)
    for name, limit in (("clock_offset", TOLERANCE.clock_offset), ("joint_offset", TOLERANCE.joint_offset)):
        values = [abs(v) for v in LIBRARY[name](None, 0.3, rng).parameters.values()]
        assert min(values) > 1.5 * limit
    for name, limit in (("sensor_bias", TOLERANCE.bias[0]), ("bias_drift", TOLERANCE.drift[0])):
        values = LIBRARY[name](None, 0.3, rng).parameters
        assert math.hypot(*(values[f"force_{axis}"] for axis in "xyz")) > 1.5 * limit


def test_times_of_a_label_count_from_the_first_wrench_stamp(pair: Case) -> None:
    step = pair.label.effects[1]
    stream = pair.recorded.streams["wrench"]
    assert isinstance(stream, WrenchStream)
    load = np.linalg.norm(stream.wrench_in_sensor[:, :3], axis=1)
    time = step["parameters"]["time"]
    before, after = (
        load[(stream.seconds > a) & (stream.seconds < b)].mean()
        for a, b in ((time - 0.06, time - 0.02), (time + 0.02, time + 0.06))
    )
    assert 1.0 < abs(after - before) < 5.0
    assert step["windows"][0][0] == time


def test_plans_have_their_shares_and_development_and_final_share_no_chance() -> None:
    plans = draw_plans("final", 200)
    kinds = Counter(plan.kind for plan in plans)
    assert sum(kinds.values()) == 200
    assert kinds["single"] >= 100
    assert min(kinds[kind] for kind in ("pair", "null", "decoy", "foreign")) >= 18
    singles = {(plan.names[0], plan.strength) for plan in plans if plan.kind == "single"}
    assert singles == {(name, strength) for name in LIBRARY for strength in (1.0, 0.3)}
    assert len(set(SEEDS.values())) == len(SEEDS)
    assert not {plan.seed for plan in plans} & {plan.seed for plan in draw_plans("development", 200)}
    assert {name for pair in PAIRS for name in pair} <= set(LIBRARY)


def test_plans_of_some_effects_have_seeds_of_their_own() -> None:
    found = [(*plan.names, plan.effort, *plan.seed) for plan in plans_of(["slosh", "backlash"], 2)[1:3]]
    assert found == [("slosh", False, SEEDS["effects"], 1), ("backlash", True, SEEDS["effects"], 2)]


@pytest.mark.parametrize("name", sorted(TWINS))
def test_a_twin_names_its_own_effect_among_those_that_are_as_right(name: str) -> None:
    label = make_case(Plan("twin", (name,), 1.0, False, (77, 4))).label
    assert {effect["name"] for effect in label.effects} <= set(label.accept)
    assert set(label.accept) <= set(LIBRARY)


# Seals


def test_a_label_that_was_changed_afterwards_is_refused(folder: Path, tmp_path: Path) -> None:
    private = private_file(folder)
    assert private.parent != folder
    assert open_seals(folder, private)["case_0001"]["kind"] == "pair"
    content = json.loads(private.read_text())
    content["case_0001"]["label"]["kind"] = "null"
    forged = tmp_path / "forged.json"
    forged.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="case_0001"):
        open_seals(folder, forged)
    forged.write_text("{}")
    with pytest.raises(ValueError, match="does not belong"):
        open_seals(folder, forged)


def test_equal_labels_have_different_seals() -> None:
    assert sealed({"kind": "null"}).seal != sealed({"kind": "null"}).seal


# Running the tool


def test_the_tool_sees_neither_the_case_nor_the_rest_of_the_environment(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spy = tmp_path / "spy"
    spy.write_text('#!/bin/sh\n{ echo "$@"; env; pwd; ls; } > answer.json\n')
    spy.chmod(0o755)
    monkeypatch.setattr(run, "_tool", lambda: str(spy))
    monkeypatch.setenv("CASE_LABEL", "secret")
    outcome = run_tool(folder / "case_0001.mcap", tmp_path)
    assert outcome.status == 0
    seen = (tmp_path / "case_0001.json").read_text()
    assert "model.yaml" in seen
    assert "recording.mcap" in seen
    for word in ("case_0001", "secret", "seals", str(folder)):
        assert word not in seen


def test_a_tool_that_fails_leaves_no_answer(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\necho half > answer.json\necho reason >&2\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setattr(run, "_tool", lambda: str(broken))
    outcome = run_tool(folder / "case_0001.mcap", tmp_path)
    assert (outcome.status, outcome.complaint) == (3, "reason\n")
    assert not (tmp_path / "case_0001.json").exists()


# The scorer, on answers made by hand


def label(kind: str, *names: str, strength: float = 1.0, **more: object) -> dict[str, object]:
    effects = [{"name": name, "parameters": {}, "windows": []} for name in names]
    empty = {"accept": [], "depends_on": [], "foreign": "", "decoy": ""}
    return {"kind": kind, "strength": strength, "effects": effects, **empty, **more}


def answer(verdict: str, *names: str, probability: float = 0.9, **more: object) -> dict[str, object]:
    effects = [{"name": name, "probability": probability, "parameters": {}, "windows": []} for name in names]
    return {"verdict": verdict, "effects": effects, "unknown": None, "seconds": 2.0, **more}


@pytest.mark.parametrize(
    ("truth", "said", "right", "extra"),
    [
        (label("single", "slosh"), answer("named", "slosh"), True, False),
        (label("single", "slosh"), answer("mixed", "slosh", "cable"), True, True),
        (label("single", "slosh"), answer("named", "cable", "slosh"), False, True),
        (label("single", "slosh"), answer("none"), False, False),
        (label("single", "slosh"), None, False, False),
        (label("pair", "slosh", "cable"), answer("named", "cable", "slosh"), True, False),
        (label("pair", "slosh", "cable"), answer("named", "cable"), False, False),
        (label("null"), answer("none"), True, False),
        (label("null"), answer("unknown"), False, False),
        (label("null"), None, False, False),
        (label("decoy"), answer("named", "sensor_bias"), False, True),
        (label("foreign"), answer("unknown"), True, False),
        (label("foreign"), answer("mixed", "sensor_gain"), True, True),
        (label("foreign"), answer("named", "sensor_gain"), False, True),
        (label("twin", "low_pass", accept=["low_pass", "clock_offset"]), answer("named", "clock_offset"), True, False),
    ],
)
def test_right_and_wrong_answers_are_distinguished(truth: dict, said: dict | None, right: bool, extra: bool) -> None:
    verdict = judge("case", truth, said)
    assert (verdict.right, verdict.extra) == (right, extra)


def test_windows_overlap_by_intersection_over_union() -> None:
    assert overlap([[1, 3]], [[1, 3]]) == 1.0
    assert overlap([[1, 3]], [[2, 4]]) == pytest.approx(1 / 3)
    assert overlap([[1, 2], [3, 4]], [[1, 4]]) == pytest.approx(2 / 3)
    assert overlap([[1, 3]], None) == 0.0


def test_vectors_are_compared_as_vectors_and_places_are_left_out() -> None:
    truth = {"name": "world_force", "parameters": {"force_x": 3.0, "force_y": 4.0, "force_z": 0.0, "x": 0.1}}
    said = {"parameters": {"force_x": {"value": 3.0}, "force_y": {"value": 4.5}, "force_z": {"value": 0.0}}}
    assert parameter_errors(truth, said) == {"force": pytest.approx(0.1)}
    gains = {"name": "sensor_gain", "parameters": {"gain_fx_fx": 0.06}}
    assert parameter_errors(gains, {"parameters": {"gain_fx_fx": 0.054}}) == {"gain": pytest.approx(0.1)}
    assert parameter_errors(gains, {"parameters": {}}) == {}


def test_states_are_understood_however_they_are_spelt() -> None:
    said = {"unknown": {"depends_on": ["joint angle: elbow_joint", {"state": "base acceleration"}, "elapsed time"]}}
    assert states_of(said) == ["joint_position", "base_acceleration", "time"]
    assert states_of({"unknown": {"depends_on": "joint_velocity:wrist_1_joint"}}) == ["joint_velocity"]
    assert states_of({"unknown": None}) == []


def test_the_removed_share_counts_what_lies_above_the_noise() -> None:
    assert removed_share({"fit": {"holdout": {"nominal": 3.0, "augmented": 1.0}}}) == 1.0
    assert removed_share({"fit": {"holdout": {"nominal": 3.0, "augmented": 2.0}}}) == pytest.approx(1 - 3 / 8)
    assert removed_share({"fit": {"holdout": {"nominal": 1.0, "augmented": 1.0}}}) is None
    assert removed_share({}) is None


def test_stated_probabilities_are_checked_against_how_often_they_were_true() -> None:
    honest = [(0.75, True)] * 75 + [(0.75, False)] * 25
    assert calibration_error(honest) == pytest.approx(0.0, abs=1e-12)
    assert brier(honest) == pytest.approx(0.75 * 0.25)
    assert calibration_error([(1.0, False)]) == 1.0
    assert calibration_error([]) is None


def test_perfect_answers_meet_every_goal_and_no_answers_meet_none() -> None:
    contact = label("single", "contact")
    contact["effects"][0] |= {"parameters": {"peak_force": 9.0}, "windows": [[2.0, 3.0]]}  # type: ignore[index]
    step = label("pair", "sensor_bias", "mass_step")
    step["effects"][1]["parameters"] = {"mass": 0.3, "time": 4.0}  # type: ignore[index]
    labels = [contact, step, label("single", "slosh", strength=0.3), label("null"), label("decoy")]
    labels += [label("foreign", depends_on=["time"]), label("twin", "low_pass", accept=["low_pass", "clock_offset"])]
    labels.append(label("single", "sensor_bias"))
    labels[-1]["effects"][0]["parameters"] = {"force_x": 1.0}  # type: ignore[index]
    labels.append(label("single", "flywheel"))
    labels[-1]["effects"][0]["parameters"] = {"momentum_x": 1.0}  # type: ignore[index]
    perfect = [_perfect(one) for one in labels]
    rows = score([judge(str(i), truth, said) for i, (truth, said) in enumerate(zip(labels, perfect, strict=True))], {})
    assert [row.what for row in rows if row.met is False] == []
    assert sum(row.met is True for row in rows) == 16
    silent = score([judge(str(i), truth, None) for i, truth in enumerate(labels)], {})
    assert [row.what for row in silent if row.met] == []


def _perfect(truth: dict) -> dict[str, object]:
    names = [effect["name"] for effect in truth["effects"]]
    said = answer("named" if names else "none", *names, probability=1.0)
    for effect, true in zip(said["effects"], truth["effects"], strict=True):  # type: ignore[call-overload]
        effect |= {key: true[key] for key in ("parameters", "windows")}
        effect["indistinguishable_from"] = truth["accept"]
    said["fit"] = {"holdout": {"nominal": 3.0, "augmented": 1.0}}
    if truth["kind"] == "foreign":
        said |= {"verdict": "unknown", "unknown": {"depends_on": ["time"]}}
    return said


def test_the_confusion_matrix_counts_each_first_name_once(tmp_path: Path) -> None:
    verdicts = [
        judge("1", label("single", "slosh"), answer("named", "slosh")),
        judge("2", label("single", "slosh"), answer("named", "cable")),
        judge("3", label("null"), answer("none")),
        judge("4", label("foreign"), None),
    ]
    rows, columns, table = counts(verdicts)
    assert rows == ["slosh", "none", "unknown"]
    assert table.sum() == 4
    assert table[0, columns.index("cable")] == 1
    assert table[2, columns.index("no answer")] == 1
    draw(tmp_path / "confusion.png", verdicts)
    assert (tmp_path / "confusion.png").read_bytes().startswith(b"\x89PNG")


def test_a_case_is_the_same_whenever_it_is_made() -> None:
    plan = Plan("single", ("slosh",), 0.3, False, (77, 5))
    one, two = (make_case(plan) for _ in range(2))
    assert one.label == two.label
    for topic, stream in one.recorded.streams.items():
        for name, array in stream.arrays().items():
            np.testing.assert_array_equal(array, getattr(two.recorded.streams[topic], name))
    assert dataclasses.asdict(one.label) == two.label.document()
