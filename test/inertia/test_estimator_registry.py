"""Contract of the registry: every estimator keeps what its entry declares."""

import re
from pathlib import Path

import numpy as np
import pytest
from composites import composite, measured, without_shape

from poise.errors import ErrorCode, InputError
from poise.inertia.estimators import SampleEvidence, SampleWindow, all_estimators, answer, method_choices
from poise.inertia.estimators.streaming import Prior
from poise.inertia.model import InertialSolution, NoiseLevels
from poise.robot import SensorMotion

PAGE = Path(__file__).resolve().parents[2] / "docs" / "add_an_estimator.md"
ENTRIES = all_estimators().values()


def still(count: int = 120) -> tuple[SensorMotion, np.ndarray, object]:
    """Held poses of a composite body, in random attitudes."""
    rng = np.random.default_rng(5)
    held = composite(rng)
    problem = measured(rng, held.phi, samples=count, parts=held.parts)
    attitudes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    attitudes[np.linalg.det(attitudes) < 0] *= -1
    motion = SensorMotion.at_rest(problem.stamps, attitudes)
    gravity = motion.gravity_in_sensor()
    wrench = np.hstack([held.phi[0] * gravity, np.cross(held.phi[1:4], gravity)])
    return motion, wrench + rng.normal(size=wrench.shape) * np.repeat([0.05, 0.002], 3), held


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_a_name_a_summary_and_a_file_of_that_name(entry) -> None:
    assert re.fullmatch(r"[a-z][a-z0-9_]*", entry.name)
    assert entry.name in method_choices()
    assert 10 < len(entry.summary) < 120


@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if entry.needs_shape], ids=lambda entry: entry.name)
def test_one_that_needs_a_shape_refuses_to_do_without(entry) -> None:
    rng = np.random.default_rng(5)
    with pytest.raises(InputError) as caught:
        entry.estimate(without_shape(measured(rng, composite(rng).phi)))
    assert caught.value.code is ErrorCode.UNSUPPORTED


@pytest.mark.parametrize(
    "entry", [entry for entry in ENTRIES if not entry.needs_every_parameter], ids=lambda entry: entry.name
)
def test_the_streaming_form_weighs_in_any_portions(entry) -> None:
    motion, wrench, held = still()
    evidence = SampleEvidence(NoiseLevels(), solution_of_ols(motion, wrench))
    answers = []
    for portions in (1, 7):
        stream = entry.stream(Prior(parts=held.parts))
        for part in np.array_split(np.arange(len(wrench)), portions):
            stream.add(motion.select(part), wrench[part])
        answers.append(stream.solve(evidence))
    one, other = answers
    assert one.phi[0] == pytest.approx(held.phi[0], rel=0.05)
    np.testing.assert_allclose(one.phi, other.phi, atol=1e-9)
    if entry.gives_covariance:
        assert np.isfinite(one.covariance[0, 0])


def solution_of_ols(motion: SensorMotion, wrench: np.ndarray) -> InertialSolution:
    """Weighted least squares of the samples, as the pipeline gives them to every estimator."""
    from poise.inertia.estimators import InformationAccumulator, model_matrix, solve

    sums = InformationAccumulator()
    sums.add(model_matrix(motion, np.array([0.0, 0.0, -9.80665])), wrench)
    return solve(sums)


def test_the_example_of_the_page_is_an_estimator() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    content: dict[str, object] = {}
    exec(compile(code, str(PAGE), "exec"), content)  # noqa: S102
    entry = content["ENTRY"]
    motion, wrench, held = still()
    stream = entry.stream(Prior())
    stream.add(motion, wrench)
    assert isinstance(stream, SampleWindow)
    assert callable(answer)
    assert stream.solve(SampleEvidence(NoiseLevels(), None)).phi[0] == pytest.approx(held.phi[0], rel=0.05)
