"""One job over many sources: finds them, runs workers, keeps replies, and shows what stands out.

- `find_sources`, `DataSource`: files in folders, behind globs and at URLs. `JOBS`, `EvaluationJob`: what reads them.
- `run`, `WorkerTask`, `WorkerLimits`, `failed`: a job on the processes of `local_pool` or of a Dask cluster
  (`cluster_pool`). `this_build` says which Poise computes.
- `Journal`, `unanswered`: replies are kept as soon as they are there; a later run goes on.
- `rows_of`, `ResultRow`, `add_truths`, `error_lines`, `outliers`, `changes`: the results as rows, and what they show.
"""

from poise.evaluation.build import this_build
from poise.evaluation.cluster import cluster_pool
from poise.evaluation.jobs import JOBS, EvaluationJob
from poise.evaluation.journal import Journal
from poise.evaluation.patterns import LevelChange, Outlier, changes, measures_in, outliers
from poise.evaluation.rows import ResultRow, columns_of, failures_of, median_seconds, rows_of, spoken
from poise.evaluation.running import WorkerPool, local_pool, run, unanswered
from poise.evaluation.sources import RECORDINGS, DataSource, SourceKind, file_system, find_sources, is_url, unreachable
from poise.evaluation.tables import write_tables
from poise.evaluation.truth import ErrorLine, add_truths, error_lines
from poise.evaluation.workers import WorkerLimits, WorkerTask, failed

__all__ = [
    "JOBS",
    "RECORDINGS",
    "DataSource",
    "ErrorLine",
    "EvaluationJob",
    "Journal",
    "LevelChange",
    "Outlier",
    "ResultRow",
    "SourceKind",
    "WorkerLimits",
    "WorkerPool",
    "WorkerTask",
    "add_truths",
    "changes",
    "cluster_pool",
    "columns_of",
    "error_lines",
    "failed",
    "failures_of",
    "file_system",
    "find_sources",
    "is_url",
    "local_pool",
    "measures_in",
    "median_seconds",
    "outliers",
    "rows_of",
    "run",
    "spoken",
    "this_build",
    "unanswered",
    "unreachable",
    "write_tables",
]
