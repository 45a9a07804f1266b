"""The report of a loop: the weights against the truth, what was skipped and why, and a page without a stack."""

from datetime import UTC, datetime

from poise.assembly import Analysis, Assembly, Box, RigidObject
from poise.geometry import Pose
from poise.viewing import loop_rows, loop_sentences, write_loop_report

WEIGHED = {"id": "object", "outcome": "placed", "why": "", "robustness": 0.25, "mass": 0.5, "mass_std": 0.001}
WEIGHED |= {"true_mass": 0.501, "mass_error": -0.002, "com_error": 4e-4, "within": True}
SKIPPED = {"id": "object_2", "outcome": "skipped", "why": "too wide <b>for the hand</b>", "robustness": None}
STEP = {"step": "pick", "object": "object_2", "seconds": 1.5, "code": 25, "name": "UNREACHABLE", "sentence": "too wide"}
CONTENT = {"complete": False, "sentence": "", "wanted": 2, "objects": [WEIGHED, SKIPPED], "steps": [STEP]}
CONTENT |= {"seconds": 60.0, "planning": 5.0, "restarts": {"object_picker": 1}, "error": None}
CONTENT |= {"carried": {"distance": 3.0, "seconds": 8.0, "used": 0.78, "limit": 2.5, "moved": 1e-4}}
NOW = datetime(2026, 1, 2, tzinfo=UTC)


def plate(name: str, z: float, **more: object) -> RigidObject:
    return RigidObject(name, Box((0.2, 0.2, 0.1)), Pose.from_vector([0, 0, z, 0, 0, 0, 1]), **more)


def test_rows_and_sentences_say_what_was_found_and_what_was_not() -> None:
    first, second = loop_rows(CONTENT)
    assert first[2:] == ["0.5000 ± 0.0010", "0.5010", "-0.20", "0.40", "yes", "0.25"]
    assert second == ["object_2", "skipped", "", "", "", "", "", ""]
    said = " ".join(loop_sentences(CONTENT))
    for part in ("too wide", "carried 3.00 m in 8.0 s with at most 78 %", "at most 0.10 mm", "object_picker 1 x"):
        assert part.replace("78 %", "78%") in said


def test_the_page_shows_the_stack_and_escapes_what_comes_from_outside(tmp_path) -> None:
    stack = Analysis.of(Assembly((plate("tray", 0.0, fixed=True), plate("object", 0.1, mass=0.5)), friction=0.5))
    page = write_loop_report(tmp_path, CONTENT, stack, command="poise loop", now=NOW).read_text()
    assert page.count("<svg") == 2
    assert "<b>for" not in page
    assert "UNREACHABLE: too wide" in page
    assert "Not all objects were weighed and placed" in page
    empty = write_loop_report(tmp_path, CONTENT, None, command="poise loop", now=NOW).read_text()
    assert "<svg" not in empty
