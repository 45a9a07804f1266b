"""Convert a diagnosis to the message MismatchReport."""

from poise.errors import PoiseError
from poise.mismatch.answer import Diagnosis, NamedEffect
from poise.nodes.estimate_message import time_message
from poise.nodes.runtime import to_message
from poise_msgs.msg import EffectFinding, MismatchReport

_VERDICTS = {
    "none": MismatchReport.VERDICT_NONE,
    "named": MismatchReport.VERDICT_NAMED,
    "unknown": MismatchReport.VERDICT_UNKNOWN,
    "mixed": MismatchReport.VERDICT_MIXED,
}


def report_message(found: Diagnosis, start: int, newest: int, frame_id: str) -> MismatchReport:
    """Convert a diagnosis to a message.

    Args:
        found: the diagnosis.
        start: ns, what its seconds count from.
        newest: ns, stamp of the last wrench in it.
        frame_id: the sensor frame.
    """
    message = MismatchReport(verdict=_VERDICTS[found.verdict])
    message.header.stamp, message.header.frame_id = time_message(newest), frame_id
    message.effects = [_finding_message(finding, start) for finding in found.findings]
    if found.unknown is not None:
        message.unknown_depends_on = ", ".join(found.unknown.depends_on)
        message.unknown_sentence = found.unknown.sentence
    message.holdout_nominal, message.holdout_augmented = found.main.proof.nominal, found.main.proof.augmented
    return message


def no_report_message(error: PoiseError, newest: int, frame_id: str) -> MismatchReport:
    """The message for a window that could not be examined, with the reason."""
    message = MismatchReport(error=to_message(error))
    message.header.stamp, message.header.frame_id = time_message(newest), frame_id
    message.holdout_nominal = message.holdout_augmented = float("nan")
    return message


def _finding_message(finding: NamedEffect, start: int) -> EffectFinding:
    numbers = finding.parameters
    return EffectFinding(
        name=finding.effect.name,
        probability=finding.belief.probability,
        parameter_names=list(numbers),
        parameter_values=[float(number.value) for number in numbers.values()],
        parameter_stds=[float(number.std) for number in numbers.values()],
        parameter_units=[number.unit for number in numbers.values()],
        starts=[time_message(start + round(begin * 1e9)) for begin, _ in finding.windows],
        ends=[time_message(start + round(end * 1e9)) for _, end in finding.windows],
        sentence=finding.sentence,
        rivals=[name for name, _ in finding.belief.rivals],
        rival_probabilities=[chance for _, chance in finding.belief.rivals],
        indistinguishable_from=list(finding.belief.alike),
    )
