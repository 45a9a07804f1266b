"""From trials to figures: what each method makes of each problem, and averages over objects and seeds."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field

import numpy as np

from benchmarks.identification.bounds import bounds
from benchmarks.identification.motions import wrist_motion
from benchmarks.identification.objects import BenchmarkObject
from benchmarks.identification.scenarios import Scenario, Trial, make_trial
from poise.errors import PoiseError
from poise.inertia.estimators.answer import Method
from poise.inertia.model.metrics import effort_error, errors
from poise.inertia.model.parameters import InertialParameters
from poise.inertia.model.solution import InertialSolution
from poise.robot import SensorMotion
from poise.types import Array

# An unseen motion, along which predicted torques are compared (thesis fig. 3.8).
EFFORT_SPEED = 2.0  # rad/s
# Of standard deviations: half the width of a 95 % interval.
TWO_SIDED_95 = 1.959964


@dataclass(frozen=True)
class Experiment:
    """A table.

    Args:
        key: for file names.
        title: above the table.
        subjects: what is weighed.
        scenarios: one block of the table each.
        methods: by the name in the table.
    """

    key: str
    title: str
    subjects: tuple[BenchmarkObject, ...]
    scenarios: tuple[Scenario, ...]
    methods: dict[str, Method]


@dataclass(frozen=True)
class Record:
    """What one method made of one trial; NaN where it says nothing, `failure` where it gave no answer.

    Args:
        mass, com, inertia, riemannian: e_m, e_c, e_I in %, e_Rie.
        consistent: physically.
        effort: error of predicted torques along an unseen motion, %.
        seconds: it took.
        nees: squared error of phi in units of its covariance; 10 on average when that is honest.
        covered: how many of the ten parameters lie in their 95 % intervals, as a share.
        delay_error: s.
        failure: the error's sentence.
    """

    method: str
    scenario: str
    subject: str
    seed: int
    mass: float = math.nan
    com: float = math.nan
    inertia: float = math.nan
    riemannian: float = math.nan
    consistent: bool = False
    effort: float = math.nan
    seconds: float = math.nan
    nees: float = math.nan
    covered: float = math.nan
    delay_error: float = math.nan
    failure: str = ""


@dataclass(frozen=True)
class Summary:
    """Means over the trials that a method answered (the median of times).

    Args:
        riemannian: NaN unless all answers are consistent, for only then is it defined.
        consistent: % of answers.
        answered: % of trials.
        details: all records.
    """

    mass: float
    com: float
    inertia: float
    riemannian: float
    consistent: float
    effort: float
    milliseconds: float
    nees: float
    covered: float
    delay_error: float
    answered: float
    details: list[Record] = field(repr=False)


def run(experiment: Experiment, seeds: Iterable[int], advance: Callable[[], None]) -> Iterator[Record]:
    """Every method on every trial; `advance` is called after each trial."""
    warm_up(experiment)
    effort_motion = wrist_motion(np.random.default_rng(0), EFFORT_SPEED, np.arange(150) / 100)(np.arange(150) / 100)
    for seed in seeds:
        for scenario in experiment.scenarios:
            for subject in experiment.subjects:
                trial = make_trial(subject, scenario, seed)
                for name, method in experiment.methods.items():
                    yield record(name, method, trial, scenario, seed, effort_motion)
                for name, least in bounds(trial).items():
                    mass, com, inertia = least
                    yield Record(
                        name, scenario.name, subject.name, seed, mass=mass, com=com, inertia=inertia, consistent=True
                    )
                advance()


def warm_up(experiment: Experiment) -> None:
    """Load the libraries before the first timed call."""
    trial = make_trial(experiment.subjects[0], experiment.scenarios[0], 0)
    for method in experiment.methods.values():
        try:
            method(trial.problem)
        except PoiseError:
            continue


def record(
    name: str, method: Method, trial: Trial, scenario: Scenario, seed: int, effort_motion: SensorMotion
) -> Record:
    """One method on one trial."""
    subject = trial.subject
    start = time.perf_counter()
    try:
        solution = method(trial.problem)
    except PoiseError as error:
        return Record(name, scenario.name, subject.name, seed, failure=f"{error.code.name}: {error.message}")
    seconds = time.perf_counter() - start
    estimate = InertialParameters.from_phi(solution.phi)
    found = errors(estimate, subject.truth, subject.bounding_box)
    nees, covered = honesty(solution, subject.truth.phi)
    return Record(
        name,
        scenario.name,
        subject.name,
        seed,
        **asdict(found),
        effort=float(effort_error(estimate, subject.truth, effort_motion)[1]),
        seconds=seconds,
        nees=nees,
        covered=covered,
        delay_error=abs(getattr(solution, "delay", math.nan) - scenario.delay),
    )


def honesty(solution: InertialSolution, phi: Array) -> tuple[float, float]:
    """Normalised estimation error squared, and the share of parameters within their 95 % intervals."""
    if not np.all(np.isfinite(solution.covariance)):
        return math.nan, math.nan
    deviation = np.sqrt(np.diag(solution.covariance))
    error = (solution.phi - phi) / deviation
    correlation = solution.covariance / np.outer(deviation, deviation)
    nees = float(error @ np.linalg.pinv(correlation, hermitian=True, rcond=1e-10) @ error)
    return nees, float(np.mean(np.abs(error) < TWO_SIDED_95))


def summarise(records: Iterable[Record]) -> dict[tuple[str, str], Summary]:
    """Averages by (scenario, method), in the order of their first appearance."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for one in records:
        groups.setdefault((one.scenario, one.method), []).append(one)
    return {key: _summary(group) for key, group in groups.items()}


def _summary(group: list[Record]) -> Summary:
    answers = [one for one in group if not one.failure]

    def mean(name: str) -> float:
        values = [getattr(one, name) for one in answers]
        return float(np.mean(values)) if values else math.nan

    times = [one.seconds for one in answers]
    return Summary(
        **{name: mean(name) for name in ("mass", "com", "inertia", "riemannian", "effort", "nees", "covered")},
        consistent=100 * mean("consistent"),
        milliseconds=1e3 * float(np.median(times)) if times else math.nan,
        delay_error=mean("delay_error"),
        answered=100 * len(answers) / len(group),
        details=group,
    )
