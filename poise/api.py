"""The short interface of `import poise`: one function per job; each takes paths or objects that are already loaded."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from poise.assembly import Analysis, Assembly, Push, RigidObject, assess, load_scene
from poise.assembly.robustness import Assessment
from poise.assembly.scene import read_object
from poise.errors import ErrorCode, InputError
from poise.inertia import Identification
from poise.inertia import identify as _identify
from poise.inertia.model import load_object
from poise.mismatch import Comparison, Diagnosis, NominalModel, joined, load_model, read_recording
from poise.mismatch import compare as _compare
from poise.mismatch import diagnose as _diagnose
from poise.placement import Options, Placement, plan_placement
from poise.recording import Recording, open_recording
from poise.robot import RobotModel
from poise.scanning import Scan, SweepOptions, read_sweep, scan_sweep
from poise.shape import Segmentation, read_surface, segment_surface
from poise.shape import segment as _segment
from poise.types import Array

Source = str | Path
SceneSource = Source | Assembly | Analysis
PushSource = Push | tuple[str, Sequence[float], Sequence[float]]


def read(path: Source) -> Recording:
    """Open a recording: mcap, db3, a rosbag2 folder, a ROS 1 bag, or tables with columns.yaml.

    Example:
        >>> poise.read("bags/kuka_static_poses.mcap").wrench().stamps

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, UNSUPPORTED.
    """
    return open_recording(path)


def identify(
    recording: Source | Recording, *, urdf: Source | None = None, shape: Source | None = None, **options: Any
) -> Identification:
    """Estimate mass, centre of mass and inertia of the payload in a recording.

    Args:
        recording: the wrench with joint states, tf or an IMU.
        urdf: the robot; None: the robot_description of the recording, else tf.
        shape: mesh or point cloud of the object in the sensor frame, m; None: the shape is unknown.
        options: further arguments of `poise.inertia.identify`, for example `method="static"`.

    Example:
        >>> poise.identify("bags/kuka_static_poses.mcap").estimate.parameters.mass  # kg

    Raises:
        InputError: the recording lacks a stream, or a file cannot be read.
        NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE.
    """
    bag = _recording(recording)
    if urdf is not None:
        options["robot_model"] = RobotModel.from_file(urdf, options.get("sensor_frame") or bag.wrench().frame_id)
    if shape is not None:
        known = load_object(Path(shape))
        options = {"parts": known.parts, "shape_accuracy": known.accuracy} | options
    return _identify(bag, **options)


def segment(cloud: Source | Array, colours: Array | None = None) -> Segmentation:
    """Reconstruct a closed solid from surface points and segment it into parts.

    Args:
        cloud: a file (PLY, PCD, XYZ, CSV, NPY, or a mesh: STL, OBJ, PLY), or (N, 3) points in m.
        colours: (N, 3) 0..1 of the points; a file brings its own.

    Example:
        >>> poise.segment("examples/hammer.ply").volumes  # (P,) m3

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, SCAN_INCOMPLETE, MESH_INVALID.
    """
    if isinstance(cloud, str | Path):
        found, mesh = read_surface(Path(cloud))
        return segment_surface(found, mesh, colours=found.colours)
    return _segment(cloud, colours)


def scan(recording: Source | Recording) -> Scan:
    """Fuse the camera sweep of a recording into the surface points of one object, in the robot's base frame.

    Example:
        >>> found = poise.scan("bags/hammer_sweep.mcap")
        >>> found.segmented().volumes  # (P,) m3

    Raises:
        InputError: TOPIC_MISSING, FRAME_UNKNOWN, SCAN_INCOMPLETE.
    """
    return scan_sweep(read_sweep(_recording(recording), SweepOptions()))


def robustness(scene: SceneSource, pushes: Sequence[PushSource] = (), **options: Any) -> Assessment:
    """Compute whether a scene is stable, and the force of each push at which something slips or topples.

    Args:
        scene: a scene file, or what `poise.assembly` made of one.
        pushes: each a `Push`, or (object id, point [m], direction), both in the scene's frame.
        options: further arguments of `poise.assembly.assess`: `model`, `deadline`.

    Example:
        >>> poise.robustness("examples/crate.yaml", [("crate", (-0.5, 0, 0.2), (1, 0, 0))]).results[0].robustness  # N

    Raises:
        InputError: FILE_UNREADABLE, OBJECT_UNKNOWN, POINT_OFF_SURFACE, INTERPENETRATION, FLOATING.
        NoAnswerError: SOLVER_FAILED.
    """
    return assess(_analysis(scene), [_push(push) for push in pushes], **options)


def place(
    scene: SceneSource, item: RigidObject | Mapping[str, Any], *, options: Options | None = None, seed: int = 0
) -> Placement:
    """Find a pose at which an object stays in a scene.

    Args:
        scene: a scene file, or what `poise.assembly` made of one.
        item: the object, or its entry of a scene file (without a pose) as a mapping.
        options: limits and criteria of the search; None: the defaults.
        seed: the same seed gives the same answer.

    Example:
        >>> poise.place("examples/crate.yaml", {"id": "mug", "cylinder": [0.04, 0.1], "mass": 0.3}).pose

    Raises:
        InputError: FILE_UNREADABLE, OBJECT_INVALID, INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, NO_PLACEMENT, DEADLINE.
    """
    if isinstance(item, Mapping):
        item = read_object({"id": "placed", **item}, Path(), "item")
    elif not isinstance(item, RigidObject):
        raise InputError(ErrorCode.BAD_INPUT, f"item is {item!r:.80}: give a RigidObject, or its entry of a scene file")
    return plan_placement(_analysis(scene), item, options or Options(), seed)


def diagnose(
    recordings: Source | Recording | Sequence[Source | Recording], model: Source | NominalModel | None = None
) -> Diagnosis:
    """Identify the physical effects that recordings show and the simulation of the robot lacks.

    Args:
        recordings: one, or several of the same robot and payload; the last of several is held out from all fits.
        model: model.yaml; None: the robot_description of the recording, with default tolerances.

    Example:
        >>> poise.diagnose("run.mcap", "model.yaml").findings

    Raises:
        InputError: a recording lacks a stream, or a file cannot be read.
    """
    several = [recordings] if isinstance(recordings, str | Path | Recording) else list(recordings)
    model = _model(model)
    first = read_recording(_recording(several[0]), model)
    readings = [first, *(read_recording(_recording(other), first.model) for other in several[1:])]
    recorded, last = joined([reading.recorded for reading in readings])
    return _diagnose(recorded, first.model, last if last.any() else None)


def compare(a: Source | Recording, b: Source | Recording, model: Source | NominalModel | None = None) -> Comparison:
    """Identify what changed from recording A to recording B of one robot; both are of the same motion.

    Args:
        a, b: before and after.
        model: model.yaml; None: the robot_description of A, with default tolerances.

    Example:
        >>> poise.compare("before.mcap", "after.mcap", "model.yaml").changes

    Raises:
        InputError: a recording lacks a stream, or the joints differ.
        NoAnswerError: NOT_IDENTIFIABLE when the motions differ.
    """
    first = read_recording(_recording(a), _model(model))
    return _compare(first.recorded, read_recording(_recording(b), first.model).recorded, first.model)


def _model(source: Source | NominalModel | None) -> NominalModel:
    if isinstance(source, NominalModel):
        return source
    return NominalModel() if source is None else load_model(Path(source))


def _push(source: PushSource) -> Push:
    if isinstance(source, Push):
        return source
    try:
        name, point, direction = source
    except (TypeError, ValueError) as error:
        what = f"push {source!r:.80}: give a Push, or (object id, point, direction)"
        raise InputError(ErrorCode.BAD_INPUT, what) from error
    return Push(name, point, direction)


def _recording(source: Source | Recording) -> Recording:
    return source if isinstance(source, Recording) else open_recording(source)


def _analysis(scene: SceneSource) -> Analysis:
    return Analysis.of(load_scene(Path(scene)) if isinstance(scene, str | Path) else scene)
