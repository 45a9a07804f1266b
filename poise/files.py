"""Writing files whole or not at all."""

import contextlib
import os
import secrets
from pathlib import Path

from poise.errors import ErrorCode, InputError


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file through a temporary one beside it, so that a reader sees the old file or the new, never a part.

    Args:
        path: target; missing folders above it are made.
        content: all of it.

    Returns:
        The path.

    Raises:
        InputError: FILE_UNWRITABLE (disk full, no permission, a file where a folder should be, a bad name).
    """
    draft = path.parent / f".poise-{secrets.token_hex(8)}.tmp"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            ErrorCode.FILE_UNWRITABLE,
            f"cannot write {str(path)!r}: {reason}; free some space or choose another folder",
            path=str(path),
        ) from error
    finally:
        with contextlib.suppress(OSError, ValueError):
            draft.unlink(missing_ok=True)
    return path
