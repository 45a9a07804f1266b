"""Makes the committed bags and their manifest from the CSV files of the KUKA recording (doi 10.5281/zenodo.11096791).

    python tools/convert_kuka_recording.py FOLDER_OF_CSV_FILES [--output bags]

The columns: forces N and torques N m in the sensor frame, what the load exerts on the sensor (at rest f = m g plus a
bias); accelerations in g, specific force in the IMU's axes; times in microseconds; r11..r33 the rotation
world <- sensor, row by row, world z up. Running it twice gives the same bytes.
"""

import argparse
import hashlib
import sys
from pathlib import Path

import numpy as np
import yaml

from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import STANDARD_GRAVITY
from poise.recording import ImuStream, PoseStream, Stream, WrenchStream, open_recording, write_recording
from poise.types import Array, Stamps

Columns = dict[str, Array]

GRAVITY = 9.82085  # m/s2 where it was recorded: the length of (gx, gy, gz) in the calibration file
WRENCH_RATE, IMU_RATE = 700.0, 254.0  # Hz, of the steady-state files, which have no times
DWELL, PERIOD = 800_000_000, 1_000_000_000  # ns, invented for the static poses, which have no times either
# x_imu = -z_sensor, y_imu = -x_sensor, z_imu = y_sensor: the only signed permutation that fits the 24 static poses.
ROTATION_SENSOR_IMU = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])

DOI = "10.5281/zenodo.11096791"
LICENCE = "CC BY 4.0"
METADATA = {"poise": {"gravity": str(GRAVITY), "source": f"doi {DOI}, A. Skrede", "licence": LICENCE}}
NO_POSITION = "The recording has no position: the translations of tf are zero, only the rotations mean something."
STATIC_NOTES = (
    "24 poses at rest. Each wrench and acceleration is the average over one pose, and has no time: the poses are one "
    "second apart, tf stands at the start and the end of a dwell of 0.8 s, wrench and imu in its middle. " + NO_POSITION
)
MOTION_NOTES = "Free motion of the arm. The clocks of wrench, imu and tf are not aligned. " + NO_POSITION
VIBRATION_NOTES = (
    "The same motion while the arm is shaken. The clocks of wrench, imu and tf are not aligned. " + NO_POSITION
)
REST_NOTES = (
    "The sensor at rest, for its noise. The files have no times: the stamps count from 0 at 700 Hz (wrench) and 254 Hz "
    "(imu), so nothing relates the two. No orientation was recorded."
)


def read_columns(path: Path, names: str) -> Columns:
    """Read a CSV file that has these columns.

    Raises:
        InputError: FILE_UNREADABLE, or FILE_CORRUPT when a column is missing or a value is not a finite number.
    """
    try:
        lines = path.read_text().split()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error}") from error
    there = lines[0].split(",") if lines else []
    missing = [name for name in names.split(",") if name not in there]
    if missing or len(lines) < 2:
        sentence = f"{path} has no {'column ' + ', '.join(missing) if missing else 'rows'}: download it again"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence)
    try:
        values = np.array([[float(value) for value in line.split(",")] for line in lines[1:]])
    except ValueError as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} is not a table of numbers ({error})") from error
    if not np.isfinite(values).all():
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path} holds values that are not finite: download it again")
    return dict(zip(there, values.T, strict=True))


def wrench_stream(columns: Columns, stamps: Stamps) -> WrenchStream:
    """Take the wrench as it is: its sign is the contract's."""
    return WrenchStream(stamps, stack(columns, "fx,fy,fz,tx,ty,tz"), "ft_sensor")


def imu_stream(columns: Columns, stamps: Stamps) -> ImuStream:
    """Turn g into m/s2; the device measures no angular velocity."""
    acceleration = stack(columns, "ax,ay,az") * STANDARD_GRAVITY
    return ImuStream(stamps, np.full_like(acceleration, np.nan), acceleration, "imu")


def pose_stream(columns: Columns, stamps: Stamps) -> PoseStream:
    """Take the nearest rotation to each matrix, which is rounded to six digits (Kabsch 1976), at the origin."""
    matrices = stack(columns, "r11,r12,r13,r21,r22,r23,r31,r32,r33").reshape(-1, 3, 3)
    left, _, right = np.linalg.svd(matrices)
    return PoseStream(stamps, left @ right, np.zeros((len(stamps), 3)), "base", "ft_sensor")


def imu_mounting(stamp: int) -> PoseStream:
    """How the IMU is turned against the sensor."""
    return PoseStream(np.array([stamp]), ROTATION_SENSOR_IMU[None], np.zeros((1, 3)), "ft_sensor", "imu")


def stack(columns: Columns, names: str) -> Array:
    return np.stack([columns[name] for name in names.split(",")], axis=1)


def recorded_stamps(columns: Columns) -> Stamps:
    return np.round(columns["t"]).astype(np.int64) * 1000  # microseconds, exact in a float64


def convert_static(folder: Path) -> dict[str, Stream]:
    """Spread the static poses over time, see STATIC_NOTES."""
    names = "fx,fy,fz,tx,ty,tz,ax,ay,az,r11,r12,r13,r21,r22,r23,r31,r32,r33"
    columns = read_columns(folder / "0-calibration_fts-accel.csv", names)
    starts = np.arange(len(columns["fx"])) * PERIOD
    middles = starts + DWELL // 2
    dwells = np.stack([starts, starts + DWELL], axis=1).ravel()
    twice = {name: np.repeat(values, 2) for name, values in columns.items()}
    return {
        "wrench": wrench_stream(columns, middles),
        "imu": imu_stream(columns, middles),
        "tf": pose_stream(twice, dwells),
        "tf_static": imu_mounting(0),
    }


def convert_motion(folder: Path, prefix: str) -> dict[str, Stream]:
    """Take the three files of a motion with the times they have."""
    wrench = read_columns(folder / f"{prefix}_wrench.csv", "t,fx,fy,fz,tx,ty,tz")
    imu = read_columns(folder / f"{prefix}_accel.csv", "t,ax,ay,az")
    poses = read_columns(folder / f"{prefix}_orientations.csv", "t,r11,r12,r13,r21,r22,r23,r31,r32,r33")
    start = min(int(recorded_stamps(columns)[0]) for columns in (wrench, imu, poses))
    return {
        "wrench": wrench_stream(wrench, recorded_stamps(wrench)),
        "imu": imu_stream(imu, recorded_stamps(imu)),
        "tf": pose_stream(poses, recorded_stamps(poses)),
        "tf_static": imu_mounting(start),
    }


def convert_rest(folder: Path) -> dict[str, Stream]:
    """Give the samples at rest the times of their rates, see REST_NOTES."""
    wrench = read_columns(folder / "0-steady-state_wrench.csv", "fx,fy,fz,tx,ty,tz")
    imu = read_columns(folder / "0-steady-state_accel.csv", "ax,ay,az")
    return {
        "wrench": wrench_stream(wrench, even_stamps(len(wrench["fx"]), WRENCH_RATE)),
        "imu": imu_stream(imu, even_stamps(len(imu["ax"]), IMU_RATE)),
        "tf_static": imu_mounting(0),
    }


def even_stamps(count: int, rate: float) -> Stamps:
    return np.round(np.arange(count) * (1e9 / rate)).astype(np.int64)


def manifest_entry(path: Path, notes: str) -> dict[str, object]:
    """Describe a bag by what is really in it."""
    recording = open_recording(path, strict=True)
    stamps = {"wrench": recording.wrench().stamps, "imu": recording.imu().stamps}
    if "tf" in recording.topics:
        stamps["tf"] = recording.poses("ft_sensor").stamps
    rates = {name: round(float((len(at) - 1) / ((at[-1] - at[0]) * 1e-9)), 1) for name, at in stamps.items()}
    topics = {
        name: {"type": kind, "messages": recording.counts[name], **({"rate": rates[name]} if name in rates else {})}
        for name, kind in sorted(recording.topics.items())
    }
    return {
        "file": path.name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "licence": LICENCE,
        "attribution": f"A. Skrede, doi {DOI}",
        "changes": "converted from CSV, rotations made orthonormal, accelerations from g to m/s2",
        "sensor": "ATI Gamma force-torque sensor and a three-axis accelerometer on a KUKA LBR Med 14, unknown payload",
        "gravity": GRAVITY,
        "topics": topics,
        "notes": notes,
    }


def convert(folder: Path, output: Path) -> None:
    """Write the four bags and manifest.yaml.

    Raises:
        InputError: FILE_UNREADABLE, FILE_CORRUPT, FILE_UNWRITABLE.
    """
    bags: dict[str, tuple[dict[str, Stream], str]] = {
        "kuka_static_poses": (convert_static(folder), STATIC_NOTES),
        "kuka_free_motion": (convert_motion(folder, "1-baseline"), MOTION_NOTES),
        "kuka_vibration": (convert_motion(folder, "2-vibrations"), VIBRATION_NOTES),
        "kuka_at_rest": (convert_rest(folder), REST_NOTES),
    }
    entries = []
    for name, (streams, notes) in bags.items():
        path = output / f"{name}.mcap"
        write_recording(path, streams, metadata=METADATA)
        entries.append(manifest_entry(path, notes))
        print(f"{path}  {path.stat().st_size / 1024:.0f} KiB")
    write_manifest(output / "manifest.yaml", entries)


def write_manifest(path: Path, entries: list[dict[str, object]]) -> None:
    """Write the manifest, whole or not at all."""
    head = "# The recordings in this folder, as made by the tools of tools/. Rates in Hz, gravity in m/s2.\n"
    draft = path.with_name(f".{path.name}.tmp")
    try:
        before = yaml.safe_load(path.read_text())["bags"] if path.exists() else []
        others = [entry for entry in before if entry["file"] not in {ours["file"] for ours in entries}]
        draft.write_text(head + yaml.safe_dump({"bags": [*entries, *others]}, sort_keys=False, width=110))
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise InputError(ErrorCode.FILE_UNWRITABLE, f"{path} cannot be written: {error.strerror}") from error


def main() -> int:
    parser = argparse.ArgumentParser(description="Make the committed bags from the CSV files of the KUKA recording.")
    parser.add_argument("folder", type=Path, help="the folder with the CSV files")
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[1] / "bags", help="where the bags go")
    arguments = parser.parse_args()
    try:
        convert(arguments.folder, arguments.output)
    except PoiseError as error:
        print(f"{error.code.name}: {error.message}", file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
