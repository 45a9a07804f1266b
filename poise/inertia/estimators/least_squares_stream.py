"""The streaming form of weighted least squares, on sums that do not grow."""

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators.streaming import Prior, SampleEvidence
from poise.inertia.model import InertialSolution
from poise.robot import SensorMotion
from poise.types import Array


class LeastSquaresStream:
    """Hands over the weighted least squares that the pipeline solves for every estimator.

    The prior does not matter: the bias may be any, and the noise follows from the residuals.
    """

    def __init__(self, prior: Prior) -> None:
        self.prior = prior

    def add(self, motion: SensorMotion, wrench: Array) -> None:
        """See `StreamingEstimator`; the pipeline keeps the sums."""

    def solve(self, evidence: SampleEvidence) -> InertialSolution:
        """See `StreamingEstimator`."""
        if evidence.least_squares is None:
            raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, "the samples show no parameter")
        return evidence.least_squares
