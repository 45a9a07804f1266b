"""`poise identify` where no payload explains the wrench: the cause is named, the number withheld or repaired."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from poise.commands.output import finding_json
from poise.errors import NoAnswerError
from poise.inertia.model import EstimateFinding
from poise.inertia.pipeline import Identification, recorded_gravity
from poise.inertia.verdict import FitSamples, FitVerdict
from poise.recording import Recording, open_recording, rewrite_recording
from poise.weighing import (
    Cause,
    after_repair,
    causes_of,
    find_causes,
    findings_of,
    is_withheld,
    named_and_possible,
    repaired_wrench,
    with_causes,
    without_numbers,
)

RepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Where the wrench has an error whose cause is certain (axes, sign, unit, clock, clipping, compensation),"
        " correct it and weigh again; the answer says so.",
    ),
]

Known = tuple[str | None, float | None, str]
"""Sensor frame, gravity in m/s2 and topic of the wrench, as given."""

Weigh = Callable[[Path, float | None], tuple[Recording, Identification]]
"""Weighs a recording with gravity in m/s2; None: that of the recording."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """What came of a weighing.

    Args:
        recording: as it was recorded.
        answer: None when there is none; withheld numbers are NaN.
        findings: of an answer that there is not; those of an answer are in it.
        failure: the reason why there are no numbers; None: there are.
    """

    recording: Recording
    answer: Identification | None
    findings: Sequence[EstimateFinding] = ()
    failure: NoAnswerError | None = None


def weighed_with_causes(weigh: Weigh, bag: Path, known: Known, repair: bool) -> Weighed:
    """Weigh, and where no payload explains the wrench, find the cause; with `repair`, correct one that is certain.

    Raises:
        InputError, NoAnswerError: as `weigh`; without an answer only where no cause is found.
    """
    _, gravity, wrench_topic = known
    try:
        recording, answer = weigh(bag, gravity)
    except NoAnswerError as error:
        samples = error.data.get("samples")
        causes = find_causes(samples) if isinstance(samples, FitSamples) else ()
        if not isinstance(samples, FitSamples) or not causes:
            raise
        recording = open_recording(bag)
        repaired = _repaired(weigh, recording, samples, wrench_topic, gravity, causes) if repair else None
        failure = NoAnswerError(causes[0].code, f"{error.message}; likely cause: {causes[0].sentence}")
        return repaired or Weighed(recording, None, findings_of(causes), failure)
    estimate = answer.estimate
    causes, possible = named_and_possible(estimate)
    if repair and causes and estimate.samples is not None:
        repaired = _repaired(weigh, recording, estimate.samples, wrench_topic, gravity, causes)
        if repaired is not None:
            return repaired
    estimate = with_causes(estimate, causes, possible)
    if not is_withheld(answer.estimate, causes):
        return Weighed(recording, replace(answer, estimate=estimate))
    first = estimate.findings[0]
    failure = NoAnswerError(first.code, f"{bag}: the payload is not given, because it would be wrong: {first.message}")
    return Weighed(recording, replace(answer, estimate=without_numbers(estimate)), (), failure)


def _repaired(
    weigh: Weigh,
    recording: Recording,
    samples: FitSamples,
    topic: str,
    gravity: float | None,
    causes: Sequence[Cause],
) -> Weighed | None:
    """The answer after the repair of the likeliest cause; None where that is not certain, or the fit stays poor."""
    cause = causes[0]
    if not cause.certain or cause.repair is None:
        return None
    wrench = recording.wrench(topic, next(iter(recording.wrench_frames(topic))))
    with tempfile.TemporaryDirectory(prefix="poise-repair-") as folder:
        path = Path(folder) / f"{Path(recording.path).stem}.mcap"
        rewrite_recording(recording, path, {topic: repaired_wrench(wrench, samples, cause.repair)})
        known = recorded_gravity(recording) if gravity is None else gravity
        try:
            _, answer = weigh(path, known * cause.repair.gravity)
        except NoAnswerError:
            return None
    if not answer.estimate.fit.passed or causes_of(answer.estimate):
        return None
    return Weighed(recording, replace(answer, estimate=after_repair(answer.estimate, cause)))


def findings_json(findings: Sequence[EstimateFinding]) -> list[dict[str, Any]]:
    """One entry for each."""
    return [finding_json(each.code, each.message, each.evidence) for each in findings]


def fit_json(fit: FitVerdict) -> dict[str, Any]:
    """The tests of a fit, and what they could not see."""
    return {
        "passed": fit.passed,
        "withheld": fit.is_hopeless,
        "tests": [
            {"name": test.name, "value": test.value, "limit": test.limit, "passed": test.passed} for test in fit.tests
        ],
        "cannot_exclude": fit.cannot_exclude,
    }


def fit_words(fit: FitVerdict) -> str:
    """The verdict, and what the motion could not exclude."""
    verdict = "passes all tests" if fit.passed else f"fails {', '.join(test.name for test in fit.failed)}"
    unseen = "; ".join(fit.cannot_exclude)
    return verdict + (f"; this motion cannot exclude {unseen}" if unseen else "")


def no_answer_json(bag: Path, weighed: Weighed) -> dict[str, Any]:
    """The JSON where there is no estimate."""
    names = ("mass", "com", "inertia", "covariance", "mass_std", "com_std", "inertia_std", "bias", "delay", "method")
    return {
        **dict.fromkeys(names),
        "findings": findings_json(weighed.findings),
        "bag": str(bag),
        "warnings": [finding.message for finding in weighed.findings],
    }
