"""The diagnosis on recordings with a known effect in them, beside what every honest robot has."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from cases import Case, make_case

from poise.mismatch.answer import Diagnosis, diagnose
from poise.mismatch.answer.diagnosis import with_model_effects
from poise.mismatch.reading import dump_model, parse_model
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

# Effect, and which of its numbers is the size that is compared, within what share of it.
PLAIN = {
    "sensor_bias": ("force_x", "force_y", "force_z"),
    "mass_step": ("mass",),
    "contact": (),
    "clock_offset": ("offset",),
    "world_force": ("force_x", "force_y", "force_z"),
}


@cache
def examined(name: str) -> tuple[Case, RecordedMotion, Diagnosis]:
    """A recording with one plain effect, or with none for ""."""
    case = make_case(11 + sorted([*PLAIN, ""]).index(name), ((name, 1.0),) if name else ())
    recorded = case.recorded()
    return case, recorded, diagnose(recorded, case.model)


@pytest.mark.parametrize("name", PLAIN)
def test_a_plain_effect_is_named_first_with_its_size(name: str) -> None:
    case, _, found = examined(name)
    assert found.verdict == "named"
    first = found.findings[0]
    assert first.effect.name == name
    true = np.array([case.truth[0][1][key] for key in PLAIN[name]])
    said = np.array([first.parameters[key].value for key in PLAIN[name]])
    # A bias is measured together with the small one that every honest sensor has.
    honest = 0.4 if name == "sensor_bias" else 0.0
    assert np.linalg.norm(said - true) <= 0.15 * np.linalg.norm(true) + honest


@pytest.mark.parametrize("name", PLAIN)
def test_the_augmented_model_removes_most_of_the_held_out_excess(name: str) -> None:
    proof = examined(name)[2].main.proof
    before, after = proof.nominal**2 - 1.0, max(proof.augmented**2 - 1.0, 0.0)
    # An event that is over before the held-out samples leaves nothing there to remove.
    assert after < 0.15 if before < 0.3 else after < 0.2 * before


def test_a_named_effect_is_not_listed_as_untestable() -> None:
    found = examined("sensor_bias")[2]
    search = replace(found.main.search, untestable={"sensor_bias": "too weak alone", "cable": "too weak"})
    doubtful = replace(found, examinations=(replace(found.main, search=search),))
    assert "cable" in doubtful.untestable
    assert "sensor_bias" not in doubtful.untestable


def test_a_contact_is_found_in_time() -> None:
    case, _, found = examined("contact")
    ((begin, end),) = found.findings[0].windows
    true = case.truth[0][1]["start"], case.truth[0][1]["start"] + case.truth[0][1]["length"]
    together = min(end, true[1]) - max(begin, true[0])
    assert together / (max(end, true[1]) - min(begin, true[0])) > 0.8


def test_the_moment_of_a_mass_step_is_found_to_a_sample() -> None:
    case, _, found = examined("mass_step")
    assert found.findings[0].parameters["time"].value == pytest.approx(case.truth[0][1]["time"], abs=0.015)


def test_calibration_errors_within_tolerance_are_no_finding() -> None:
    _, _, found = examined("")
    assert found.verdict == "none"
    assert found.main.proof.nominal == pytest.approx(1.0, abs=0.1)


def test_the_saved_model_explains_the_recording_when_it_is_read_again() -> None:
    _, recorded, found = examined("world_force")
    model = parse_model(yaml.safe_load(dump_model(found.augmented)))
    again = diagnose(recorded, model)
    assert [part.name for part in model.effects] == ["world_force"]
    assert again.verdict == "none"
    rest = recorded.wrench - with_model_effects(recorded, model.effects).prediction
    assert rest[:, :3].std() < 0.5 * (recorded.wrench - recorded.prediction)[:, :3].std() + 0.2


def test_what_depends_on_a_joint_in_a_way_of_no_effect_is_unknown() -> None:
    def catches(recorded: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        """A hose that catches eleven times in a turn of the fourth joint."""
        assert recorded.joints is not None
        angle = recorded.joints.position[:, recorded.joints.names.index("wrist_1_joint")]
        return np.outer(np.sin(11.0 * angle), [1.5, 0.0, 1.0, 0.0, 0.1, 0.0])

    case = make_case(31, spoil=catches)
    found = diagnose(case.recorded(), case.model)
    assert found.verdict in ("unknown", "mixed")
    assert found.unknown is not None
    assert "joint_position:wrist_1_joint" in found.unknown.depends_on


def test_the_same_recording_gives_the_same_answer() -> None:
    case, recorded, found = examined("mass_step")
    again = diagnose(recorded, case.model)
    assert [finding.values for finding in again.findings] == [finding.values for finding in found.findings]


@pytest.mark.parametrize("name", ["", "mass_step"])
def test_readings_beyond_the_sensors_range_say_only_that_the_load_is_no_smaller(name: str) -> None:
    """Most readings of one axis are at the limit; calibration errors and other effects are taken from the rest."""
    case, recorded, _ = examined(name)
    limit = float(np.quantile(np.abs(recorded.wrench[:, 2]), 0.4))
    forces = np.clip(recorded.wrench[:, :3], -limit, limit)
    clipped = replace(recorded, wrench=np.hstack([forces, recorded.wrench[:, 3:]]))
    found = diagnose(clipped, case.model)
    assert {each.effect.name for each in found.findings} == {"saturation", *([name] if name else [])}
    assert found.unknown is None
    (saturated,) = (each for each in found.findings if each.effect.name == "saturation")
    assert saturated.values["force_limit"] == limit
    proof = found.main.proof
    assert proof.augmented < 1.1
    assert proof.nominal > 2.0
    # The limit in the model is not found again; a step of the mass belongs to its recording.
    again = diagnose(clipped, found.augmented)
    assert [each.effect.name for each in again.findings] == ([name] if name else [])
    assert again.unknown is None
