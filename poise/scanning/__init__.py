"""From what a camera on a hand sees to the cloud of one object.

- `camera`, `frames`: pixels to rays; one RGB-D image, checked, with its pose. `cloud_frames`: a PointCloud2 as such.
- `poses`: joint states, URDF and hand-eye transform -> where the camera was. `reading`: all of it from a bag.
- `support`: the table, and what stands on it. `looking`: points looked up in depth images.
- `fusion`: many views -> one thin cloud. `registration`: poses refined where views disagree.
- `completion`: what no view saw, down to the table. `scan`: the whole of it.
- `sweep`: joint positions that bring a camera around an object.
"""

from poise.scanning.camera import Camera
from poise.scanning.cloud_files import scan_ply
from poise.scanning.cloud_frames import frame_of_cloud
from poise.scanning.frames import Frame, View, depth_in_metres
from poise.scanning.reading import MOST_FRAMES, Sweep, SweepOptions, camera_of, read_sweep, transform_of
from poise.scanning.scan import Scan, ScanOptions, scan
from poise.scanning.session import STATIONARY_FRAMES, RobotLog, ScanSession, SessionOptions, scan_session
from poise.scanning.sweep import Ring, plan_sweep

__all__ = [
    "MOST_FRAMES",
    "STATIONARY_FRAMES",
    "Camera",
    "Frame",
    "Ring",
    "RobotLog",
    "Scan",
    "ScanOptions",
    "ScanSession",
    "SessionOptions",
    "Sweep",
    "SweepOptions",
    "View",
    "camera_of",
    "depth_in_metres",
    "frame_of_cloud",
    "plan_sweep",
    "read_sweep",
    "scan",
    "scan_ply",
    "scan_session",
    "transform_of",
]
