"""Registries that are folders: every concrete class of a kind in the modules of a package."""

import importlib
import inspect
import pkgutil
from collections.abc import Sequence
from typing import TypeVar

Entry = TypeVar("Entry")


def entries_of(package: str, path: Sequence[str], kind: type[Entry]) -> tuple[Entry, ...]:
    """One instance of every concrete class derived from `kind`, in the order of modules and of their definitions.

    Args:
        package: dotted name of the package, `__name__` of its `__init__`.
        path: its `__path__`.
        kind: the base class of the entries; classes that a module merely imports do not count.
    """
    found = []
    for module in pkgutil.iter_modules(path):
        name = f"{package}.{module.name}"
        for entry in vars(importlib.import_module(name)).values():
            own = inspect.isclass(entry) and (entry.__module__ + ".").startswith(name + ".")
            if own and issubclass(entry, kind) and not inspect.isabstract(entry):
                found.append(entry())
    return tuple(found)
