"""The figures: continuous angles, pictures of every part."""

import io

import matplotlib
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from poise.inertia.pipeline.estimate import Identification
from poise.viewing import figures
from poise.viewing.canvas import PALETTE, STYLE, sheet
from poise.viewing.inline_svg import inline_svg


def test_a_turn_of_300_degrees_is_drawn_without_a_jump() -> None:
    angle = np.radians(np.linspace(0, 300, 400))
    axis = np.array([2.0, -1.0, 2.0]) / 3
    start = Rotation.from_rotvec([0.3, 1.2, -0.7])
    rotation = (start * Rotation.from_rotvec(angle[:, None] * axis)).as_matrix()
    assert np.allclose(figures.turn_from_first(rotation), angle[:, None] * axis, atol=1e-7)


def test_the_turn_from_the_first_pose_is_the_rotation_itself() -> None:
    rotations = Rotation.random(200, rng=np.random.default_rng(0)).as_matrix()
    turned = Rotation.from_rotvec(figures.turn_from_first(rotations)).as_matrix()
    assert np.allclose(turned, rotations[0].T @ rotations, atol=1e-12)


@pytest.mark.parametrize("which", ["identification", "static_identification"])
def test_every_panel_draws_and_says_in_words_what_it_shows(which: str, request: pytest.FixtureRequest) -> None:
    identification: Identification = request.getfixturevalue(which)
    panels = [
        *figures.wrench_panels(identification),
        *figures.residual_panels(identification),
        *figures.convergence_panels(identification),
        *figures.motion_panels(identification),
        figures.sphere_panel(identification),
    ]
    assert len({panel.key for panel in panels}) == len(panels)
    for panel in panels:
        svg = inline_svg(panel)
        assert "<path" in svg
        assert len(panel.alt) > 20
        assert "nan" not in panel.alt


def test_every_colour_of_a_picture_follows_the_page(identification: Identification) -> None:
    svg = inline_svg(figures.wrench_panels(identification)[0])
    assert "var(--accent)" in svg
    assert not [colour for colour in PALETTE.values() if colour in svg]


def test_a_sheet_for_the_documentation_is_a_picture(identification: Identification) -> None:
    file = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        sheet(figures.wrench_panels(identification), columns=3).savefig(file, format="png")
    picture = Image.open(file)
    assert picture.size == (2160, 680)
    assert len(picture.convert("RGB").getcolors(1_000_000) or []) > 20


def test_drawing_leaves_the_settings_of_matplotlib_alone(identification: Identification) -> None:
    before = dict(matplotlib.rcParams)
    inline_svg(figures.sphere_panel(identification))
    assert dict(matplotlib.rcParams) == before
