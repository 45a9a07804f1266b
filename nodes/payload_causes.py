"""What an identification on request answers: the estimate, or why its numbers are withheld, with the likely cause."""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from poise.errors import NoAnswerError, PoiseError
from poise.inertia import InertialEstimate
from poise.nodes.estimate_message import estimate_message, findings_message, no_estimate_message, time_message
from poise.weighing import causes_of, is_withheld, with_causes
from poise_msgs.msg import InertialEstimate as InertialEstimateMessage


@dataclass(frozen=True, eq=False)
class CheckedAnswer:
    """An estimate with the causes of what it leaves unexplained as findings; error: why it is withheld, or None."""

    estimate: InertialEstimate
    error: PoiseError | None

    @property
    def message(self) -> InertialEstimateMessage:
        """The estimate; without numbers where they are withheld."""
        if self.error is None:
            return estimate_message(self.estimate)
        message = no_estimate_message(self.error, self.estimate.frame_id)
        message.header.stamp = time_message(self.estimate.stamp)
        message.findings = findings_message(self.estimate)
        return message


def checked(estimate: InertialEstimate) -> CheckedAnswer:
    """Search for the causes of what an estimate leaves unexplained; this takes about half a second of CPU."""
    causes = causes_of(estimate)
    named = with_causes(estimate, causes)
    if not is_withheld(estimate, causes):
        return CheckedAnswer(named, None)
    first = named.findings[0]
    return CheckedAnswer(named, NoAnswerError(first.code, f"the payload would be wrong: {first.message}"))


class CauseSearch:
    """Searches in a thread, so that no callback waits."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="causes")
        self._search: Future[CheckedAnswer] | None = None

    def done(self, estimate: InertialEstimate) -> bool:
        """Begin with the search, or look whether it is done."""
        if self._search is None:
            self._search = self._pool.submit(checked, estimate)
        return self._search.done()

    def take(self) -> CheckedAnswer:
        """What was found; the next search may begin."""
        if self._search is None:
            raise RuntimeError("no search has begun")
        found, self._search = self._search.result(), None
        return found
