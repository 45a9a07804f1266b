"""Truth files beside sources, and the errors of the answers against them."""

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from poise.errors import ErrorCode, InputError
from poise.evaluation.rows import ResultCell, ResultRow, flattened
from poise.evaluation.sources import TRUTH_ENDINGS, SourceKind, file_system, is_url, unreachable

_MOST_BYTES = 1_000_000
_TWO_SIGMA = 1.96


@dataclass(frozen=True)
class ErrorLine:
    """How far the answers are from the truth in one field.

    Args:
        field: its path in the answer.
        count: answers with this field.
        bias: mean of answer minus truth; NaN for words.
        rms: root mean square of it; NaN for words.
        median: of its absolute value; NaN for words.
        worst: largest absolute value; NaN for words.
        worst_name: the source that has it, or for words the first that differs.
        covered: share whose 95 % interval holds the truth; NaN without standard deviations.
        agreeing: share of equal words; NaN for numbers.
    """

    field: str
    count: int
    bias: float
    rms: float
    median: float
    worst: float
    worst_name: str
    covered: float
    agreeing: float


def truth_files(name: str, kind: SourceKind) -> list[str]:
    """The names that the truth file of a source may have: `run.truth.yaml` beside `run.mcap` or the folder `run`."""
    endings = [ending for ending in kind.endings if name.endswith(ending)]
    stem = name.removesuffix(max(endings, key=len, default="")).rstrip("./")
    return [stem + ending for ending in TRUTH_ENDINGS]


def add_truths(rows: Iterable[ResultRow], kind: SourceKind) -> None:
    """Read the truth files of rows, where there are any.

    Raises:
        InputError: FILE_CORRUPT for a file that is no mapping.
    """
    listings: dict[str, set[str]] = {}
    for row in rows:
        for name in truth_files(row.name, kind):
            if (text := _text(name, listings)) is not None:
                row.truth = _parsed(name, text)
                break


def _text(name: str, listings: dict[str, set[str]]) -> str | None:
    """The content of a file or URL; None where there is none."""
    if not is_url(name):
        path = Path(name)
        return path.read_text(encoding="utf-8")[:_MOST_BYTES] if path.is_file() else None
    files, path_there = file_system(name)
    folder = path_there.rpartition("/")[0]
    try:
        if folder not in listings:
            listings[folder] = set(files.ls(folder, detail=False))
        return files.cat_file(path_there).decode() if path_there in listings[folder] else None
    except Exception as error:
        raise unreachable(name, error) from error


def _parsed(name: str, text: str) -> dict[str, ResultCell]:
    try:
        content: Any = json.loads(text) if name.endswith(".json") else yaml.safe_load(text)
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{name}: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise InputError(ErrorCode.FILE_CORRUPT, f"{name}: expected fields of the answer, such as `mass: 0.93`")
    return flattened(content)


def error_lines(rows: Sequence[ResultRow]) -> list[ErrorLine]:
    """The errors of every field that truth files give, in the order of the fields."""
    pairs: dict[str, list[tuple[ResultRow, ResultCell, ResultCell]]] = defaultdict(list)
    for row in rows:
        if row.counts:
            for field, true in row.truth.items():
                if (value := row.cells.get(field)) is not None:
                    pairs[field].append((row, value, true))
    return [_line(field, found) for field, found in pairs.items()]


def _line(field: str, found: list[tuple[ResultRow, ResultCell, ResultCell]]) -> ErrorLine:
    if any(isinstance(cell, str | bool) for _, *cells in found for cell in cells):
        differs = [row.name for row, value, true in found if value != true]
        share = 1.0 - len(differs) / len(found)
        none = math.nan
        return ErrorLine(field, len(found), none, none, none, none, differs[0] if differs else "", none, share)
    errors = np.array([float(value) - float(true) for _, value, true in found])
    spreads = np.array([row.number(_spread_of(field)) for row, *_ in found])
    known = np.isfinite(spreads) & (spreads > 0)
    covered = float(np.mean(np.abs(errors[known]) <= _TWO_SIGMA * spreads[known])) if known.any() else math.nan
    worst = int(np.abs(errors).argmax())
    return ErrorLine(
        field,
        len(found),
        float(errors.mean()),
        float(np.sqrt(np.mean(errors**2))),
        float(np.median(np.abs(errors))),
        float(abs(errors[worst])),
        found[worst][0].name,
        covered,
        math.nan,
    )


def _spread_of(field: str) -> str:
    """The field with the standard deviation: mass_std, com_std.0, effects.NAME.parameters.P.std."""
    if field.endswith(".value"):
        return field.removesuffix("value") + "std"
    name, dot, rest = field.partition(".")
    return f"{name}_std{dot}{rest}"
