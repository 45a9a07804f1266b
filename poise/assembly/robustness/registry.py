"""Robustness models by name: those of Poise, and the baselines of the thesis to compare with."""

from collections.abc import Callable
from dataclasses import dataclass

from poise.assembly.robustness.limit_loads import LimitLoads
from poise.assembly.statics import Analysis, Deadline, Loads
from poise.registry import Registry


@dataclass(frozen=True)
class RobustnessModel:
    """One model.

    Args:
        name: as services and the command line take it; the name of its file.
        description: what it takes for contact.
        solve: the limit loads of many questions at once; what the deadline leaves no time for is given up.
        maps: it gives maps with certified bounds.
        certified: its lower and upper bounds enclose the answer under its own assumptions.
        several_forces: it takes forces that grow together; otherwise these are refused with BAD_INPUT.
        needs, extra: see `RegistryEntry`.
    """

    name: str
    description: str
    solve: Callable[[Analysis, Loads, Deadline], LimitLoads]
    maps: bool = False
    certified: bool = False
    several_forces: bool = True
    needs: tuple[str, ...] = ()
    extra: str = ""


ROBUSTNESS_MODELS = Registry[RobustnessModel]("model", ("poise.assembly.models", "poise.baselines.models"))
"""By the names that services and the command line take."""
DEFAULT_MODEL = "default"
