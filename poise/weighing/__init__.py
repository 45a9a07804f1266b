"""What is wrong with a wrench that no payload explains: the likely causes, tried one by one, and their repair.

- `reading`: what a candidate is: another design of the same samples, with its sentence and its repair.
- `axes`, `units`, `gravity`, `clipping`, `variation`, `times`, `moving_base`, `pulls`, `contact`: the candidates;
  `families`: all of them.
- `fitting`: robust least squares of a design. `causes`: the search and its ranking.
- `verdicts`: findings, numbers that are withheld, repaired wrenches.
"""

from poise.weighing.causes import Cause, find_causes
from poise.weighing.reading import Repair
from poise.weighing.verdicts import (
    after_repair,
    causes_of,
    findings_of,
    is_withheld,
    named_and_possible,
    repaired_wrench,
    with_causes,
    without_numbers,
)

__all__ = [
    "Cause",
    "Repair",
    "after_repair",
    "causes_of",
    "find_causes",
    "findings_of",
    "is_withheld",
    "named_and_possible",
    "repaired_wrench",
    "with_causes",
    "without_numbers",
]
