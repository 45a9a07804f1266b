"""One job over many sources: finds them, runs workers, keeps replies, and shows what stands out.

- `find_sources`, `Source`, `Job`, `JOBS`: files in folders, behind globs and at URLs, and the jobs that read them.
- `run`, `local_pool`, `cluster_pool`, `Task`, `Limits`, `failed`: a job on processes of this machine or of a Dask
  cluster. `this_build` says which Poise computes.
- `Journal`, `unanswered`: replies are kept as soon as they are there; a later run goes on.
- `rows_of`, `Row`, `add_truths`, `error_lines`, `outliers`, `changes`: the results as rows, and what they show.
"""

from poise.evaluation.build import this_build
from poise.evaluation.cluster import cluster_pool
from poise.evaluation.jobs import JOBS, Job
from poise.evaluation.journal import Journal
from poise.evaluation.patterns import Change, Outlier, changes, measures_in, outliers
from poise.evaluation.rows import Row, columns_of, failures_of, median_seconds, rows_of, spoken
from poise.evaluation.running import Pool, local_pool, run, unanswered
from poise.evaluation.sources import RECORDINGS, Source, SourceKind, file_system, find_sources, is_url, unreachable
from poise.evaluation.tables import write_tables
from poise.evaluation.truth import ErrorLine, add_truths, error_lines
from poise.evaluation.workers import Limits, Task, failed

__all__ = [
    "JOBS",
    "RECORDINGS",
    "Change",
    "ErrorLine",
    "Job",
    "Journal",
    "Limits",
    "Outlier",
    "Pool",
    "Row",
    "Source",
    "SourceKind",
    "Task",
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
