"""What of a concealed effect can be seen at all is measured with the true effect as the whole library."""

import json
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the benchmark's engine is an extra: pip install '.[sim]'")

from benchmarks.concealed.case import Plan, make_case
from benchmarks.concealed.visible import NEEDED, evidence, named


@pytest.mark.parametrize(("kind", "truth", "seen"), [("single", ("mass_step",), True), ("null", (), False)])
def test_a_load_that_fell_off_is_seen_where_it_did(
    kind: str, truth: tuple[str, ...], seen: bool, tmp_path: Path
) -> None:
    make_case(Plan(kind, truth, 1.0, False, (77, 3))).write(tmp_path, "case_0001")
    assert (evidence(tmp_path, "case_0001", ["mass_step"]) > NEEDED) == seen


def test_an_answer_is_listed_by_its_names_or_its_verdict(tmp_path: Path) -> None:
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "case_0001.json").write_text(json.dumps({"verdict": "named", "effects": [{"name": "cable"}]}))
    (answers / "case_0002.json").write_text(json.dumps({"verdict": "none", "effects": []}))
    assert [named(tmp_path, f"case_000{i}") for i in (1, 2, 3)] == ["cable", "none", "-"]
