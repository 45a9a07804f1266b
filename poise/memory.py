"""Memory of freed arrays: kept for the next ones, or returned to the system."""

import ctypes
import sys

_TRIM_THRESHOLD, _MOST_MAPPED = -1, -4
"""M_TRIM_THRESHOLD and M_MMAP_MAX of mallopt, in malloc.h of glibc."""


def keep_freed_memory() -> None:
    """Let the process keep memory that arrays leave, until it ends; for commands, not for processes of others.

    By default, the memory of each large array is a mapping of its own. Where large arrays come and go often, clearing
    their pages takes a tenth of the CPU time. Other C libraries than glibc keep their way.
    """
    if sys.platform != "linux":
        return
    c = ctypes.CDLL(None)
    if hasattr(c, "gnu_get_libc_version"):
        c.mallopt(_TRIM_THRESHOLD, -1)
        c.mallopt(_MOST_MAPPED, 0)


def release_memory() -> None:
    """Return freed memory to the system after large work: glibc keeps it, in ever more pieces."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries have none
    if trim is not None:
        trim(0)
