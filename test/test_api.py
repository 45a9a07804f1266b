"""The short interface of `import poise`: lazy, complete, taking paths and loaded objects alike, results on one line."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import poise
from poise.assembly import Analysis, Push, load_scene
from poise.shape.clouds import read_cloud

ROOT = Path(__file__).resolve().parents[1]
STATIC = ROOT / "bags" / "kuka_static_poses.mcap"
CRATE = ROOT / "examples" / "crate.yaml"


def one_line(result: object) -> str:
    text = repr(result)
    assert "\n" not in text
    assert len(text) < 300
    return text


def test_importing_poise_loads_no_room_and_dir_lists_the_functions() -> None:
    script = "import sys, poise; print([n for n in ('numpy', 'typer', 'poise.api') if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    assert {"identify", "segment", "scan", "robustness", "place", "diagnose", "read"} <= set(dir(poise))
    with pytest.raises(AttributeError, match="weigh"):
        _ = poise.weigh


@pytest.mark.parametrize("name", poise.__all__)
def test_every_function_has_an_example_and_its_errors(name: str) -> None:
    text = getattr(poise, name).__doc__
    assert f">>> poise.{name}(" in text or f"= poise.{name}(" in text
    assert "Raises:" in text


def test_a_recording_is_read_and_weighed_from_its_path_or_as_an_object() -> None:
    recording = poise.read(STATIC)
    assert "wrench 24" in one_line(recording)
    from_object = poise.identify(recording, method="static")
    from_path = poise.identify(str(STATIC), method="static")
    np.testing.assert_array_equal(from_object.estimate.phi, from_path.estimate.phi)
    assert "0.9323 ± 0.0032 kg" in one_line(from_path)
    assert "0.9323 ± 0.0032 kg" in one_line(from_path.estimate)


def test_a_scene_is_assessed_from_its_path_or_as_an_object() -> None:
    push = ("crate", (-0.5, 0.0, 0.2), (1.0, 0.0, 0.0))
    from_path = poise.robustness(CRATE, [push])
    from_object = poise.robustness(Analysis.of(load_scene(CRATE)), [Push(*push)])
    assert from_path.results[0].robustness == pytest.approx(0.8 * 1.5 * 9.81, rel=1e-3)
    assert from_path.results[0].robustness == from_object.results[0].robustness
    assert "slip: crate, parcel" in one_line(from_path.results[0])
    assert one_line(from_path).startswith("Assessment(stable")


def test_an_object_is_placed_from_its_entry() -> None:
    placement = poise.place(CRATE, {"id": "mug", "cylinder": [0.04, 0.1], "mass": 0.3}, seed=1)
    assert one_line(placement).startswith("Placement(mug at [")


def test_a_cloud_is_segmented_from_its_path_or_as_an_array() -> None:
    found = poise.segment(ROOT / "examples" / "hammer.ply")
    assert one_line(found).startswith(f"Segmentation({found.n_parts} parts")
    cloud = read_cloud(ROOT / "examples" / "hammer.ply")
    np.testing.assert_array_equal(poise.segment(cloud.points, cloud.colours).labels, found.labels)


@pytest.mark.slow
def test_a_sweep_is_scanned() -> None:
    found = poise.scan(ROOT / "bags" / "hammer_sweep.mcap")
    assert one_line(found).startswith("Scan(")
