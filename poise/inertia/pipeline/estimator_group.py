"""The estimators at work on one question: the payload since the start, or that of a window."""

from collections.abc import Callable

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.estimators import AUTO, OLS, STATIC, EstimatorEntry, Prior, check_method, estimator_named
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.inertia.pipeline.method_pipeline import MethodPipeline

_REST_SHARE = 0.5
"""From this share of samples at rest on, `auto` takes the held poses alone."""


class EstimatorGroup:
    """One method; or, for `auto`, two of them and the choice of the one that suits the motion.

    Args:
        method: see `method_choices`.
        pipeline: makes the pipeline of an estimator.
        prior: what is known before the first sample.

    Raises:
        InputError: BAD_INPUT for a method that does not exist.
    """

    def __init__(self, method: str, pipeline: Callable[[EstimatorEntry, Prior], MethodPipeline], prior: Prior) -> None:
        check_method(method)
        self.method, self.prior = method, prior
        names = (STATIC, OLS) if method == AUTO else (method,)
        self.pipelines = {name: pipeline(estimator_named(name), prior) for name in names}

    @property
    def busiest(self) -> MethodPipeline:
        """The pipeline that has used most samples."""
        return max(self.pipelines.values(), key=lambda pipeline: pipeline.n_samples)

    def estimate(self, frame_id: str) -> InertialEstimate:
        """Solve for everything so far; see `MethodPipeline.estimate`."""
        if self.method != AUTO:
            return self.pipelines[self.method].estimate(frame_id)
        static, moving = (self.pipelines[name] for name in (STATIC, OLS))
        if static.n_samples >= _REST_SHARE * moving.n_samples:
            try:
                held = static.estimate(frame_id)
            except NoAnswerError as error:
                if error.code is ErrorCode.NOT_CONSISTENT:
                    raise
                return moving.estimate(frame_id)
            if not set(held.unidentified) & {"m", "cx", "cy", "cz"} or not moving.n_samples:
                return held
        return moving.estimate(frame_id)
