"""What an identification on request answers: the estimate, or why its numbers are withheld, with the likely cause."""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from poise.errors import ErrorCode, NoAnswerError, PoiseError
from poise.inertia import InertialEstimate
from poise.nodes.estimate_message import estimate_message, withheld_message
from poise.weighing import is_withheld, named_and_possible, with_causes
from poise_msgs.msg import InertialEstimate as InertialEstimateMessage


@dataclass(frozen=True, eq=False)
class CheckedAnswer:
    """An estimate with the causes of what it leaves unexplained as findings; error: why it is withheld, or None."""

    estimate: InertialEstimate
    error: PoiseError | None

    @property
    def message(self) -> InertialEstimateMessage:
        """The estimate; without numbers where they are withheld."""
        return estimate_message(self.estimate) if self.error is None else withheld_message(self.estimate, self.error)


def checked(estimate: InertialEstimate) -> CheckedAnswer:
    """Search for the causes of what an estimate leaves unexplained; this takes about half a second of CPU."""
    causes, possible = named_and_possible(estimate)
    named = with_causes(estimate, causes, possible)
    if not is_withheld(estimate, causes):
        return CheckedAnswer(named, None)
    first = named.findings[0]
    return CheckedAnswer(named, NoAnswerError(first.code, f"the payload would be wrong: {first.message}"))


def _checked_or_failed(estimate: InertialEstimate) -> CheckedAnswer:
    """The same; a search that fails withholds the estimate, because nothing confirms it, and the goal still ends."""
    try:
        return checked(estimate)
    except Exception as failure:
        error = failure if isinstance(failure, PoiseError) else PoiseError(ErrorCode.INTERNAL, repr(failure))
        return CheckedAnswer(estimate, error)


class CauseSearch:
    """Searches in a thread, so that no callback waits."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="causes")
        self._search: tuple[InertialEstimate, Future[CheckedAnswer]] | None = None

    def done(self, estimate: InertialEstimate) -> bool:
        """Begin the search for an estimate, or look whether it is done."""
        if self._search is None or self._search[0] is not estimate:
            self._search = estimate, self._pool.submit(_checked_or_failed, estimate)
        return self._search[1].done()

    def take(self) -> CheckedAnswer:
        """What was found; the next search may begin."""
        if self._search is None:
            raise RuntimeError("no search has begun")
        (_, search), self._search = self._search, None
        return search.result()
