"""Several recordings of one robot: when each change appeared."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from poise.mismatch.comparing.comparison import Comparison, compare
from poise.mismatch.reading import NominalModel
from poise.mismatch.recorded import RecordedMotion


@dataclass(frozen=True, eq=False)
class HistoryEntry:
    """One recording against the first one.

    Args:
        index: of the recording. after: it belongs to the second group.
        comparison: the first recording is A, this one B.
    """

    index: int
    after: bool
    comparison: Comparison

    @property
    def names(self) -> tuple[str, ...]:
        """Of the changes."""
        return tuple(change.finding.effect.name for change in self.comparison.changes)


@dataclass(frozen=True)
class Appearance:
    """A change and its recordings.

    Args:
        name: of the effect.
        first: index of the first recording that shows it.
        shown: indices of all that do, in their order in time.
        lasting: every recording from the first one on shows it.
        in_before: a recording of the first group shows it too, so that it does not distinguish the groups.
    """

    name: str
    first: int
    shown: tuple[int, ...]
    lasting: bool
    in_before: bool


@dataclass(frozen=True, eq=False)
class History:
    """Recordings in their order in time against the first one of the first group: `entries`, and when what appeared."""

    reference: int
    entries: tuple[HistoryEntry, ...]
    appearances: tuple[Appearance, ...]


def history(
    recordings: Sequence[RecordedMotion],
    befores: int,
    model: NominalModel,
    progress: Callable[[float], None] = lambda share: None,
) -> History:
    """Compare every recording with the earliest of the first group.

    Args:
        recordings: of one robot; the first `befores` of them are the first group.
        befores: see there.
        model: of all.
        progress: is called with the completed share, 0 to 1.

    Raises:
        PoiseError: as `compare`.
    """
    order = sorted(range(len(recordings)), key=lambda index: recordings[index].start)
    reference = next(index for index in order if index < befores)
    others = [index for index in order if index != reference]
    entries = []
    for done, index in enumerate(others):
        share = 1.0 / len(others)
        bar = _part(progress, done * share, share)
        found = compare(recordings[reference], recordings[index], model, progress=bar)
        entries.append(HistoryEntry(index, index >= befores, found))
    return History(reference, tuple(entries), _appearances(entries))


def _part(progress: Callable[[float], None], begin: float, share: float) -> Callable[[float], None]:
    return lambda done: progress(begin + share * done)


def _appearances(entries: Sequence[HistoryEntry]) -> tuple[Appearance, ...]:
    found = []
    for name in dict.fromkeys(name for entry in entries for name in entry.names):
        shown = [entry for entry in entries if name in entry.names]
        since = entries[entries.index(shown[0]) :]
        found.append(
            Appearance(
                name,
                shown[0].index,
                tuple(entry.index for entry in shown),
                len(shown) == len(since),
                any(not entry.after for entry in shown),
            )
        )
    return tuple(found)
