"""From the images of a camera on the hand to the point cloud of one object.

- `camera`, `frames`: pixels to rays; one RGB-D image, checked, with its pose. `cloud_frames`: a PointCloud2 as such.
- `topics`, `reading`: the frames of a bag, raw or compressed; `painting`: colours that are not aligned with the depth;
  `units`: the unit of depth, where none is given.
- `poses`, `placing`: from joint states, URDF and hand-eye transform, or from tf, to camera poses.
- `support`: the table, and the objects on it. `looking`: depth images at given points.
- `fusion`: one cloud from many views. `registration`: correction of poses if views disagree.
- `flatness`: how well views agree about the table. `corners`: whether they see it lower beside the object. `causes`:
  why they disagree.
- `observing`: what views show with the poses that they have. `shared_errors`, `pose_doubt`: errors of these poses.
- `completion`: hidden surface, down to the table. `scan`: the complete computation.
- `sweep`: joint positions that bring a camera around an object. `viewpoints`: places from which a region is covered.
- `naming`: which objects of a scan are known already.
- `standing`: the surface of a scan as one closed mesh that stands flat, for an assembly. `cans`: the cylinder that it
  is. `patches`, `faceted`: its planar patches, and the solid of few facets between their planes.
"""

from poise.scanning.camera import Camera
from poise.scanning.cloud_files import scan_ply
from poise.scanning.cloud_frames import columns_of, frame_of_cloud
from poise.scanning.frames import Frame, View, depth_in_metres
from poise.scanning.naming import ScannedBody, names_of
from poise.scanning.options import ScanOptions
from poise.scanning.placing import Sweep
from poise.scanning.poses import CameraPoses, hand_eye_of
from poise.scanning.reading import (
    MOST_FRAMES,
    PoseSource,
    SweepOptions,
    camera_of,
    fixed_transforms,
    read_sweep,
    transform_of,
)
from poise.scanning.scan import Scan, places_of, scan, scan_sweep
from poise.scanning.session import STATIONARY_FRAMES, RobotLog, ScanSession, SessionOptions
from poise.scanning.standing import StandingMesh, standing_mesh, united_surfaces
from poise.scanning.sweep import Ring, plan_sweep
from poise.scanning.viewpoints import Coverage, ViewOptions, ViewRegion, chosen_places

__all__ = [
    "MOST_FRAMES",
    "STATIONARY_FRAMES",
    "Camera",
    "CameraPoses",
    "Coverage",
    "Frame",
    "PoseSource",
    "Ring",
    "RobotLog",
    "Scan",
    "ScanOptions",
    "ScanSession",
    "ScannedBody",
    "SessionOptions",
    "StandingMesh",
    "Sweep",
    "SweepOptions",
    "View",
    "ViewOptions",
    "ViewRegion",
    "camera_of",
    "chosen_places",
    "columns_of",
    "depth_in_metres",
    "fixed_transforms",
    "frame_of_cloud",
    "hand_eye_of",
    "names_of",
    "places_of",
    "plan_sweep",
    "read_sweep",
    "scan",
    "scan_ply",
    "scan_sweep",
    "standing_mesh",
    "transform_of",
    "united_surfaces",
]
