"""Parts of objects whose parts are known, and the output of the command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shape_samples as samples

import poise
from poise.cli import run
from poise.errors import ErrorCode, InputError
from poise.shape import reconstruction
from poise.shape.clustering import smooth_colours
from poise.shape.metrics import global_consistency_error, undersegmentation_error
from poise.shape.reconstruction import reconstruct
from poise.shape.segmentation import segment
from poise.shape.surface_graph import folds, surface_graph
from poise.shape.thinning import thin


def test_head_and_handle_do_not_mix() -> None:
    points, colours, truth = samples.mallet(np.random.default_rng(2), 800)
    found = segment(points, colours)
    assert undersegmentation_error(found.labels, truth) < 0.03
    assert global_consistency_error(found.labels, truth) < 0.03
    assert found.volumes.sum() == pytest.approx(found.solid.volume)


def test_noise_of_colours_goes_and_their_edges_stay() -> None:
    rng = np.random.default_rng(9)
    points, clean, truth = samples.mallet(rng, 800)
    noisy = np.clip(clean + rng.normal(scale=0.05, size=clean.shape), 0, 1)
    found = segment(points, noisy)
    assert undersegmentation_error(found.labels, truth) < 0.04
    line = np.stack([np.arange(199), np.arange(1, 200)], axis=1)
    step = np.where(np.arange(200) < 100, 0.2, 0.8)[:, None] * np.ones(3)
    smooth = smooth_colours(step + rng.normal(scale=0.03, size=step.shape), line)
    assert np.abs(smooth - step).std() < 0.02
    assert np.linalg.norm(smooth[100] - smooth[99]) > 0.9
    np.testing.assert_array_equal(smooth_colours(step, line), step)


@pytest.mark.parametrize("noise", [3e-4, 1e-3])
def test_a_box_is_one_part_however_it_is_sampled(noise: float) -> None:
    """Bubbles in the noise have slits, whose sides face each other; 6 and 5 of 10 such boxes were cut along them."""
    found = []
    for seed in range(0, 20, 2):
        rng = np.random.default_rng([4000, seed])
        points = samples.box(rng, (0.12, 0.08, 0.01), 2000)
        found.append(segment(points + noise * rng.normal(size=points.shape)).n_parts)
    assert sum(n > 1 for n in found) <= 1


def test_a_slit_is_no_fold_and_a_corner_between_parts_is() -> None:
    facing = np.array([[-1.0, 0, 0.1], [1.0, 0, 0.1]]) / np.hypot(1, 0.1)
    ends = np.array([[0.001, 0, 0], [-0.001, 0, 0]])
    assert folds(ends, facing, np.array([0]), np.array([1]))[0] > 1.9
    creases = surface_graph(reconstruct(samples.mallet(np.random.default_rng(2), 800)[0], 2500).solid).creases
    assert np.count_nonzero(creases > 0.4) > 10  # between head and handle
    assert creases.max() <= 1.35


def test_parts_know_their_colours() -> None:
    points, colours, truth = samples.mallet(np.random.default_rng(2), 800)
    found = segment(points, colours)
    assert found.part_colours is not None
    assert segment(points).part_colours is None
    for part in range(found.n_parts):
        own = truth[found.labels == part]
        if len(np.unique(own)) == 1:
            np.testing.assert_allclose(found.part_colours[part], colours[truth == own[0]][0])


def test_the_encoding_of_one_paint_changes_nothing() -> None:
    rng = np.random.default_rng(6)
    points, _, _ = samples.mallet(rng, 800)
    colours = np.clip([0.6, 0.4, 0.2] + 0.02 * rng.normal(size=points.shape), 0, 1)
    first = segment(points, colours)
    for other in (np.round(16 * colours) / 16, colours[::-1]):
        np.testing.assert_array_equal(segment(points, other).labels, first.labels)


def test_the_same_cloud_gives_the_same_labels() -> None:
    points, colours, _ = samples.mallet(np.random.default_rng(2), 500)
    first, second = segment(points, colours), segment(points.copy(), colours.copy())
    np.testing.assert_array_equal(first.labels, second.labels)


def test_a_dense_cloud_is_thinned_and_all_its_points_are_labelled() -> None:
    points, colours, truth = samples.mallet(np.random.default_rng(3), 20_000)
    found = segment(points, colours)
    assert len(found.labels) == len(points)
    assert len(found.solid.vertices) <= 2500
    assert undersegmentation_error(found.labels, truth) < 0.03


def test_of_very_many_points_some_are_looked_at_and_all_are_labelled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sorting two million of them took half a minute."""
    points, colours, truth = samples.mallet(np.random.default_rng(3), 120_000)
    points = points + 3e-4 * np.random.default_rng(4).normal(size=points.shape)
    looked: list[int] = []
    monkeypatch.setattr(reconstruction, "thin", lambda some, wanted: (looked.append(len(some)), thin(some, wanted))[1])
    found = segment(points, colours)
    assert max(looked) == 100_000
    assert found.noise == pytest.approx(3e-4, rel=0.25)
    assert found.volume == pytest.approx(segment(points[::10], colours[::10]).volume, rel=0.01)
    assert undersegmentation_error(found.labels, truth) < 0.03


def test_thinning_keeps_points_evenly_and_drops_duplicates() -> None:
    rng = np.random.default_rng(4)
    points = samples.box(rng, (0.1, 0.1, 0.1), 5000)
    kept = thin(points, 1000)
    assert 500 < len(kept) <= 1000
    assert thin(np.repeat(points[:50], 3, axis=0), 100).tolist() == list(range(0, 150, 3))


def test_the_command_answers_with_a_label_per_row(tmp_path: Path) -> None:
    points, colours, _ = samples.mallet(np.random.default_rng(2), 400)
    rows = np.insert(np.concatenate([points, colours], axis=1), 3, np.nan, axis=0)
    np.save(tmp_path / "mallet.npy", rows)
    options = {
        f"--{kind}": tmp_path / f"mallet_{kind}.{ending}"
        for kind, ending in (("json", "json"), ("picture", "png"), ("ply", "ply"), ("surface", "ply"))
    }
    words = [word for option, path in options.items() for word in (option, str(path))]
    assert run(["segment", str(tmp_path / "mallet.npy"), *words]) == 0
    answer = json.loads(options["--json"].read_text())
    assert len(answer["labels"]) == len(rows)
    assert answer["labels"][3] == -1
    assert set(answer["labels"]) == {-1, *range(answer["n_parts"])}
    assert answer["volume"] == pytest.approx(0.04 * 0.12 * 0.04 + np.pi * 0.012**2 * 0.2, rel=0.1)
    assert sum(answer["part_volumes"]) == pytest.approx(answer["volume"])
    assert answer["notes"]
    assert options["--picture"].read_bytes().startswith(b"\x89PNG")


def test_the_written_surface_is_read_back_closed_with_its_volume(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    points, colours, _ = samples.mallet(np.random.default_rng(2), 400)
    np.save(tmp_path / "mallet.npy", np.concatenate([points, colours], axis=1))
    path = tmp_path / "surface.ply"
    assert (
        run(["segment", str(tmp_path / "mallet.npy"), "--surface", str(path), "--json", str(tmp_path / "a.json")]) == 0
    )
    mesh = trimesh.load(path, process=False)
    assert mesh.volume == pytest.approx(json.loads((tmp_path / "a.json").read_text())["volume"])


def _answer_of_mesh(parts: list[tuple[tuple[float, float, float], float, bool]], tmp_path: Path) -> dict[str, Any]:
    """What is answered for boxes: their sides and place along x, m, and whether they are cavities."""
    trimesh = pytest.importorskip("trimesh")
    bodies = [trimesh.creation.box(sides) for sides, _, _ in parts]
    for body, (_, place, cavity) in zip(bodies, parts, strict=True):
        body.apply_translation([place, 0.0, 0.0])
        if cavity:
            body.invert()
    trimesh.util.concatenate(bodies).export(tmp_path / "m.stl")
    assert run(["segment", str(tmp_path / "m.stl"), "--json", str(tmp_path / "m.json")]) == 0
    answer: dict[str, Any] = json.loads((tmp_path / "m.json").read_text())
    found = poise.segment(tmp_path / "m.stl")
    assert (found.volume, found.volume_std, *found.volumes) == (answer["volume"], 0.0, *answer["part_volumes"])
    assert found.volumes.sum() == pytest.approx(found.volume)
    assert list(found.notes) == answer["notes"]
    return answer


def test_notes_on_a_mesh_do_not_doubt_its_exact_volume(tmp_path: Path) -> None:
    """A box with a cavity, of which a cloud says that it may be a hollow, uncertain by a half."""
    answer = _answer_of_mesh([((0.06, 0.05, 0.04), 0.0, False), ((0.04, 0.03, 0.02), 0.0, True)], tmp_path)
    assert answer["volume"] == pytest.approx(0.06 * 0.05 * 0.04 - 0.04 * 0.03 * 0.02, rel=1e-5)
    assert answer["volume_std"] == 0.0
    assert not [note for note in answer["notes"] if "uncertain" in note or "noise" in note or "bodies" in note]


def test_bodies_of_a_mesh_that_do_not_touch_are_counted(tmp_path: Path) -> None:
    """Also where the gap is narrower than what parts are found by."""
    answer = _answer_of_mesh([((0.06, 0.05, 0.04), 0.061 * i, False) for i in range(3)], tmp_path)
    assert [note for note in answer["notes"] if note.startswith("the mesh has 3 bodies that do not touch")]


@pytest.mark.parametrize("height", [-0.0199, 0.0, 0.0199])
def test_a_cloud_from_one_side_is_refused(height: float) -> None:
    points = samples.box(np.random.default_rng(6), (0.1, 0.06, 0.04), 3000)
    with pytest.raises(InputError) as refused:
        segment(points[points[:, 2] > height])
    assert refused.value.code in (ErrorCode.SCAN_INCOMPLETE, ErrorCode.MESH_INVALID)


def test_two_objects_are_named() -> None:
    rng = np.random.default_rng(7)
    one, other = (samples.box(rng, (0.05, 0.05, 0.05), 600, np.array([x, 0.0, 0.0])) for x in (0.0, 0.1))
    found = segment(np.concatenate([one, other]))
    assert "2 pieces" in found.notes[0]
    assert found.n_parts >= 2


def test_bad_clouds_exit_with_two_and_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "millimetres.npy", 1000 * samples.box(np.random.default_rng(0), (0.1, 0.1, 0.1), 300))
    assert run(["segment", str(tmp_path / "millimetres.npy")]) == 2
    assert "--scale 0.001" in capsys.readouterr().err
    assert run(["segment", str(tmp_path / "nowhere.ply")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
