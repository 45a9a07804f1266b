"""The rigs: where their published files are, how they become recordings, and what structure their makers identified."""

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from poise.recording import JointStream, Recording, joint_commands, open_recording, write_recording

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "recordings"
RECORDING, VALIDATION = "recording.mcap", "validation.mcap"


@dataclass(frozen=True)
class Structure:
    """The terms of a least-squares model, and how the signals are filtered before the fit.

    Viscous and Coulomb friction and an offset of every joint are always part of it.

    Args:
        links: the ten inertial parameters of every link are estimated; otherwise those of the URDF are taken.
        rotor: an inertia at every joint that acts on its acceleration.
        gain: the URDF's torque of each joint is scaled, for motor constants that are not known well.
        couplings: pairs of joints (from 0) whose motors are coupled: the second motor turns with both joints.
        cutoff: Hz of the zero-phase Butterworth filter on positions; 0 to take velocities as recorded.
        decimation: of the filtered equations.
        dead_band: rad/s (m/s) below which a joint's samples are left out of the fit: Coulomb friction jumps there.
        edge: samples left out at both ends, where derivatives and filters are not valid.
    """

    links: bool = False
    rotor: bool = False
    gain: bool = False
    couplings: tuple[tuple[int, int], ...] = ()
    cutoff: float = 0.0
    decimation: int = 1
    dead_band: float = 0.0
    edge: int = 5


@dataclass(frozen=True)
class Rig:
    """A rig.

    Args:
        name: of its folder.
        title: for tables.
        convert: writes the recordings from the folder of published files into an empty folder.
        structure: of the least-squares model; None where nothing was published to compare it with.
    """

    name: str
    title: str
    convert: Callable[[Path, Path], None]
    structure: Structure | None = None


def mapped(mapping: Path, source: Path, target: Path) -> None:
    """Write the recording of tables with this mapping."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) / "tables"
        place.mkdir()
        for file in source.iterdir():
            if file.is_file():
                shutil.copy(file, place / file.name)
        shutil.copy(mapping, place / "columns.yaml")
        _write(open_recording(place), target / RECORDING)


def _write(recording: Recording, path: Path) -> None:
    """Write joint states, commands and the URDF."""
    streams = {"joint_states": recording.joint_states()}
    if "joint_commands" in recording.topics:
        streams["joint_commands"] = recording.joint_states("joint_commands")
    write_recording(path, streams, robot_description=recording.robot_description())


def convert_emps(_source: Path, target: Path) -> None:
    """EMPS lies in this repository."""
    _write(open_recording(EXAMPLES / "emps"), target / RECORDING)


def convert_tx40(source: Path, target: Path) -> None:
    """Two tables of motor positions and torques."""
    mapped(EXAMPLES / "tx40.yaml", source / "tx40", target)


def convert_ur10(source: Path, target: Path) -> None:
    """Two .db3 files: joint states, and a measured trajectory as one message."""
    folder = source / "ur10_unisa"
    urdf = (folder / "ur10_robot.urdf").read_text()
    files = {RECORDING: "ur10_exciting_trajectory.db3", VALIDATION: "validation_trajectory.db3"}
    readers: dict[str, Callable[[Recording], JointStream]] = {
        RECORDING: lambda recording: recording.joint_states(),
        VALIDATION: joint_commands,
    }
    for name, file in files.items():
        joints = readers[name](open_recording(folder / file))
        write_recording(target / name, {"joint_states": joints}, robot_description=urdf)


def convert_so101(source: Path, target: Path) -> None:
    """Tables with lists in their cells; the URDF lies beside the motions."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        for file in (*(source / "so101" / "friction_gravity").iterdir(), source / "so101" / "so101_new_calib.urdf"):
            shutil.copy(file, place / file.name)
        mapped(EXAMPLES / "so101.yaml", place, target)


def convert_kuka(_source: Path, target: Path) -> None:
    """The arm that is shaken lies in this repository."""
    shutil.copy(ROOT / "bags" / "kuka_vibration.mcap", target / RECORDING)


RIGS = (
    Rig("emps", "EMPS, one axis", convert_emps, Structure(links=True, cutoff=40.0, decimation=25, edge=20)),
    Rig(
        "tx40",
        "Staubli TX40",
        convert_tx40,
        Structure(links=True, rotor=True, couplings=((4, 5),), cutoff=100.0, decimation=50, dead_band=0.05, edge=100),
    ),
    Rig("ur10", "UR10", convert_ur10, Structure(rotor=True, gain=True)),
    Rig("so101", "SO-101", convert_so101),
    Rig("kuka", "KUKA, shaken", convert_kuka),
)
