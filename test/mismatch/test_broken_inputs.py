"""A slice of `benchmarks.broken_inputs`: what is said of broken recordings when they are read."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.broken_inputs import tables
from benchmarks.broken_inputs.__main__ import GROUPS, outcome
from benchmarks.broken_inputs.way import Written
from benchmarks.foreign.case import Case, make_case
from benchmarks.foreign.plan import plans
from benchmarks.foreign.run import RECORDING
from poise.errors import PoiseError
from poise.mismatch.reading import load_model, read_recording
from poise.recording import WrenchStream, open_recording

RIGS = {
    "wrench": "xarm7_driver",
    "efforts": "fr3_efforts",
    "joints": "fr3_efforts",
    "tables": "ur10_rolling_fine",
    "models": "xarm7_driver",
    "descriptions": "xarm7_driver",
}
SAID = [
    (group, name) for group, (ways, _) in GROUPS.items() for name, way in ways.items() if way.words and not way.effect
]
SLIDES = "gantry_efforts"
UNSAID = {("wrench", "one torque negative"), ("efforts", "efforts late")}
"""What 12 s of slow motion do not show."""


@pytest.fixture(scope="module")
def rigs() -> dict[str, Case]:
    found = {plan.profile: plan for plan in plans("healthy_dev", 12)}
    return {name: make_case(found[name], seconds=12.0) for name in {*RIGS.values(), SLIDES}}


def said_of(case: Written, folder: Path) -> str:
    case.write(folder)
    recording = next(folder / name for name in (RECORDING, tables.RECORDING) if (folder / name).exists())
    try:
        return " ".join(read_recording(open_recording(recording), load_model(folder / "model.yaml")).notes)
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
    broken = ways[name].broken(case)
    if broken is None:  # efforts of a rig that has none
        broken = ways[name].broken(rigs[RIGS["efforts"]])
    assert broken is not None
    said = said_of(broken, tmp_path / "case")
    assert re.search(ways[name].words, said, re.DOTALL), said


@pytest.mark.parametrize(
    ("group", "name"), [("models", "no load"), ("descriptions", "on a wall"), ("descriptions", "masses in lb")]
)
def test_slides_with_a_wrong_description_have_no_false_name(group: str, name: str, rigs: dict[str, Case]) -> None:
    way = GROUPS[group][0][name]
    broken = way.broken(rigs[SLIDES])
    assert broken is not None
    assert outcome(broken, way)[0] == "right"


@pytest.fixture(scope="module")
def known(rigs: dict[str, Case], tmp_path_factory: pytest.TempPathFactory) -> WrenchStream:
    """The wrench of the tables as they are."""
    folder = tmp_path_factory.mktemp("tables") / "whole"
    tables.tables_of(rigs[RIGS["tables"]]).write(folder)
    return open_recording(folder / tables.RECORDING).wrench()


@pytest.mark.parametrize(
    "name", [name for name, way in tables.WAYS.items() if way.harmless and name != "a rate 2 % too high"]
)
def test_a_table_is_read_as_programs_write_it(
    name: str, rigs: dict[str, Case], known: WrenchStream, tmp_path: Path
) -> None:
    broken = tables.WAYS[name].broken(rigs[RIGS["tables"]])
    assert broken is not None
    broken.write(tmp_path / "case")
    found = open_recording(tmp_path / "case" / tables.RECORDING).wrench()
    since, rounding = (1_700_000_000 * 10**9, 1000) if name == "times of day" else (0, 0)  # ns
    rows = np.searchsorted(found.stamps, known.stamps + since - rounding)
    assert np.abs(found.stamps[rows] - known.stamps - since).max() <= rounding
    close = 1e-3 if name == "three decimals" else 1e-12
    np.testing.assert_allclose(found.wrench_in_sensor[rows], known.wrench_in_sensor, atol=close)
