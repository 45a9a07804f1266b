"""What is wrong with a wrench that no payload explains: the likely causes, tried one by one, and their repair.

- `fixed_errors`: signs, axes and units as fixed matrices; `poise.mismatch` looks for them with a known load.
- `reading`: what a candidate is: another design of the same samples, with its sentence and its repair.
- `axes`, `units`, `gravity`, `clipping`, `channels`, `variation`, `times`, `moving_base`, `pulls`, `contact`: the
  candidates; `families`: all of them.
- `fitting`: robust least squares of a design. `causes`: the search and its ranking.
- `verdicts`: findings, numbers that are withheld, repaired wrenches.
"""

from poise.weighing.causes import Cause, find_causes
from poise.weighing.fixed_errors import (
    EXCHANGE_ERRORS,
    FORCE_UNIT_ERRORS,
    MIRROR_ERRORS,
    SIGN_ERRORS,
    TORQUE_UNIT_ERRORS,
    FixedError,
    base_axes_sentence,
    both_units,
    on_both,
)
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
    "EXCHANGE_ERRORS",
    "FORCE_UNIT_ERRORS",
    "MIRROR_ERRORS",
    "SIGN_ERRORS",
    "TORQUE_UNIT_ERRORS",
    "Cause",
    "FixedError",
    "Repair",
    "after_repair",
    "base_axes_sentence",
    "both_units",
    "causes_of",
    "find_causes",
    "findings_of",
    "is_withheld",
    "named_and_possible",
    "on_both",
    "repaired_wrench",
    "with_causes",
    "without_numbers",
]
