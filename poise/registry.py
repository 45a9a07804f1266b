"""Registries: the entries of one kind, one file each, found by looking through a folder.

`Registry` imports one entry when it is asked for by name; `entries_of` imports and builds them all, and `entry_called`
finds one of these.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Generic, Protocol, TypeVar

from poise.errors import ErrorCode, InputError


class RegistryEntry(Protocol):
    """What every entry declares; each kind adds what it does and what it gives."""

    @property
    def name(self) -> str:
        """Its name: that of its file, with hyphens for underscores."""

    @property
    def description(self) -> str:
        """One sentence for help and docs."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Python modules that it imports when it runs, besides those that Poise requires."""

    @property
    def extra(self) -> str:
        """The extra of `pip install poise[...]` that brings these modules."""


Entry = TypeVar("Entry", bound=RegistryEntry)


@dataclass(frozen=True)
class Registry(Generic[Entry]):
    """Entries of one kind. Each is a file in one of some packages that assigns it to `entry`.

    Args:
        kind: for messages, such as "planner".
        packages: dotted names, searched in this order; those that are not installed are left out.
    """

    kind: str
    packages: tuple[str, ...]

    def names(self) -> tuple[str, ...]:
        """All names, without importing an entry."""
        return tuple(sorted(_modules(self.packages)))

    def find(self, name: str) -> Entry:
        """The entry of a name.

        Raises:
            InputError: BAD_INPUT for an unknown name; UNSUPPORTED when a module that the entry needs is not installed.
        """
        module = _modules(self.packages).get(name)
        if module is None:
            known = ", ".join(self.names())
            raise InputError(ErrorCode.BAD_INPUT, f"there is no {self.kind} {name!r}; choose one of {known}")
        entry: Entry = importlib.import_module(module).entry
        missing = [need for need in entry.needs if find_spec(need) is None]
        if missing:
            raise InputError(
                ErrorCode.UNSUPPORTED,
                f"{self.kind} {name} needs {', '.join(missing)}, which is not installed: "
                f"pip install 'poise[{entry.extra}]'",
            )
        return entry


@cache
def _modules(packages: tuple[str, ...]) -> dict[str, str]:
    """The name and the module of each entry in some packages."""
    found = {}
    for package in packages:
        try:
            folders = importlib.import_module(package).__path__
        except ModuleNotFoundError:
            continue
        for file in pkgutil.iter_modules(folders):
            found[file.name.replace("_", "-")] = f"{package}.{file.name}"
    return found


Base = TypeVar("Base")


def entries_of(package: str, path: Sequence[str], base: type[Base]) -> tuple[Base, ...]:
    """One instance of every concrete class derived from `base`, in the order of modules and of their definitions.

    Args:
        package: dotted name of the package, `__name__` of its `__init__`.
        path: its `__path__`.
        base: the base class of the entries; classes that a module merely imports do not count.
    """
    found = []
    for module in pkgutil.iter_modules(path):
        name = f"{package}.{module.name}"
        for kind in vars(importlib.import_module(name)).values():
            own = inspect.isclass(kind) and f"{kind.__module__}.".startswith(f"{name}.")
            if own and issubclass(kind, base) and not inspect.isabstract(kind):
                found.append(kind())
    return tuple(found)


def entry_called(name: str, entries: Mapping[str, Base], lacking: str) -> Base:
    """The entry of a name.

    Args:
        name: as the user gave it.
        entries: by their names.
        lacking: what the message says before an unknown name.

    Raises:
        InputError: BAD_INPUT, with the names there are.
    """
    if name in entries:
        return entries[name]
    raise InputError(ErrorCode.BAD_INPUT, f"{lacking} {name!r}; use one of {', '.join(entries)}")
