"""Model `lp4`: one linear program per push, friction circles as squares (thesis eq. 4.44-4.48)."""

from functools import partial

from poise.assembly.robustness import RobustnessModel
from poise.baselines.robustness import linear_model

# Friction circles as inscribed squares: loads that slide diagonally to them are underestimated by up to 29 %.
entry = RobustnessModel(
    "lp4", "20 sampled points, friction circles as squares, one linear program per push", partial(linear_model, 4)
)
