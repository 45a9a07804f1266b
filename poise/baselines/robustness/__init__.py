"""Shared code of the robustness models of the thesis and of other authors.

- `sampled`: contact interfaces as sampled points. `slipping`: contact conditions and maximum flow.
- `toppling`: feasible cuts and their toppling axes. `linear`: linear programs with polygonal friction.
"""

from poise.baselines.robustness.linear import linear_model
from poise.baselines.robustness.sampled import SampledContacts, sampled_contacts, single_pushes, whole_geometry
from poise.baselines.robustness.slipping import Slipping, point_robustness
from poise.baselines.robustness.toppling import TopplingAxes, cuts, topple, toppling_axes

__all__ = [
    "SampledContacts",
    "Slipping",
    "TopplingAxes",
    "cuts",
    "linear_model",
    "point_robustness",
    "sampled_contacts",
    "single_pushes",
    "topple",
    "toppling_axes",
    "whole_geometry",
]
