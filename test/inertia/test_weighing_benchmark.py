"""The catalogue of what can be wrong with a wrench: its physics, its truth, its scorer, and a slice of its cases."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the benchmark's engine is an extra: pip install '.[sim]'")

from scipy.spatial.transform import Rotation

from benchmarks.foreign.motions import MOTIONS
from benchmarks.foreign.robots import ROBOTS
from benchmarks.foreign.world import GRAVITY, Scene, World
from benchmarks.weighing.case import Plan, make_case
from benchmarks.weighing.effects import Driving, Grasped, Resting
from benchmarks.weighing.kinds import BY_NAME, KINDS
from benchmarks.weighing.make import SEEDS, plans
from benchmarks.weighing.objects import OBJECTS, draw_object
from benchmarks.weighing.readings import Moments, compensated, in_base_axes, tared
from benchmarks.weighing.run import answer
from benchmarks.weighing.score import judge, report
from benchmarks.weighing.still_air import closed_form
from poise.errors import ErrorCode

SECONDS = 3.0


def scene(item: str = "drill", share: float = 0.3) -> Scene:
    rng = np.random.default_rng(8)
    return Scene(ROBOTS["fr3"], draw_object(item, share, rng), MOTIONS["multi_sine"](ROBOTS["fr3"], SECONDS, rng))


def test_the_closed_form_agrees_with_the_simulation() -> None:
    what = scene()
    track = World(what).run()
    wrench = closed_form(what.load.whole, track.place, Rotation.from_matrix(track.turn))
    inside = slice(50, -50)
    np.testing.assert_allclose(wrench[inside, :3], track.wrench[inside, :3], atol=0.05)
    np.testing.assert_allclose(wrench[inside, 3:], track.wrench[inside, 3:], atol=0.005)


def test_contact_adds_its_force_for_its_share_alone() -> None:
    what = scene()
    free = World(what).run()
    fault = Resting(0.5, {"law": "constant", "where": "last", "force": 4.0, "along": [0.0, 0.6, 0.8], "place": [0] * 3})
    track = World(what, [fault]).run()
    change = np.einsum("nij,nj->ni", track.turn, track.wrench[:, :3]) - np.einsum(
        "nij,nj->ni", free.turn, free.wrench[:, :3]
    )
    begin, end = fault.spans(SECONDS)
    assert (begin, end) == (1.5, 3.0)
    np.testing.assert_allclose(change[1700:2700].mean(axis=0), [0.0, 2.4, 3.2], atol=0.3)
    np.testing.assert_allclose(change[:1300], 0.0, atol=1e-6)


def test_a_driving_base_pushes_by_mass_times_acceleration() -> None:
    what = scene()
    free = World(what).run()
    fault = Driving.draw(what, free, np.random.default_rng(3)).at(0.8)
    track = World(what, [fault]).run()
    change = np.einsum("nij,nj->ni", track.turn, track.wrench[:, :3] - free.wrench[:, :3])
    expected = -what.load.whole.mass * 0.8 * fault.truth["shape"][: len(change)]
    assert np.abs(change[:, :2] - expected)[20:-20].mean() < 0.1 * np.abs(expected).mean()


def test_what_is_grasped_weighs_nothing_before() -> None:
    what = scene(share=0.7)
    fault = Grasped(what.load.part, {"time": 1.5, "sign": 1.0, "place": list(what.load.place)})
    track = World(what, [fault]).run()
    np.testing.assert_allclose(track.wrench[1800:], World(what).run().wrench[1800:], atol=1e-4)
    rest = closed_form(what.load.without(what.load.part), track.place, Rotation.from_matrix(track.turn))
    np.testing.assert_allclose(track.wrench[50:1490], rest[50:1490], atol=0.05)


def test_readings_do_what_their_names_say() -> None:
    body = scene().load.whole
    turn = Rotation.random(50, random_state=1).as_matrix()
    when = Moments(np.arange(50) * 0.1, turn, body, np.random.default_rng(0))
    at_rest = np.hstack([body.mass * when.down, np.cross(body.com, body.mass * when.down)])
    np.testing.assert_allclose(in_base_axes(when, at_rest)[:, :3], [[0, 0, -body.mass * GRAVITY]] * 50, atol=1e-9)
    np.testing.assert_allclose(compensated(1, 1)(when, at_rest), 0.0, atol=1e-9)
    np.testing.assert_allclose(tared(1)(when, at_rest)[0], 0.0)
    for kind in KINDS:
        if kind.reading is not None:
            assert np.abs(kind.reading(when, at_rest) - at_rest).max() > 0, kind.name


def test_every_accepted_name_is_a_finding_of_the_tool() -> None:
    names = {code.name for code in ErrorCode}
    for kind in KINDS:
        assert set(kind.accept) <= names, kind.name


def test_seed_sets_share_no_case_and_fifteen_are_all_pairs() -> None:
    assert len(set(SEEDS.values())) == len(SEEDS)
    planned = list(plans("dev", ("clipped",), 15, 4))
    ill, healthy = ([plan for plan in planned if (plan.kind == "healthy") is fine] for fine in (False, True))
    assert len({(plan.item, plan.way) for plan in ill}) == 15
    assert ill[:2] == list(plans("dev", ("clipped",), 2, 0))
    assert [plan.generator for plan in healthy] == ["robot", "tf"] * 2
    assert BY_NAME["healthy"].accept == ()
    assert len(OBJECTS) == 5


@pytest.mark.parametrize("generator", ["robot", "tf"])
def test_one_seed_gives_the_same_bytes_without_a_label(generator: str, tmp_path: Path) -> None:
    plan = Plan((1, 2), "mirror_z", "cup", "ordinary", generator)
    for name in "ab":
        make_case(plan, SECONDS).write(tmp_path / name)
    first, second = ((tmp_path / name / "recording.mcap").read_bytes() for name in "ab")
    assert first == second
    assert b"mirror" not in first
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["arguments.txt", "recording.mcap"]


def entry(status: int, mass: float | None, *findings: str) -> dict[str, object]:
    found = [{"name": name} for name in findings]
    content = {"mass": mass, "mass_std": 0.01, "com": [0, 0, 0.1], "com_std": [0.001] * 3, "findings": found}
    return {"status": status, "cpu": 1.0, "message": "", "answer": content}


def test_the_scorer_counts_what_it_says() -> None:
    label = {"kind": "clipped", "item": "cup", "way": "gentle", "generator": "robot", "mass": 1.0, "com": [0, 0, 0.1]}
    assert judge("a", label, entry(0, 1.2)).silent
    assert not judge("a", label, entry(0, 1.02)).silent
    assert judge("a", label | {"com": [0, 0, 0.2]}, entry(0, 1.0)).silent
    assert not judge("a", label, entry(0, 1.2, "POOR_FIT")).silent
    assert not judge("a", label, entry(0, 1.2, "POOR_FIT")).named
    assert judge("a", label, entry(0, 1.2, "POOR_FIT", "CLIPPED")).named
    assert judge("a", label, entry(3, None, "CLIPPED")).withheld
    assert "| clipped | 1 | 1 |" in report([judge("a", label, entry(0, 1.2))])


SLICE = (
    Plan((77, 1), "healthy", "drill", "ordinary"),
    Plan((77, 2), "healthy", "cup", "ordinary", "tf"),
    Plan((77, 4), "contact_50", "pot", "ordinary"),
    Plan((77, 5), "base_axes", "drill", "stop_and_go"),
    Plan((77, 7), "force_kgf", "pot", "ordinary"),
    Plan((77, 8), "grasped", "pot", "stop_and_go"),
    Plan((77, 9), "compensated_fully", "drill", "ordinary"),
    Plan((77, 11), "late_150", "drill", "ordinary"),
)
NAMED = ("contact_50", "grasped")


@pytest.mark.parametrize("plan", SLICE, ids=lambda plan: f"{plan.kind}-{plan.generator}")
def test_no_answer_is_wrong_without_a_finding(plan: Plan, tmp_path: Path) -> None:
    case = make_case(plan, 10.0)
    case.write(tmp_path / "case_0001")
    verdict = judge("case_0001", case.label, answer(tmp_path / "case_0001"))
    assert not verdict.silent, verdict
    assert verdict.flagged == bool(BY_NAME[plan.kind].accept), verdict
    assert verdict.named or plan.kind not in NAMED, verdict


def test_a_mirrored_centre_of_mass_can_be_seen_and_a_partial_weight_cannot() -> None:
    seen = {
        kind: make_case(Plan((77, 12), kind, "pen", way), 8.0).label["visible"]
        for kind, way in (("mirror_z", "ordinary"), ("compensated_partly", "gentle"), ("tared_1", "gentle"))
    }
    assert seen["mirror_z"] > 20
    assert seen["compensated_partly"] < 10
    assert seen["tared_1"] < 2
