"""What every placement planner of the registry has to do, whichever way it finds a place."""

import re
from pathlib import Path

import pytest

from benchmarks.placement import scenes
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.placement import PLACEMENT_PLANNERS, CancelledError, Options
from poise.registry import Registry

EVERY_PLANNER = pytest.mark.parametrize("name", [*PLACEMENT_PLANNERS.names(), "grid"])
PAGE = Path(__file__).resolve().parents[2] / "docs" / "add_a_planner.md"
NEARLY_ALWAYS_FAILS = ("chance",)


@pytest.fixture(scope="session")
def registry(tmp_path_factory):
    """The registry of Poise with the planner of the docs page added."""
    folder = tmp_path_factory.mktemp("added") / "planners_of_the_page"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (folder / "grid.py").write_text(block)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder.parent)
        yield Registry("planner", (*PLACEMENT_PLANNERS.packages, folder.name))


@pytest.fixture
def planner(name, registry):
    entry = registry.find(name)
    for module in entry.needs:
        pytest.importorskip(module)
    return entry


@EVERY_PLANNER
def test_it_declares_its_name_and_how_it_works(name, planner):
    assert planner.name == name
    assert planner.description
    assert bool(planner.needs) == bool(planner.extra)


@EVERY_PLANNER
def test_what_it_finds_stands_and_the_seed_decides_where(name, planner):
    on = "any" if name == "sim-random" else "objects"
    scene, options = scenes.scene("cube"), Options(attempts=200, on=on)
    if name in NEARLY_ALWAYS_FAILS:
        with pytest.raises(NoAnswerError) as error:
            planner.plan(scene, scenes.cube(), Options(attempts=20), 0, None)
        assert error.value.code is ErrorCode.NO_PLACEMENT
        assert sum(error.value.data["rejected"].values()) == error.value.data["iterations"] == 20
        return
    first, second = (planner.plan(scene, scenes.cube(), options, 3, None) for _ in range(2))
    assert first.analysis.stability().stable
    assert first.pose.translation[2] > 0.1 or on == "any"
    assert 1 <= first.iterations <= 200
    assert first.item.id in first.analysis.assembly.index
    assert first.pose.vector == pytest.approx(second.pose.vector)


@EVERY_PLANNER
def test_it_can_be_cancelled(name, planner):
    seen = []
    with pytest.raises(CancelledError) as error:
        planner.plan(scenes.scene("stack"), scenes.cube(), Options(), 0, lambda progress: seen.append(progress))
    assert error.value.code is ErrorCode.CANCELLED
    assert len(seen) == 1


@EVERY_PLANNER
@pytest.mark.parametrize("deadline", [1e-9])
def test_without_time_for_a_pose_it_says_so(name, planner, deadline):
    with pytest.raises(NoAnswerError) as error:
        planner.plan(scenes.scene("cube"), scenes.cube(), Options(deadline=deadline), 0, None)
    assert error.value.code is ErrorCode.DEADLINE


@EVERY_PLANNER
def test_an_object_that_cannot_join_is_refused(name, planner):
    scene = scenes.scene("cube")
    for item in (scene.objects[0], scene.objects[1]):
        with pytest.raises(InputError) as error:
            planner.plan(scene, item, Options(), 0, None)
        assert error.value.code is ErrorCode.BAD_INPUT


@EVERY_PLANNER
def test_a_scene_that_does_not_stand_is_refused(name, planner):
    scene = scenes.scene("cube")
    x, y, z = scene.objects[1].pose.translation.tolist()
    ledge = scenes.box("ledge", (0.1, 0.1, 0.02), (x + 0.09, y, z + 0.06))
    with pytest.raises(NoAnswerError) as error:
        planner.plan(scene.with_object(ledge), scenes.cube(), Options(), 0, None)
    assert error.value.code is ErrorCode.UNSTABLE


def test_an_unknown_planner_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="sim-above") as error:
        PLACEMENT_PLANNERS.find("best")
    assert error.value.code is ErrorCode.BAD_INPUT


def test_a_planner_whose_engine_is_not_installed_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr("poise.registry.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"mujoco.*pip install 'poise\[sim\]'") as error:
        PLACEMENT_PLANNERS.find("sim-above")
    assert error.value.code is ErrorCode.UNSUPPORTED


def test_without_the_baselines_those_of_poise_remain():
    own = Registry("planner", ("poise.placement.planners", "poise.not_installed.planners"))
    assert "poise" in own.names()
    assert not {"approx", "sim-above"} & set(own.names())
    assert set(own.names()) < set(PLACEMENT_PLANNERS.names())
