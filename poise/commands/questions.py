"""What people ask about assemblies: files of pushes and of directions."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

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
    """Read a list of {object, point [3], direction [3]}, in the scene's frame, or of lists of these; JSON or YAML.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, or BAD_INPUT naming the entry.
    """
    questions: list[Question] = []
    for number, entry in enumerate(_list_of(path)):
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
    """Read a list of [x, y, z], as `read_pushes`.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, BAD_INPUT.
    """
    try:
        return np.array(_list_of(path), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list of [x, y, z]") from error


def _is_yaml(path: Path) -> bool:
    return path.suffix.lower() in (".yaml", ".yml")


def _list_of(path: Path) -> list[Any]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: larger than {_MAX_BYTES // 1_000_000} MB")
        content = yaml.safe_load(path.read_text(encoding="utf-8")) if _is_yaml(path) else json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        kind = "YAML" if _is_yaml(path) else "JSON"
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: not {kind}: {' '.join(str(error).split())}") from error
    if not isinstance(content, list):
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: expected a list, found {type(content).__name__}")
    return content
