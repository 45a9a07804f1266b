"""A solve that fails drops its candidate, never the search: faults are injected where solvers are called."""

import json

import pytest

from benchmarks.placement import scenes
from poise.assembly.statics.pair_program import PairProgram
from poise.cli import run as poise
from poise.errors import ErrorCode, NoAnswerError
from poise.placement import Options, plan_placement, plan_sequence


@pytest.fixture
def faults(monkeypatch):
    """Let the calls of the kernel of some numbers fail; counts calls, and those that failed."""

    def inject(first: int, last: int) -> list[int]:
        solve, calls = PairProgram.solve_all, [0, 0]

        def failing(self, *arguments):
            calls[0] += 1
            if first <= calls[0] < last:
                calls[1] += 1
                raise NoAnswerError(ErrorCode.SOLVER_FAILED, "injected")
            return solve(self, *arguments)

        monkeypatch.setattr(PairProgram, "solve_all", failing)
        return calls

    return inject


@pytest.mark.parametrize(("first", "last", "refining"), [(2, 6, False), (10, 30, True), (50, 1000, True)])
def test_placements_are_found_although_solves_fail(faults, first, last, refining):
    calls = faults(first, last)
    found = plan_placement(scenes.scene("cube"), scenes.cube(), Options(on="objects", refining=refining), 1)
    assert calls[1] > 0
    assert found.item.id in found.analysis.assembly.index


def test_a_sequence_goes_on_although_solves_fail(faults):
    calls = faults(3, 9)
    found = plan_sequence(scenes.scene("cube"), [scenes.glued(name) for name in "ad"], Options(candidates=2), 1)
    assert calls[1] > 0
    assert len(found.placements) == 2


def test_a_robustness_that_no_solver_certifies_is_null_and_the_placement_is_given(monkeypatch, tmp_path, capsys):
    def failing(*_):
        raise NoAnswerError(ErrorCode.SOLVER_FAILED, "injected")

    monkeypatch.setattr("poise.placement.planner.evaluate", failing)
    target = tmp_path / "answer.json"
    item = "{id: a, box: [0.05, 0.05, 0.05], mass: 0.1}"
    assert poise(["place", str(scenes.FOLDER / "cube.yaml"), "--object", item, "--json", str(target)]) == 0
    answer = json.loads(target.read_text())
    assert len(answer["pose"]) == 7
    assert answer["robustness"] is None
    assert "no solver certifies it" in capsys.readouterr().out
