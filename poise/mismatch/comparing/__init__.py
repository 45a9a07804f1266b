"""Two recordings of one robot: matched by their motion, and what changed from one to the other."""

from poise.mismatch.comparing.alignment import Alignment, align, other_joints
from poise.mismatch.comparing.change import Change
from poise.mismatch.comparing.comparison import Comparison, compare
from poise.mismatch.comparing.difference import difference
from poise.mismatch.comparing.history import Appearance, History, HistoryEntry, history
from poise.mismatch.comparing.located import Located, LocatedChannel, located

__all__ = [
    "Alignment",
    "Appearance",
    "Change",
    "Comparison",
    "History",
    "HistoryEntry",
    "Located",
    "LocatedChannel",
    "align",
    "compare",
    "difference",
    "history",
    "located",
    "other_joints",
]
