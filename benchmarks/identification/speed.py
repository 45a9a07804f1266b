"""How long one answer takes on one core: `python -m benchmarks.identification.speed`; run it on a machine at rest."""

import functools
import time
from collections.abc import Callable

import numpy as np

from benchmarks.identification.objects import load_tools
from benchmarks.identification.scenarios import Scenario, make_trial
from poise.inertia.bayes.estimator import PoiseEstimator
from poise.inertia.estimators.registry import method
from poise.inertia.model.parts import Parts
from poise.inertia.model.problem import IdentificationProblem

REPEATS = 7
METHODS = ("poise", "geo", "pmd", "rtls", "ols")


def milliseconds(call: Callable[[], object]) -> float:
    """CPU time, the median of several runs after one that warms up."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        call()
        times.append(1e3 * (time.process_time() - start))
    return float(np.median(times))


def per_sample(problem: IdentificationProblem) -> float:
    """Microseconds to add one sample, with the checks and sums of all that were added: ten times the problem's."""
    span = int(problem.stamps[-1] - problem.stamps[0]) + 10_000_000
    parts = Parts(problem.unit_parts, problem.part_volumes, problem.shape_points)  # type: ignore[arg-type]

    def add_all() -> None:
        estimator = PoiseEstimator(parts, problem.noise)
        for number in range(10 * len(problem)):
            turn, row = divmod(number, len(problem))
            estimator.add(
                problem.stamps[row] + turn * span,
                problem.gravity_in_sensor[row],
                problem.linear_acceleration[row],
                problem.angular_velocity[row],
                problem.angular_acceleration[row],
                problem.wrench[row],
            )

    return 1e3 * milliseconds(add_all) / (10 * len(problem))


def main() -> None:
    problems = [make_trial(tool, Scenario("1.5 rad/s", 1.5), 0).problem for tool in load_tools()]
    for name in METHODS:
        times = [milliseconds(functools.partial(method(name), problem)) for problem in problems]
        spread = f"{min(times):.2f} to {max(times):.2f}"
        print(f"{name}: {np.median(times):.2f} ms for 150 samples (median over the tools; {spread})")
    updates = [per_sample(problem) for problem in problems[:5]]
    print(f"poise, recursive update: {np.median(updates):.1f} us per sample")


if __name__ == "__main__":
    main()
