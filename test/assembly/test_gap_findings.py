"""Neighbours that count as touching across a gap are named where other contacts show that poses are exact."""

import assembly_scenes as scenes
import numpy as np
import pytest
from typer.testing import CliRunner

from poise.assembly import Analysis, Push, assess, write_scene
from poise.assembly.robustness import gap_findings
from poise.cli import app


def books(gap, lift=0.0):
    """Two thin slabs beside each other on the floor, `gap` m apart, `lift` m over it."""
    slabs = [scenes.box(f"book{i}", (0.02, 0.2, 0.2), (i * (0.02 + gap), 0, 0.1 + lift)) for i in range(2)]
    return scenes.on_floor(*slabs)


@pytest.mark.parametrize(("gap", "lift", "named"), [(1e-3, 0, True), (1e-4, 0, False), (1e-3, 1e-3, False)])
def test_gaps_are_named_where_other_contacts_are_closed(gap, lift, named):
    """A scan has gaps everywhere, and what rests there touches."""
    found = gap_findings(Analysis.of(books(gap, lift)))
    assert [each.evidence for each in found] == ([{"pairs": 1.0, "gap": pytest.approx(gap)}] if named else [])
    assert not named or "book0 and book1 (1.00 mm)" in found[0].sentence


def test_with_less_that_counts_as_touching_a_book_topples_alone():
    push = Push("book0", (-0.01, 0, 0.2), (1, 0, 0))
    alone = 9.81 * 0.01 / 0.2
    assert assess(Analysis.of(books(1e-3)), [push]).results[0].lower > 1.9 * alone
    finer = Analysis.of(books(1e-3), margin=2e-4)
    assert assess(finer, [push]).results[0].robustness == pytest.approx(alone, rel=1e-3)
    assert not gap_findings(finer)


def test_commands_take_what_counts_as_touching(tmp_path):
    path = tmp_path / "books.yaml"
    write_scene(books(1e-3), path)
    least = []
    for touching in ("0.0015", "0.0002"):
        run = CliRunner().invoke(
            app, ["msa", str(path), "--directions", "4", "--no-turning", "--touching", touching, "--json", "-"]
        )
        assert run.exit_code == 0, run.output
        assert ("count as touching across gaps" in run.output) == (touching == "0.0015")
        least.append(run.stdout)
    assert np.unique(least).size == 2
