"""Parameters of robustness_server."""

from poise.assembly.robustness import MAX_MAP_POINTS
from poise.nodes.assembly_markers import MOST_DRAWN
from poise.nodes.parameters import WORDS, Parameter

ROBUSTNESS_SERVER_PARAMETERS = (
    Parameter("scene", "", "scene file to begin with, or package:// URI; empty: none"),
    Parameter("frame_id", "world", "frame of the poses of that scene (on a mobile base: the tray's)"),
    Parameter("follow", False, "world_model keeps the assembly: take it from the topic, and do not serve set_assembly"),
    Parameter("waiting", 200, "calls that may wait; further calls are refused with BUSY", (1, 10_000)),
    Parameter("waiting_heavy", 20, "maps, plans and other heavy calls that may wait besides", (1, 10_000)),
    Parameter("longest", 30.0, "longest deadline, and that of calls without one, s", (0.01, 3600.0), dynamic=True),
    Parameter("workers", 2, "processes that compute; one is kept free of heavy calls if there are several", (1, 64)),
    Parameter("worker_memory", 4096, "MB of memory that one worker may take", (256, 1_000_000)),
    Parameter("poses_from_tf", False, "poses of movable objects are those of the tf frames named by their ids"),
    Parameter("tf_rate", 5.0, "Hz at which tf is read", (0.1, 50.0)),
    Parameter("tf_tolerance", 0.0005, "m and rad; smaller motions in tf are ignored", (0.0, 1.0), dynamic=True),
    Parameter("pose_std_position", 0.0, "m, one sigma of each coordinate of poses that state none", (0.0, 1.0)),
    Parameter("pose_std_rotation_deg", 0.0, "degrees, one sigma of their angles about each axis", (0.0, 45.0)),
    Parameter("samples", 59, "draws of uncertain poses for the intervals of a call; 0: no intervals", (0, 10_000)),
    Parameter(
        "mesh_folders", WORDS, "folders in which files named by mesh_uri may lie, besides packages' share folders"
    ),
    Parameter("most_objects", 2000, "largest number of objects of one call", (1, 100_000), dynamic=True),
    Parameter("most_pushes", 10_000, "largest number of pushes of one call", (1, 1_000_000), dynamic=True),
    Parameter(
        "most_map_points", 100_000, "largest number of map points of one call", (1, MAX_MAP_POINTS), dynamic=True
    ),
    Parameter(
        "most_triangles", 500_000, "largest number of mesh triangles of one call", (1, 100_000_000), dynamic=True
    ),
    Parameter("most_bytes", 64_000_000, "size of the largest call, bytes", (1000, 2_000_000_000), dynamic=True),
    Parameter("marker_map_points", 0, "points of the map in the markers of a new assembly; 0: none", (0, MOST_DRAWN)),
)
