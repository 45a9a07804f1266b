"""The profiles: which robot records what, at which rates, with which noise, clocks and filters."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Profile:
    """One way in which a rig records.

    Args:
        robot: key of ROBOTS. mobile: on a base that drives, with odometry.
        wrench, effort, commands: what is recorded besides joint positions.
        motions: names of MOTIONS. seconds: shortest and longest.
        wrench_rate, joint_rate: Hz.
        noise: family of NOISES, of the wrench. force: N, one standard deviation; torque is LEVER times as many N m.
        effort_noise: family, of the efforts; effort_level: factor on the robot's usual level.
        encoder: factor on the robot's usual noise. bits: counts per turn (or 0.5 m) as a power of two; 0: not rounded.
        velocity: `measured`, `filtered` (differences of the encoder behind a filter), `absent`.
        odometry: m and m/s (rad, rad/s of the yaw), one standard deviation at 50 Hz.
        clock: `steady`, `jitter`, `late` (stamps on arrival). skew: ppm of the joint clock.
        lost: share of messages that are dropped, a few together.
        filtering: `none`, `driver` (causal, 90 Hz), `offline` (both ways, 12 Hz, all signals).
    """

    name: str
    robot: str
    mobile: bool = False
    wrench: bool = True
    effort: bool = False
    commands: bool = False
    motions: tuple[str, ...] = ("trapezoidal", "pick_and_place", "multi_sine")
    seconds: tuple[float, float] = (20.0, 45.0)
    wrench_rate: float = 100.0
    joint_rate: float = 125.0
    noise: str = "white"
    force: float = 0.1
    effort_noise: str = "white"
    effort_level: float = 1.0
    encoder: float = 1.0
    bits: int = 0
    velocity: str = "measured"
    odometry: tuple[float, float] = (1e-3, 5e-3)
    clock: str = "jitter"
    skew: float = 20.0
    lost: float = 0.0
    filtering: str = "none"


PROFILES = (
    Profile("ur10_rolling_coarse", "ur10", mobile=True, motions=("trapezoidal", "pick_and_place")),
    Profile(
        "ur10_rolling_fine",
        "ur10",
        mobile=True,
        effort=True,
        commands=True,
        motions=("multi_sine", "trapezoidal"),
        noise="first_order",
        odometry=(2e-4, 1e-3),
        lost=0.02,
    ),
    Profile(
        "ur10_smoothed",
        "ur10",
        effort=True,
        motions=("multi_sine", "trapezoidal"),
        seconds=(30.0, 60.0),
        joint_rate=100.0,
        noise="first_order",
        effort_noise="first_order",
        filtering="offline",
        clock="steady",
    ),
    Profile(
        "fr3_fast",
        "fr3",
        effort=True,
        motions=("trapezoidal", "multi_sine", "jogging"),
        seconds=(10.0, 25.0),
        wrench_rate=500.0,
        joint_rate=1000.0,
        noise="heavy_tailed",
        force=0.15,
        effort_noise="heavy_tailed",
        clock="steady",
    ),
    Profile(
        "fr3_efforts",
        "fr3",
        wrench=False,
        effort=True,
        commands=True,
        joint_rate=250.0,
        effort_noise="first_order",
        velocity="filtered",
    ),
    Profile(
        "xarm7_driver",
        "xarm7",
        motions=("jogging", "trapezoidal"),
        seconds=(25.0, 60.0),
        wrench_rate=200.0,
        joint_rate=100.0,
        noise="white",
        force=0.2,
        encoder=0.0,
        bits=16,
        velocity="absent",
        filtering="driver",
        clock="late",
    ),
    Profile(
        "xarm7_teaching",
        "xarm7",
        effort=True,
        motions=("jogging", "pick_and_place"),
        seconds=(25.0, 60.0),
        wrench_rate=50.0,
        joint_rate=100.0,
        noise="quantised",
        effort_noise="quantised",
        effort_level=2.0,
        bits=15,
        velocity="filtered",
        clock="late",
        lost=0.05,
        skew=40.0,
    ),
    Profile(
        "one_axis_efforts",
        "one_axis",
        wrench=False,
        effort=True,
        commands=True,
        seconds=(10.0, 30.0),
        joint_rate=1000.0,
        effort_noise="band_limited",
        bits=17,
        encoder=0.0,
        velocity="absent",
        clock="steady",
    ),
    Profile(
        "gantry_sensor",
        "gantry",
        effort=True,
        motions=("trapezoidal", "multi_sine"),
        wrench_rate=200.0,
        joint_rate=200.0,
        noise="band_limited",
        bits=19,
        velocity="filtered",
    ),
    Profile(
        "gantry_efforts",
        "gantry",
        wrench=False,
        effort=True,
        motions=("trapezoidal", "pick_and_place", "jogging"),
        joint_rate=200.0,
        effort_noise="quantised",
        bits=18,
        velocity="absent",
        clock="jitter",
    ),
)

BY_NAME = {profile.name: profile for profile in PROFILES}
