"""Results of an evaluation: rows, duplicates, errors against the truth, outliers, and changes with time."""

import csv
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.evaluation import RECORDINGS, ResultRow, add_truths, changes, error_lines, outliers, rows_of, write_tables
from poise.evaluation.patterns import change_point
from poise.viewing import write_evaluation_report

DAY = 86400.0
APRIL = datetime(2026, 4, 1, tzinfo=UTC).timestamp()
FRICTION = "effects.viscous_friction.parameters.joint_3.value"


def entry(name: str, answer: dict | None = None, **more: object) -> dict:
    return {"name": name, "size": 1, "modified": APRIL, "answer": answer, "error": None} | more


def row(name: str, value: float, day: float = 0.0, group: str = "", column: str = "mass") -> ResultRow:
    return ResultRow(name, group, APRIL + day * DAY, None, {column: value})


def fleet(seed: int, doubled: bool) -> list[ResultRow]:
    """Ten robots, a recording on each of 60 days; the friction of robot 7 may double in May."""
    rng = np.random.default_rng(seed)
    rows = []
    for robot in range(10):
        for day in range(60):
            friction = (2.0 if doubled and robot == 7 and day >= 33 else 1.0) + rng.normal(0, 0.1)
            rows.append(row(f"robot_{robot}/{day:02}.mcap", friction, day, f"robot_{robot}", FRICTION))
    return rows


def test_a_row_has_the_numbers_and_words_of_an_answer_by_their_path() -> None:
    answer = {
        "mass": 1.5,
        "com": [0.0, 0.1, None],
        "covariance": [[1.0]],
        "method": "poise",
        "consistent": True,
        "findings": [{"name": "POOR_FIT", "code": 70}, {"name": "CLIPPED", "code": 78}],
        "effects": [{"name": "hose", "probability": 0.9, "parameters": {"stiffness": {"value": 3.0, "std": 0.1}}}],
        "queries": [{"robustness": 2.5, "moves": ["a", "b"]}],
    }
    (only,) = rows_of([entry("a", answer)], {"a": "robot_1"})
    assert only.group == "robot_1"
    assert only.cells == {
        "mass": 1.5,
        "com.0": 0.0,
        "com.1": 0.1,
        "method": "poise",
        "consistent": True,
        "findings": "clipped, poor_fit",
        "effects": "hose",
        "effects.hose.probability": 0.9,
        "effects.hose.parameters.stiffness.value": 3.0,
        "effects.hose.parameters.stiffness.std": 0.1,
        "queries.0.robustness": 2.5,
        "queries.0.moves": "a, b",
    }


def test_the_last_reply_counts_and_equal_content_counts_once() -> None:
    entries = [entry("b", {"mass": 1.0}, sha256="x"), entry("a", {"mass": 2.0}, sha256="x")]
    first, second = rows_of([*entries, entry("b", {"mass": 3.0}, sha256="x")], {})
    assert (first.name, second.name) == ("a", "b")
    assert second.duplicate_of == "a"
    assert second.cells["mass"] == 3.0
    assert first.counts
    assert not second.counts


def test_the_stamp_of_a_recording_is_its_time_and_that_of_a_simulation_is_not() -> None:
    (real, simulated) = rows_of([entry("a", {}, stamp=APRIL + DAY), entry("b", {}, stamp=12.5)], {})
    assert real.date == "2026-04-02T00:00:00+00:00"
    assert simulated.time == APRIL


def test_truth_files_give_errors_with_coverage_and_the_share_of_equal_words(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    rows = []
    for number in range(200):
        error = rng.normal(0, 0.1)
        name = str(tmp_path / f"run_{number}.mcap")
        cells = {"mass": 2.0 + error, "mass_std": 0.1, "effects": "hose" if number % 4 else "slip"}
        rows.append(ResultRow(name, "", APRIL, None, cells))
        (tmp_path / f"run_{number}.truth.yaml").write_text("mass: 2.0\neffects: [hose]\nunknown: 1\n")
    add_truths(rows, RECORDINGS)
    mass, effects = error_lines(rows)
    assert mass.count == 200
    assert abs(mass.bias) < 3 * 0.1 / np.sqrt(200)
    assert mass.rms == pytest.approx(0.1, rel=0.15)
    assert 0.91 <= mass.covered <= 0.99
    assert effects.agreeing == 0.75
    (tmp_path / "run_0.truth.yaml").write_text("just words")
    with pytest.raises(InputError) as caught:
        add_truths(rows, RECORDINGS)
    assert caught.value.code is ErrorCode.FILE_CORRUPT


def test_an_outlier_is_found_with_the_field_and_the_farthest_comes_first() -> None:
    rng = np.random.default_rng(0)
    rows = [row(f"{number:03}", value) for number, value in enumerate(rng.normal(5.0, 0.1, 200))]
    rows[17].cells["mass"], rows[40].cells["mass"] = 7.0, 6.0
    found = outliers(rows, ["mass"])
    assert [each.row.name for each in found[:2]] == ["017", "040"]
    assert found[0].usual == pytest.approx(5.0, abs=0.05)
    assert len(found) <= 4  # of 198 normal values
    assert not outliers([row(str(number), 1.0) for number in range(50)], ["mass"])
    assert not outliers(rows[15:20], ["mass"])  # too few to say


def test_a_friction_that_doubled_in_may_is_the_only_change_and_has_its_date() -> None:
    (change,) = changes(fleet(1, doubled=True), [FRICTION])
    assert change.group == "robot_7"
    assert change.before == pytest.approx(1.0, abs=0.1)
    assert change.after == pytest.approx(2.0, abs=0.1)
    assert change.rows[change.index].date[:10] == "2026-05-04"
    assert "robot_7: " in change.sentence
    assert "between 2026-05-03 and 2026-05-04" in change.sentence
    assert change.sentence.endswith(" times (33 recordings before, 27 after)")


def test_without_a_change_none_is_reported() -> None:
    reported = [len(changes(fleet(seed, doubled=False), [FRICTION])) for seed in range(40)]
    assert sum(reported) <= 2  # of 400 series


def test_an_effect_that_is_found_from_some_day_on_is_a_change_from_zero() -> None:
    rows = [row(f"{day:02}", 2.0 + 0.01 * day, day, "r", FRICTION) for day in range(20)]
    for early in rows[:10]:
        early.cells.clear()
    (change,) = changes(rows, [FRICTION])
    assert (change.before, change.index) == (0.0, 10)


def test_the_change_point_is_found_in_few_and_in_many_values_and_not_made_by_outliers() -> None:
    rng = np.random.default_rng(5)
    few = np.concatenate([rng.normal(1.0, 0.05, 9), rng.normal(2.0, 0.05, 7)])
    index, probability = change_point(few)
    assert index == 9
    assert probability < 1e-4
    many = np.concatenate([rng.normal(0.0, 1.0, 6000), rng.normal(1.5, 1.0, 4000)])
    assert abs(change_point(many)[0] - 6000) <= 100  # blocks of 50
    few[:9], few[2] = few[9], 40.0
    few[9:] += rng.normal(0.0, 0.05, 7)
    assert change_point(few)[1] > 1e-3
    assert change_point(np.array([1.0] * 5 + [2.0] * 5)) == (5, 0.0)


@pytest.mark.parametrize("kind", ["normal", "heavy tails", "skewed"])
def test_chance_alone_makes_few_changes(kind: str) -> None:
    rng = np.random.default_rng(9)
    draw = {
        "normal": lambda: rng.normal(size=20),
        "heavy tails": lambda: rng.standard_t(2, size=20),
        "skewed": lambda: rng.lognormal(size=20),
    }[kind]
    found = [change_point(draw())[1] for _ in range(150)]
    assert np.mean(np.array(found) < 0.05) <= 0.08


def test_tables_hold_every_row_and_no_formula_for_spreadsheets(tmp_path: Path) -> None:
    rows = [
        row("a", 1.25),
        row("b", 2.0),
        ResultRow("c", "", APRIL, {"name": "EMPTY", "message": "=1+1"}, {"word": "=2+2"}),
    ]
    written = write_tables(tmp_path, rows)
    with written[0].open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["mass"] for line in lines] == ["1.25", "2.0", ""]
    assert lines[2]["word"] == "'=2+2"
    assert lines[2]["message"] == "'=1+1"
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(written[1]).to_pydict()
    assert table["name"] == ["a", "b", "c"]
    assert table["mass"] == [1.25, 2.0, None]


def test_the_page_shows_changes_then_outliers_then_distributions_and_failures(tmp_path: Path) -> None:
    rows = fleet(2, doubled=True)
    rows.append(ResultRow("robot_3/<b>.mcap", "robot_3", APRIL, {"name": "EMPTY", "message": "no <i>messages</i>"}, {}))
    rows[5].cells[FRICTION] = 9.0
    found, changed = outliers(rows, [FRICTION]), changes(rows, [FRICTION])
    path = write_evaluation_report(tmp_path, "mismatch", rows, [FRICTION], found, changed, [], command="x")
    text = path.read_text()
    assert text.index("What changed with time") < text.index("Outliers") < text.index("Distributions")
    assert text.index("Distributions") < text.index("Without an answer")
    assert "600 of 601 answered" in text
    assert "<b>" not in text
    assert "robot_3/&lt;b&gt;.mcap" in text
