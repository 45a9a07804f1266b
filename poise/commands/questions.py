"""What people ask about assemblies: files of pushes and of directions."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from poise.assembly import Push
from poise.errors import ErrorCode, InputError
from poise.types import Array

_MAX_BYTES = 100_000_000

Question = Push | list[Push]
"""A push, or several that grow together."""


def first_of(question: Question) -> Push:
    """The push that stands for a question in tables and pictures."""
    return question if isinstance(question, Push) else question[0]


def read_pushes(path: Path) -> list[Question]:
    """Read a JSON list of {object, point [3], direction [3]}, in the scene's frame, or of lists of these.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or BAD_INPUT naming the entry.
    """
    questions: list[Question] = []
    for number, entry in enumerate(_json_list(path)):
        where = f"{path}: entry {number}"
        if isinstance(entry, list) and entry:
            questions.append([_push(part, where) for part in entry])
        else:
            questions.append(_push(entry, where))
    return questions


def _push(entry: Any, where: str) -> Push:
    if not isinstance(entry, dict) or {"object", "point", "direction"} - set(entry):
        raise InputError(ErrorCode.BAD_INPUT, f"{where} needs object, point and direction")
    if not isinstance(entry["object"], str):
        raise InputError(ErrorCode.BAD_INPUT, f"{where}: object is {entry['object']!r}, expected an id")
    return Push(entry["object"], entry["point"], entry["direction"])


def read_vectors(path: Path) -> Array:
    """Read a JSON list of [x, y, z].

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, BAD_INPUT.
    """
    try:
        return np.array(_json_list(path), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list of [x, y, z]") from error


def _json_list(path: Path) -> list[Any]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not JSON: {error}") from error
    if not isinstance(content, list):
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list, found {type(content).__name__}")
    return content
