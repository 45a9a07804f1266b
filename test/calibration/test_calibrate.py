"""Hand-eye calibration from corners of a board: right, or wider, or it is said why there is no answer."""

import importlib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.calibration import LINK, Views, World, errors_of, views_of
from poise.calibration import (
    Board,
    HandEyeCalibration,
    calibrate,
    calibration_content,
    corrected_description,
    read_calibration,
)
from poise.errors import ErrorCode, InputError, PoiseError
from poise.robot import RobotModel, find_urdf, frame_poses, read_urdf


@cache
def found_once(**wrong: float) -> HandEyeCalibration:
    return found(views(**wrong))


@cache
def views(seed: int = 0, **wrong: float) -> Views:
    return views_of(World(**wrong), seed)


def found(seen: Views) -> HandEyeCalibration:
    return calibrate(seen.kinematics, LINK, seen.camera, seen.sightings)


def require_near(seen: Views, answer: HandEyeCalibration) -> None:
    assert np.abs(errors_of(seen.eye, answer.parameters.eye) / answer.eye_sigma).max() < 4


@pytest.mark.parametrize(
    ("wrong", "largest"),
    [({"offset": 4e-3}, 3e-3), ({"delay": 0.03, "speed": 0.15}, 1.5e-3), ({"outliers": 0.08}, 1e-3)],
)
def test_the_camera_is_found_within_its_sigma(wrong: dict[str, float], largest: float) -> None:
    seen = views(**wrong)
    answer = found_once(**wrong)
    require_near(seen, answer)
    assert np.linalg.norm(errors_of(seen.eye, answer.parameters.eye)[3:]) < largest
    if "delay" in wrong:
        assert answer.parameters.delay == pytest.approx(0.03, abs=1e-3)
    if "outliers" in wrong:
        assert answer.corners_rejected > 20


def test_joint_offsets_are_found_where_they_are_not_part_of_something_else() -> None:
    seen = views(offset=4e-3)
    answer = found_once(offset=4e-3)
    sigma = np.sqrt(np.diag(answer.covariance))[12:19]
    assert not answer.identified[[0, 6]].any()
    assert {"fr3_joint1", "fr3_joint7", "camera_delay"} <= answer.reasons.keys()
    np.testing.assert_array_equal(answer.parameters.offsets[~answer.identified], 0.0)
    off = (answer.parameters.offsets - seen.offsets)[answer.identified] / sigma[answer.identified]
    assert np.abs(off).max() < 4
    assert answer.identified[1:6].all()
    assert np.abs(seen.offsets[1:6]).max() > 3 * sigma[1:6].max()  # they are not found by being small


def test_what_is_not_estimated_widens_the_answer() -> None:
    seen = views(views=8, encoder=1e-3)
    answer = found(seen)
    assert not answer.identified.all()
    require_near(seen, answer)


def test_images_that_are_late_are_left_out() -> None:
    seen = views(late=2, speed=0.3)
    answer = found(seen)
    assert set(answer.rejected) == {3 * 10**9, 10 * 10**9}
    require_near(seen, answer)


@pytest.mark.parametrize(
    ("wrong", "code", "word"),
    [
        ({"slip": 2e-3}, ErrorCode.POOR_FIT, "slipped"),
        ({"size": 1.02}, ErrorCode.BAD_INPUT, "1.02"),
        ({"turn": 0.02}, ErrorCode.NOT_IDENTIFIABLE, "only moves along"),
        ({"views": 6}, ErrorCode.TOO_FEW_SAMPLES, "6 images"),
    ],
)
def test_a_wrong_recording_has_no_answer(wrong: dict[str, float], code: ErrorCode, word: str) -> None:
    with pytest.raises(PoiseError, match=word) as caught:
        found(views(**wrong))
    assert caught.value.code == code


def test_a_board_that_was_never_seen_is_said() -> None:
    seen = views()
    few = [replace(each, corners=each.corners[:4], pixels=each.pixels[:4]) for each in seen.sightings]
    for sightings in ([], few):
        with pytest.raises(InputError) as caught:
            calibrate(seen.kinematics, LINK, seen.camera, sightings)
        assert caught.value.code == ErrorCode.EMPTY


def test_a_robot_that_is_not_this_one_has_no_answer() -> None:
    seen = views()
    other = replace(seen.kinematics, model=RobotModel.from_file("xarm7", LINK))
    with pytest.raises(PoiseError) as caught:
        calibrate(other, LINK, seen.camera, seen.sightings)
    assert caught.value.code in (ErrorCode.POOR_FIT, ErrorCode.BAD_INPUT)


def test_the_file_comes_back_and_the_description_has_the_offsets(tmp_path: Path) -> None:
    seen = views(offset=4e-3)
    answer = found_once(offset=4e-3)
    path = tmp_path / "calibration.yaml"
    path.write_text(yaml.safe_dump(calibration_content(answer, "eye", {"recording": "x"})))
    stored = read_calibration(path)
    np.testing.assert_allclose(stored.hand_eye.translation, answer.parameters.eye.translation, atol=1e-12)
    np.testing.assert_allclose(stored.hand_eye.rotation, answer.parameters.eye.rotation, atol=1e-9)
    assert (stored.hand_eye.parent, stored.hand_eye.child) == (LINK, "eye")
    text = read_urdf(find_urdf("fr3"))
    after = RobotModel.from_urdf(corrected_description(text, stored.offsets), LINK)
    q = np.linspace(-0.5, 0.5, 7)[None]
    wanted = frame_poses(seen.kinematics.model, q + answer.parameters.offsets, LINK)
    for expected, got in zip(wanted, frame_poses(after, q, LINK), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-9)
    with pytest.raises(InputError, match="no joint"):
        corrected_description(text, {"elbow": 0.1})


@pytest.mark.parametrize("text", ["[]", "kind: other", "kind: poise calibration", "{"])
def test_a_file_of_another_kind_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text(text)
    with pytest.raises(InputError):
        read_calibration(path)


@pytest.mark.parametrize("wrong", [{"columns": 2}, {"marker": 0.05}, {"square": 30.0}])
def test_a_board_that_makes_no_sense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Board(**wrong)


@pytest.mark.parametrize("beside", [0, 1])
def test_a_view_with_corners_on_one_line_is_left_out(beside: int) -> None:
    """Its pose is not determined, and the homography has no answer."""
    seen = views()
    first = seen.sightings[3]
    rows = first.corners[:, 1]
    row = max(np.unique(rows), key=lambda y: int(np.sum(rows == y)))
    kept = np.concatenate([np.flatnonzero(rows == row), np.flatnonzero(rows != row)[:beside]])
    assert len(kept) >= 6
    line = replace(first, corners=first.corners[kept], pixels=first.pixels[kept])
    answer = calibrate(seen.kinematics, LINK, seen.camera, [*seen.sightings[:3], line, *seen.sightings[4:]])
    assert answer.views == len(seen.sightings) - 1
    require_near(seen, answer)


def test_outliers_that_change_to_the_last_round_leave_one_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit and the views that it is judged with belong together."""
    monkeypatch.setattr(importlib.import_module("poise.calibration.calibrate"), "_ROUNDS", 1)
    answer = found(views(late=1, speed=0.05))
    assert answer.views == 25
    assert answer.rejected == ()
