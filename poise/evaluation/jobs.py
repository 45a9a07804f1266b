"""The jobs that can be evaluated: what each reads, and the fields of its answer that are compared among sources."""

from dataclasses import dataclass

from poise.evaluation.sources import CLOUDS, RECORDINGS, SCENES, SourceKind


@dataclass(frozen=True)
class EvaluationJob:
    """A subcommand of poise that is run on many sources.

    Args:
        name: of the subcommand.
        kind: what it reads.
        measures: patterns of the columns whose distributions, outliers and changes are shown.
    """

    name: str
    kind: SourceKind
    measures: tuple[str, ...]


_EFFECTS = ("effects.*.parameters.*.value", "fit.holdout.*", "fit.nrmse.*.augmented")
JOBS = {
    job.name: job
    for job in (
        EvaluationJob("identify", RECORDINGS, ("mass", "com.?", "inertia.?", "bias.?", "residual_*", "delay")),
        EvaluationJob("mismatch", RECORDINGS, _EFFECTS),
        EvaluationJob("compare", RECORDINGS, ("effects.*.change.*.value", "fit.holdout.*")),
        EvaluationJob("scan", RECORDINGS, ("volume", "n_parts", "n_points", "part_volumes.*", "poses_moved")),
        EvaluationJob("segment", CLOUDS, ("volume", "n_parts", "part_volumes.*")),
        EvaluationJob("robustness", SCENES, ("margin", "queries.*.robustness")),
        EvaluationJob("place", SCENES, ("robustness", "iterations", "volume")),
    )
}
"""By the name of the subcommand."""
