"""Model `lp8`: one linear program per push, friction circles as octagons (thesis eq. 4.44-4.48)."""

from functools import partial

from poise.assembly.robustness import RobustnessModel
from poise.baselines.robustness import linear_model

# Friction circles as inscribed octagons: limit loads are underestimated by up to 8 %.
entry = RobustnessModel(
    "lp8", "20 sampled points, friction circles as octagons, one linear program per push", partial(linear_model, 8)
)
