"""From what a camera on a hand sees to the cloud of one object.

- `camera`, `frames`: pixels to rays; one RGB-D image, checked, with its pose. `cloud_frames`: a PointCloud2 as such.
- `poses`: joint states, URDF and hand-eye transform -> where the camera was. `reading`: all of it from a bag.
- `support`: the table, and what stands on it. `looking`: points looked up in depth images.
- `fusion`: many views -> one thin cloud. `registration`: poses refined where views disagree.
- `completion`: what no view saw, down to the table. `scan`: the whole of it.
- `sweep`: joint positions that bring a camera around an object.
"""

from poise.scanning.camera import Camera
from poise.scanning.frames import Frame, View
from poise.scanning.reading import Sweep, SweepOptions, read_sweep
from poise.scanning.scan import Scan, ScanOptions, scan

__all__ = ["Camera", "Frame", "Scan", "ScanOptions", "Sweep", "SweepOptions", "View", "read_sweep", "scan"]
