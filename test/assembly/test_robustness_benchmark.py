"""A fast slice of benchmarks/robustness.py: its truth, its bowl, and who is how exact."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # not installed
import robustness as benchmark
import robustness_truth as truth

from poise.assembly import Analysis, Push, assess, robustness_map
from poise.assembly.contact.surface import sample_surface


def pushes_on(scene, count):
    analysis = Analysis.of(benchmark.MAPPED[scene]())
    return analysis, benchmark.surface_pushes(analysis, count)


def test_the_truth_knows_the_closed_forms():
    cube = truth.SCENES["cube"]
    weight, x = 9.81, np.array([1.0, 0, 0])
    assert cube.robustness(0, np.array([-0.5, 0, 0.1]), x) == pytest.approx(0.5 * weight, rel=1e-6)
    assert cube.robustness(0, np.array([-0.5, 0, 1.0]), x) == pytest.approx(0.5 * weight, rel=1e-6)
    assert cube.robustness(0, np.array([0.1, 0, 1.0]), np.array([0, 0, -1.0])) == np.inf
    assert cube.robustness(0, np.array([0.0, 0.4, 0]), x) < 0.4 * weight
    # Both legs turn about their far feet by a, the slab goes along: F 1 a = W (0.1 + 0.1 + 0.2) a.
    table = truth.SCENES["table"]
    assert table.robustness(2, np.array([-1.0, 0, 1.1]), x) == pytest.approx(0.4 * weight, rel=1e-5)


@pytest.mark.parametrize("scene", ["cube", "stack3"])
def test_the_default_is_within_two_per_cent_of_the_truth_and_ten_times_nearer_than_the_baselines(scene):
    analysis, pushes = pushes_on(scene, 60)
    true = benchmark.true_robustness(scene, analysis, pushes)
    errors = {}
    for model in ("default", "thesis", "approx", "lp8"):
        found = np.array([result.robustness for result in assess(analysis, pushes, model).results])
        both = np.isfinite(found) & np.isfinite(true)
        errors[model] = np.abs(found[both] / true[both] - 1)
        if model == "default":
            assert np.array_equal(np.isfinite(found), np.isfinite(true))
    assert errors["default"].max() < 0.025
    assert all(errors[model].mean() > 10 * errors["default"].mean() for model in ("thesis", "approx", "lp8"))


def test_a_bowl_is_mapped_without_programs_to_half_a_per_cent():
    analysis = Analysis.of(benchmark.bowl())
    surface = sample_surface(analysis.structure, 600)
    found = robustness_map(analysis, surface)
    assert found.complete
    assert found.solves < 0.02 * len(found.lower)
    picked = range(0, len(found.lower), 25)
    pushes = [Push("bowl", surface.points[i], surface.directions[i]) for i in picked]
    exact = np.array([result.robustness for result in assess(analysis, pushes).results])
    assert np.all(found.lower[picked] <= exact * (1 + 1e-6))
    assert np.all(exact <= found.upper[picked] * (1 + 1e-6))
    finite = np.isfinite(exact)
    assert np.mean(found.upper[picked][finite] / exact[finite] - 1) < 0.005
