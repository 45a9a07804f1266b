"""The report of a diagnosis: it is self-contained, states the verdict, and its numbers are those of the diagnosis."""

import json
import re
import sys
from dataclasses import replace
from datetime import UTC, datetime
from unittest.mock import Mock

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.mismatch.answer import diagnose
from poise.mismatch.effects import effect_named
from poise.mismatch.reading import NominalModel, recorded_from_motion
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory
from poise.viewing.mismatch_report import write_mismatch_report
from poise.viewing.mismatch_summary import ladder, residuals
from poise.viewing.page import render_page

NOW = datetime(2026, 1, 1, tzinfo=UTC)
SIGMA = np.repeat([0.1, 0.005], 3)


@pytest.fixture(scope="module")
def found():
    """An arm with 2 kg on which something pushed from 6 to 7 s, held against a library of three."""
    robot = RobotModel.from_file("ridgeback_ur10")
    seconds = np.arange(0.0, 14.0, 0.01)
    motion = FourierTrajectory.random(robot, np.random.default_rng(2), duration=14.0, speed=0.3)
    phi = InertialParameters(2.0, np.array([0.0, 0.01, 0.1]), 0.01 * np.eye(3)).phi
    recorded = recorded_from_motion(robot, seconds, motion.at(seconds), phi)
    contact, rng = effect_named("contact"), np.random.default_rng(1)
    values = {"start": 6.0, "length": 1.0, "knots": 7.0, "x": 0.0, "y": 0.0, "z": 0.15}
    values |= {f"force_{axis}_{k}": 0.0 for axis in "xyz" for k in range(15)}
    values |= {f"force_x_{k}": -6.0 * np.sin(np.pi * (k + 1) / 8) for k in range(7)}
    wrench = recorded.prediction + contact.simulate(recorded, values) + rng.normal(size=(len(seconds), 6)) * SIGMA
    model = NominalModel(sensor_frame="ft_sensor", phi=phi)
    library = [effect_named(name) for name in ("contact", "bias_drift", "flywheel")]
    return diagnose(replace(recorded, wrench=wrench), model, None, library)


@pytest.fixture(scope="module")
def page(found, tmp_path_factory):
    path = write_mismatch_report(
        tmp_path_factory.mktemp("report"),
        found,
        "<b>run</b> 1",
        ["run.mcap"],
        notes=("3 spikes",),
        command="c",
        now=NOW,
    )
    return path.read_text(encoding="utf-8")


def test_the_page_says_the_verdict_and_when(found, page):
    assert found.verdict == "named"
    (finding,) = found.findings
    assert finding.sentence in page
    assert "Contact</span>" in page
    assert "3 spikes" in page
    start, end = finding.windows[0]
    assert 5.4 < start < 6.1
    assert 6.9 < end < 7.6


def test_the_page_stands_on_its_own_and_trusts_nothing(page):
    assert "default-src 'none'" in page
    assert "&lt;b&gt;run&lt;/b&gt; 1" in page
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert not re.search(r"(?:src|href|url)\S*//", page)
    keys = re.findall(r'\bid="([^"]*)"', page)
    assert len(keys) == len(set(keys))


def test_the_numbers_in_the_page_are_the_diagnosis(found, page):
    data = json.loads(re.search(r'id="mismatch">(.*?)</script>', page, re.DOTALL)[1])
    assert data["verdict"] == found.verdict
    assert data["fit"]["holdout"]["augmented"] == pytest.approx(found.main.proof.augmented)
    assert data["effects"][0]["name"] == "contact"
    assert data["effects"][0]["parameters"]["peak_force"]["value"] == pytest.approx(6.0, rel=0.1)


def test_the_same_arguments_give_the_same_bytes(found, page, tmp_path):
    again = write_mismatch_report(
        tmp_path, found, "<b>run</b> 1", ["run.mcap"], notes=("3 spikes",), command="c", now=NOW
    )
    assert again.read_text(encoding="utf-8") == page


def test_before_and_after_differ_by_what_the_effect_says_and_only_in_its_window(found):
    left = residuals(found.main)
    said = left.before - left.after
    (finding,) = found.findings
    exact = finding.effect.simulate(found.main.problem.recorded, finding.values)
    np.testing.assert_allclose(said, exact, atol=1e-9)
    size = left.size(left.before)
    assert size[(left.seconds > 6.2) & (left.seconds < 6.8)].min() > 3.0
    assert np.median(size[(left.seconds < 5.5) | (left.seconds > 7.5)]) == pytest.approx(1.0, abs=0.15)
    assert left.size(left.after).max() < 0.1 * size.max()


def test_the_ladder_has_the_answer_on_top_and_the_nominal_model_at_zero(found):
    rungs = ladder(found.main)
    (answer,) = [rung for rung in rungs if rung.answer]
    assert answer.label == "contact"
    assert answer.gain > 100.0
    assert [rung.gain for rung in rungs] == sorted((rung.gain for rung in rungs), reverse=True)
    assert {"nothing: the nominal model": 0.0}.items() <= {rung.label: rung.gain for rung in rungs}.items()


def test_impossible_hypotheses_are_not_drawn_and_many_names_are_told_by_their_difference(found):
    answer, rival = ("a", "b", "c", "d"), ("a", "b", "c", "e")
    best = replace(found.main.best, parts=[Mock(effect=Mock(), values={}) for _ in answer])
    for part, name in zip(best.parts, answer, strict=True):
        part.effect.name = name
    fits = {(): found.main.nominal, rival: best, answer[:3]: replace(best, log_evidence=-np.inf)}
    rungs = ladder(replace(found.main, best=best, search=replace(found.main.search, fits=fits, gains={})))
    assert {rung.label for rung in rungs} == {
        "the answer",
        "the answer without d, with e",
        "nothing: the nominal model",
    }
    assert all(np.isfinite(rung.gain) for rung in rungs)


def test_what_is_not_a_number_is_null():
    template = "mismatch.html.j2"
    empty = dict.fromkeys(("verdict", "sentence", "kicker"), "")
    lists = {name: [] for name in ("findings", "signals", "effects", "untestable")}
    made = render_page(
        template,
        title="t",
        provenance=[],
        data={"a": [float("nan"), 1.0]},
        data_id="mismatch",
        unknown=None,
        **empty,
        **lists,
    )
    assert '{"a": [null, 1.0]}' in made


def test_the_rerun_scene_holds_the_same_residuals(found, tmp_path):
    rrd = pytest.importorskip("rerun.chunk", reason="rerun-sdk is an extra")
    import pyarrow as pa

    from poise.viewing.mismatch_scene import write_mismatch_scene

    path = write_mismatch_scene(tmp_path / "mismatch.rrd", found)
    chunks = rrd.RrdReader(str(path)).stream().to_chunks()
    rows = {chunk.entity_path: pa.record_batch(chunk.to_record_batch()) for chunk in chunks if not chunk.is_static}
    assert {"/wrench/fx/before", "/wrench/fx/after", "/wrench/size/after", "/log"} <= set(rows)
    batch = rows["/wrench/tz/before"]
    column = batch.column(next(i for i, name in enumerate(batch.schema.names) if name.endswith(":scalars")))
    np.testing.assert_array_equal([row[0] for row in column.to_pylist()], residuals(found.main).before[:, 5])


def test_without_rerun_the_scene_says_how_to_get_it(found, tmp_path, monkeypatch):
    from poise.viewing.mismatch_scene import write_mismatch_scene

    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError) as raised:
        write_mismatch_scene(tmp_path / "mismatch.rrd", found)
    assert raised.value.code is ErrorCode.UNSUPPORTED
    assert not list(tmp_path.iterdir())
