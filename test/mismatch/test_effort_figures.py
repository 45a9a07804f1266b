"""The report of joint efforts draws friction curves with the data behind them."""

from field_robots import Recorded, read, urdf

from poise.mismatch.answer import diagnose
from poise.mismatch.effects import effect_named
from poise.viewing.effort_figures import friction_panels, response_panels

SLIDE = urdf(("slide", "prismatic", "1 0 0"))


def test_a_friction_curve_explains_the_data_behind_it() -> None:
    viscous = effect_named("viscous_friction")
    assert viscous is not None
    reading = read(Recorded(text=SLIDE, damping=20.0).joints(), SLIDE)
    found = diagnose(reading.recorded, reading.model, None, [viscous])
    (examination,) = found.examinations
    (panel,) = friction_panels(examination, "key")
    assert panel.alt == "slide, friction, N: data over m/s; the curve explains 100 % of their square."
    assert panel.figure().axes[0].lines
    assert response_panels(examination, "key") == []
