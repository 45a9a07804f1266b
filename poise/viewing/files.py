"""Whole files or none: writing that leaves nothing behind when it fails."""

import contextlib
import os
import tempfile
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
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=".poise-", dir=path.parent)
        with os.fdopen(descriptor, "wb") as file:
            os.fchmod(descriptor, 0o666 & ~_umask())
            file.write(content)
            file.flush()
            os.fsync(descriptor)
        Path(temporary).replace(path)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            ErrorCode.FILE_UNWRITABLE,
            f"cannot write {str(path)!r}: {reason}; free some space or choose another folder",
            path=str(path),
        ) from error
    return path


def _umask() -> int:
    """The process's file mode mask, which mkstemp does not heed; reading it means setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
