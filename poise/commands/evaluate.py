"""`poise evaluate`: the same job over many recordings, clouds or scenes, on the cores of this machine or a cluster."""

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import typer

from poise.commands.evaluate_output import print_results, results_json, write_results
from poise.commands.output import JsonOption, console, progress_bar, refuse_folder, write_json
from poise.errors import ErrorCode, InputError
from poise.evaluation import (
    JOBS,
    DataSource,
    EvaluationJob,
    Journal,
    WorkerLimits,
    WorkerPool,
    WorkerTask,
    cluster_pool,
    find_sources,
    local_pool,
    this_build,
    unanswered,
)
from poise.evaluation import run as run_tasks

CONTEXT_SETTINGS = {"ignore_unknown_options": True}
_WORKER = ("-P", "-m", "poise.commands.evaluate_worker")
_DEFAULT = "identify"
_NAME = "{name}"
_WRITING = frozenset(
    ("--report", "--out", "--parts", "--surface", "--picture", "--ply", "--rerun", "--save", "--separate", "--export")
)
"""Options of jobs that write a file for each source."""
_TAKEN = frozenset({"--json", "--into"})

WordsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="[JOB] SOURCE...",
        help=f"JOB: {', '.join(JOBS)} (default: {_DEFAULT}). SOURCE: folders, files, globs and URLs. Options of the"
        " job are passed on to it.",
        show_default=False,
    ),
]
ResultsOption = Annotated[
    Path | None,
    typer.Option(
        "--results",
        metavar="DIR",
        help="Folder for the results: a journal, a table as CSV and Parquet, a page (HTML). A second run with the same"
        " folder answers only what is missing.",
        show_default=False,
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option("--workers", min=1, max=1024, help="Processes (default: one for each core).", show_default=False),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Use the workers of this Dask scheduler, such as tcp://10.0.0.5:8786, instead.",
        show_default=False,
    ),
]
TimeLimitOption = Annotated[
    float, typer.Option("--time-limit", metavar="SECONDS", min=1.0, help="For one source; then its worker is ended.")
]
MemoryOption = Annotated[
    float | None,
    typer.Option(
        "--memory",
        metavar="GB",
        min=0.5,
        help="That one worker may use (default: the memory of the machine, divided among the workers).",
        show_default=False,
    ),
]
GroupOption = Annotated[
    str | None,
    typer.Option(
        "--group",
        metavar="REGEX",
        help="What sources are compared within, such as robots: the first group of this expression in the name"
        " (default: the folder that a source lies in).",
        show_default=False,
    ),
]
ReferenceOption = Annotated[
    Path | None,
    typer.Option(
        "--reference",
        metavar="FILE",
        help="compare: the recording before; each source is one after.",
        show_default=False,
    ),
]
RetryOption = Annotated[
    bool, typer.Option("--retry", help="With the results of an earlier run: answer again what ended with an error.")
]


def evaluate(
    words: WordsArgument,
    results: ResultsOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    time_limit: TimeLimitOption = 600.0,
    memory: MemoryOption = None,
    group: GroupOption = None,
    reference: ReferenceOption = None,
    retry: RetryOption = False,
    json_target: JsonOption = None,
) -> int:
    """Run a job over many recordings, clouds or scenes and compare the results.

    Each source is answered as by `poise JOB`. One without an answer does not stop the others; the exit status is then
    that of the worst. A file NAME.truth.yaml beside NAME.mcap, with fields of the answer, gives errors. `{name}` in an
    option of the job stands for the name of the source.

    Example:  poise evaluate bags --json payloads.json

    Example:  poise evaluate mismatch 'runs/**/*.mcap' --model model.yaml --results out/fleet --workers 2
    """
    refuse_folder(json_target, "--json")
    plan = read_plan(words, reference)
    sources, skipped = find_sources(plan.patterns, plan.job.kind)
    groups = groups_of(sources, group)
    names = labels(sources)
    size = min(workers or os.cpu_count() or 1, len(sources))
    bounds = WorkerLimits(time_limit, _memory(memory, size))
    command = (sys.executable, *_WORKER)
    build, folder = this_build(), str(Path.cwd())

    def task_of(source: DataSource) -> WorkerTask:
        arguments = tuple(word.replace(_NAME, names[source.name]) for word in plan.arguments)
        return WorkerTask(plan.job.name, arguments, source.name, folder, bounds, build, command)

    heading = {"job": plan.job.name, "arguments": list(plan.arguments), "build": build}
    with _folder(results) as kept, Journal(kept, heading) as journal:
        missing = unanswered(sources, journal, retry)
        with _counted(plan.job.name, len(sources) - len(missing), len(sources)) as progress:
            if missing:
                with _pool(scheduler, size) as pool:
                    run_tasks(missing, task_of, pool, journal, progress)
        write_json(json_target, results_json(journal, skipped) if json_target else {})
        found = write_results(kept if results else None, journal, plan.job, groups)
    print_results(console(json_target), plan.job, found, skipped)
    return found.exit_status


@dataclass(frozen=True)
class EvaluationPlan:
    """What is asked: the job, its arguments without a source, and where the sources are."""

    job: EvaluationJob
    arguments: tuple[str, ...]
    patterns: tuple[str, ...]


def read_plan(words: Sequence[str], reference: Path | None) -> EvaluationPlan:
    """Take the command's words apart: job, options of the job, sources.

    Raises:
        InputError: BAD_INPUT for an option that the job does not have, or one that would write one file many times.
    """
    named = words[0] in JOBS and (len(words) > 1 or not Path(words[0]).exists())
    job = JOBS[words[0] if named else _DEFAULT]
    options, patterns = _split(job, list(words[1:] if named else words))
    if not patterns:
        raise InputError(
            ErrorCode.BAD_INPUT, f"evaluate {job.name}: name the folders, files, globs or URLs to evaluate"
        )
    if (job.name == "compare") is (reference is None):
        needs = "needs --reference, the recording before" if reference is None else "takes no --reference"
        raise InputError(ErrorCode.BAD_INPUT, f"evaluate {job.name} {needs}")
    arguments = (*options, *([] if reference is None else [str(reference)]))
    _command(job).make_context(job.name, [*arguments, patterns[0]])  # a value of the wrong type is refused here
    return EvaluationPlan(job, arguments, tuple(patterns))


def _command(job: EvaluationJob) -> Any:
    """The parser of a job."""
    from poise.cli import load_command  # it lists this command

    return load_command(job.name)


def _split(job: EvaluationJob, words: list[str]) -> tuple[list[str], list[str]]:
    """The options of the job with their values, and the other words."""
    known = {name: option for option in _command(job).params for name in (*option.opts, *option.secondary_opts)}
    options, others = [], []
    while words:
        word = words.pop(0)
        if not word.startswith("-") or word == "-":
            others.append(word)
            continue
        name, equals, _ = word.partition("=")
        if name not in known or name in _TAKEN or not name.startswith("-"):
            raise InputError(ErrorCode.BAD_INPUT, f"no such option for evaluate {job.name}: {name}")
        count = 0 if equals or getattr(known[name], "is_flag", False) else known[name].nargs
        if count > len(words):
            raise InputError(ErrorCode.BAD_INPUT, f"option {name} needs a value")
        values, words = words[:count], words[count:]
        if name in _WRITING and not any(_NAME in text for text in (word, *values)):
            message = f"{name} would write one file for every source: put {_NAME} into it, such as out/{_NAME}"
            raise InputError(ErrorCode.BAD_INPUT, message)
        options += [word, *values]
    return options, others


def groups_of(sources: Sequence[DataSource], pattern: str | None) -> dict[str, str]:
    """The group of each source by its name.

    Raises:
        InputError: BAD_INPUT for an expression that is none, or without a group in parentheses.
    """
    if pattern is None:
        return {source.name: source.folder for source in sources}
    try:
        expression = re.compile(pattern)
    except re.error as error:
        raise InputError(ErrorCode.BAD_INPUT, f"--group '{pattern}' is no regular expression: {error}") from error
    if not expression.groups:
        raise InputError(ErrorCode.BAD_INPUT, f"--group '{pattern}': put parentheses around what names the group")
    found = {source.name: expression.search(source.name) for source in sources}
    return {name: (match[1] or "") if match else "" for name, match in found.items()}


def labels(sources: Sequence[DataSource]) -> dict[str, str]:
    """For each source a name that can be part of a file name: its path below what all have in common."""
    folders = [PurePosixPath(source.name.replace("://", "/")).parts[:-1] for source in sources]
    common = sum(1 for _ in takewhile(lambda parts: len(set(parts)) == 1, zip(*folders, strict=False)))
    found = {}
    for source in sources:
        parts = PurePosixPath(source.name.replace("://", "/")).parts[common:]
        found[source.name] = re.sub(r"[^\w.-]", "_", "_".join(parts)).removesuffix(PurePosixPath(source.name).suffix)
    return found


def _memory(given: float | None, workers: int) -> int:
    """Bytes of one worker."""
    if given is not None:
        return int(given * 1e9)
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // workers


def _pool(scheduler: str | None, size: int) -> AbstractContextManager[WorkerPool]:
    return local_pool(size) if scheduler is None else cluster_pool(scheduler)


def _folder(results: Path | None) -> AbstractContextManager[Path]:
    """Where the journal lies: in the folder of the results, or in one that is deleted afterwards."""
    return nullcontext(results) if results is not None else _temporary()


@contextmanager
def _temporary() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="poise-evaluate-") as folder:
        yield Path(folder)


@contextmanager
def _counted(job: str, before: int, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal; elsewhere a line on stderr for each tenth of a long run."""
    said = [10 * before // total]
    with progress_bar(f"{job}: {total} sources") as show:

        def progress(done: int) -> None:
            show((before + done) / total)
            tenth = 10 * (before + done) // total
            if total >= 100 and tenth > said[0] and not sys.stderr.isatty():
                said[0] = tenth
                print(f"poise: {before + done} of {total} answered", file=sys.stderr)

        show(before / total)
        yield progress
