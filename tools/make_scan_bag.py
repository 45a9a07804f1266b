"""Makes bags/hammer_sweep.mcap and its entry in the manifest: a simulated camera sweep around one workshop tool.

    python tools/make_scan_bag.py [--tool hammer] [--output bags]

Running it twice gives the same bytes.
"""

import argparse
import hashlib
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial import cKDTree

from poise.fake_robots.rasteriser import Body, Scene
from poise.fake_robots.sweep_bag import FakeSweep, laid_down, write_sweep
from poise.files import write_whole
from poise.recording import open_recording
from poise.scanning import Camera

ROOT = Path(__file__).resolve().parent.parent
CLOUDS = ROOT / "benchmarks" / "data" / "workshop_clouds.npz"
LICENCE = "MIT"
SOURCE = "Workshop Tools Dataset, P. Nadeau, M. Giamou, J. Kelly, 2023 (MIT); rendered by tools/make_scan_bag.py"
# A third of the pixels of VGA, and of the thesis' frames, keep the bag small.
CAMERA = Camera(320, 240, 307.5, 307.5, 159.5, 119.5)
FRAMES = 48
NOTES = (
    "Simulated: an xArm7 carries a depth camera with the noise of a D435 around the tool. 16UC1 depth aligned to rgb8"
    " colour; tf_static holds the hand-eye transform; the stamps begin at 0."
)


def tool_body(name: str, at: tuple[float, float], yaw: float) -> tuple[Body, float]:
    """A tool of the data set lying on a table, painted like its cloud, and its volume in m3."""
    with np.load(CLOUDS) as data:
        vertices, triangles = data[f"{name}/vertices"].astype(np.float64), data[f"{name}/triangles"].astype(np.int64)
        points, colours = data[f"{name}/points"].astype(np.float64), data[f"{name}/colours"]
        volume = float(data[f"{name}/volume"])
    nearest = cKDTree(points).query(vertices[triangles].mean(axis=1))[1]
    return Body(laid_down(vertices, triangles, at, yaw)[triangles], colours[nearest] / 255), volume


def manifest_entry(path: Path, tool: str) -> dict[str, object]:
    """What the manifest says of the bag."""
    recording = open_recording(path, strict=True)
    topics: dict[str, dict[str, object]] = {}
    for topic, kind in sorted(recording.topics.items()):
        topics[topic] = {"type": kind, "messages": recording.counts[topic]}
    return {
        "file": path.name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "licence": LICENCE,
        "attribution": SOURCE,
        "sensor": f"simulated RealSense D435 on the hand of a UFACTORY xArm7; {tool.replace('_', ' ')} on a table",
        "topics": topics,
        "notes": NOTES,
    }


def main() -> None:
    """Write the bag, and its entry after those of the other bags."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tool", default="hammer")
    parser.add_argument("--output", type=Path, default=ROOT / "bags")
    options = parser.parse_args()
    body, volume = tool_body(options.tool, (0.45, 0.0), 0.4)
    sweep = FakeSweep(Scene((body,), middle=(0.45, 0.0)), camera=CAMERA, frames=FRAMES)
    path = options.output / f"{options.tool}_sweep.mcap"
    metadata = {"poise": {"source": SOURCE, "licence": LICENCE, "true_volume": f"{volume:.6g}"}}
    write_sweep(path, sweep, metadata)
    manifest = options.output / "manifest.yaml"
    text = manifest.read_text(encoding="utf-8") if manifest.exists() else "bags:\n"
    others = [entry for entry in (yaml.safe_load(text)["bags"] or []) if entry["file"] != path.name]
    heading = "".join(line for line in text.splitlines(keepends=True) if line.startswith("#"))
    body_text = yaml.safe_dump({"bags": [*others, manifest_entry(path, options.tool)]}, sort_keys=False, width=110)
    write_whole(manifest, (heading + body_text).encode())
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
