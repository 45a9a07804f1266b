"""A slice of `benchmarks.broken_inputs`: what is said of broken recordings when they are read."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.broken_inputs.__main__ import GROUPS
from benchmarks.foreign.case import Case, make_case
from benchmarks.foreign.plan import plans
from poise.errors import PoiseError
from poise.mismatch.reading import load_model, read_recording
from poise.recording import open_recording

RIGS = {"wrench": "xarm7_driver", "efforts": "fr3_efforts", "joints": "fr3_efforts"}
SAID = [
    (group, name) for group, (ways, _) in GROUPS.items() for name, way in ways.items() if way.words and not way.effect
]
UNSAID = {("wrench", "one torque negative"), ("efforts", "efforts late")}
"""What 12 s of slow motion do not show."""


@pytest.fixture(scope="module")
def rigs() -> dict[str, Case]:
    found = {plan.profile: plan for plan in plans("healthy_dev", 12)}
    return {name: make_case(found[name], seconds=12.0) for name in set(RIGS.values())}


def said_of(case: Case, folder: Path) -> str:
    case.write(folder)
    try:
        return " ".join(
            read_recording(open_recording(folder / "recording.mcap"), load_model(folder / "model.yaml")).notes
        )
    except PoiseError as error:
        return error.message


@pytest.mark.parametrize("group", RIGS)
def test_a_healthy_recording_has_no_words_for_an_error(group: str, rigs: dict[str, Case], tmp_path: Path) -> None:
    said = said_of(rigs[RIGS[group]], tmp_path / "case")
    assert not [way.words for way in GROUPS[group][0].values() if way.words and re.search(way.words, said)]


@pytest.mark.parametrize(("group", "name"), [each for each in SAID if each not in UNSAID])
def test_an_error_of_a_driver_is_said(group: str, name: str, rigs: dict[str, Case], tmp_path: Path) -> None:
    ways, fit = GROUPS[group]
    case = rigs[RIGS[group]]
    assert fit(case)
    said = said_of(replace(case, streams=ways[name].change(case)), tmp_path / "case")
    assert re.search(ways[name].words, said, re.DOTALL), said
