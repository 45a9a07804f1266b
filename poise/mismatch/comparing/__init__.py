"""Two recordings of one robot: matched by their motion, and what changed from one to the other."""

from poise.mismatch.comparing.alignment import Alignment, align
from poise.mismatch.comparing.comparison import Change, Comparison, compare
from poise.mismatch.comparing.difference import difference

__all__ = ["Alignment", "Change", "Comparison", "align", "compare", "difference"]
