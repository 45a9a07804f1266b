"""`poise excite`: a motion that weighs a payload, as a trajectory file and a picture."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress

from poise.assembly.scene import load_mesh
from poise.commands.output import JsonOption, console, refuse_folder, write_json
from poise.errors import ErrorCode, InputError
from poise.excitation import (
    COLLABORATIVE_SPEED,
    ExcitationOptions,
    ExcitationPlan,
    Guard,
    MotionLimits,
    plan_excitation,
    plan_stop_and_go,
    tool_centre,
    write_plan,
)
from poise.inertia.model import Parts, about_com_jacobian
from poise.robot import RobotModel
from poise.simulation import home
from poise.types import Array

RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF file, or fr3, xarm7, ur5e, ur10e or ridgeback_ur10.", show_default=False
    ),
]
StartOption = Annotated[
    str | None,
    typer.Option("--start", metavar="Q1,Q2,..", help="Joint positions, rad (default: mid-range).", show_default=False),
]
RadiusOption = Annotated[
    float, typer.Option("--radius", help="m: largest distance of the object from the tool centre point.")
]
ObjectMeshOption = Annotated[
    Path | None,
    typer.Option(
        "--object", metavar="MESH", help="Its shape in the sensor frame, m, in place of --radius.", show_default=False
    ),
]
StopAndGoOption = Annotated[bool, typer.Option("--stop-and-go", help="Stop in a few poses instead; the safest motion.")]
DurationOption = Annotated[float, typer.Option("--duration", help="Duration of the optimal motion, s.")]
PosesOption = Annotated[int, typer.Option("--poses", help="Number of poses to stop in.")]
DwellOption = Annotated[float, typer.Option("--dwell", help="Time at rest in each pose, s.")]
SpeedOption = Annotated[
    float, typer.Option("--speed", help="Largest speed of the tool centre point and the object, m/s.")
]
AccelerationOption = Annotated[
    float, typer.Option("--acceleration", help="Largest acceleration of each joint, rad/s2.")
]
RoomOption = Annotated[
    float, typer.Option("--room", help="Largest distance of the tool centre point from its start, m.")
]
MassOption = Annotated[float, typer.Option("--mass", help="Approximate mass of the payload, kg.")]
_SensorFrameOption = Annotated[str, typer.Option("--sensor-frame", help="Frame of the wrench.")]
TcpOption = Annotated[str, typer.Option("--tcp", help="Frame of the tool centre point; empty: the sensor's.")]
SeedOption = Annotated[int, typer.Option("--seed", help="Equal seeds give equal motions.", min=0)]
OutOption = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Write the trajectory (YAML).", show_default=False)
]
_PictureOption = Annotated[
    Path | None, typer.Option("--picture", metavar="FILE", help="Draw it (PNG or SVG).", show_default=False)
]


def excite(
    robot: RobotArgument,
    start: StartOption = None,
    radius: RadiusOption = 0.15,
    object_mesh: ObjectMeshOption = None,
    stop_and_go: StopAndGoOption = False,
    duration: DurationOption = 1.5,
    poses: PosesOption = 5,
    dwell: DwellOption = 0.75,
    speed: SpeedOption = COLLABORATIVE_SPEED,
    acceleration: AccelerationOption = 10.0,
    room: RoomOption = 0.15,
    mass: MassOption = 1.0,
    sensor_frame: _SensorFrameOption = "ft_sensor",
    tcp: TcpOption = "tcp",
    seed: SeedOption = 0,
    out: OutOption = None,
    picture: _PictureOption = None,
    json_target: JsonOption = None,
) -> None:
    """Plan a slow joint motion that reveals the inertial parameters of the payload.

    From where the robot is, and back to rest there: joint motions with the most information about mass, centre of
    mass, inertia and sensor bias, within the joints' limits, and with both the tool centre point and the object's
    farthest point under the speed limit at every instant (0.25 m/s: ISO/TS 15066). The file can be played by
    `fake_robot`, and by any controller of joint trajectories.

    Example:  poise excite fr3 --radius 0.12 --out motion.yaml --picture motion.png
    """
    refuse_folder(json_target, "--json")
    model = RobotModel.from_file(robot, sensor_frame)
    guard, parts = _guard(tool_centre(model, tcp), radius, object_mesh)
    limits = MotionLimits(speed=speed, acceleration=acceleration, room=room)
    options = ExcitationOptions(duration=duration, poses=poses, dwell=dwell, mass=mass, seed=seed)
    people = console(json_target)
    begin = home(model) if start is None else _numbers(start)
    planner = plan_stop_and_go if stop_and_go else plan_excitation
    with Progress(console=people, transient=True) as bar:
        show = partial(bar.update, bar.add_task("planning", total=1.0))
        plan = planner(model, begin, guard, limits, options, parts=parts, progress=lambda done: show(completed=done))
    kind = "stop_and_go" if stop_and_go else "excitation"
    remark = f"{kind} of {robot}: poise excite, seed {seed}, at most {speed:g} m/s"
    written = [] if out is None else [write_plan(out, plan, remark)]
    if picture is not None:
        from poise.viewing import excitation_panels, write_picture  # drawing libraries load slowly

        written.append(write_picture(excitation_panels(model, plan, guard, speed), picture, columns=2))
    write_json(json_target, {"robot": robot, "kind": kind, "speed_limit": speed, **as_json(plan)})
    _say(people, plan, speed, written)


def _say(people: Console, plan: ExcitationPlan, speed: float, written: list[Path]) -> None:
    for line in sentences(plan, speed):
        people.print(line, soft_wrap=True)
    for path in written:
        people.print(f"written: {path}", markup=False, soft_wrap=True)


def as_json(plan: ExcitationPlan) -> dict[str, Any]:
    """What is known of a plan, SI units."""
    proof, about_com = plan.certificate, _about_com_std(plan)
    return {
        "joints": plan.joint_names,
        "start": plan.motion.position[0],
        "duration": proof.duration,
        "speed": proof.speed,
        "joint_speed_share": proof.joint_speed,
        "joint_acceleration": proof.acceleration,
        "room": proof.room,
        "information": plan.information,
        "expected_std": {"mass": plan.mass_std, "com": about_com[:3], "inertia": about_com[3:]},
        "waypoints": len(plan.motion.times),
    }


def sentences(plan: ExcitationPlan, limit: float) -> list[str]:
    """The same for people."""
    proof, about_com = plan.certificate, _about_com_std(plan)
    diagonal = np.sqrt(np.mean(about_com[[3, 6, 8]] ** 2))
    return [
        f"{proof.duration:.2f} s, ends at rest where it began; the tool centre point stays within {proof.room:.3f} m",
        f"certified at every instant: {proof.speed:.3f} of {limit:g} m/s, joints at {proof.joint_speed:.0%} of their"
        f" speed limits and {proof.acceleration:.1f} rad/s²",
        f"{plan.information:.0f} nats; remaining uncertainty of a payload of {plan.belief.phi[0]:g} kg, one sigma:"
        f" {plan.mass_std * 1e3:.2g} g, {1e3 * float(np.max(about_com[:3])):.2g} mm, {1e6 * diagonal:.2g} kg mm²",
    ]


def _guard(tcp: Array, radius: float, mesh: Path | None) -> tuple[Guard, Parts | None]:
    if mesh is None:
        return Guard.ball(tcp, radius), None
    shape = load_mesh(str(mesh))
    return Guard.outline(tcp, shape.vertices), Parts.from_surface(shape.vertices, shape.triangles)


def _numbers(text: str) -> Array:
    try:
        return np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise InputError(
            ErrorCode.BAD_INPUT, f"--start '{text}': give joint positions in rad, separated by commas"
        ) from error


def _about_com_std(plan: ExcitationPlan) -> Array:
    """(9,) centre of mass m, inertia about it kg m2, one sigma."""
    jacobian = about_com_jacobian(plan.belief.phi)
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", jacobian, plan.covariance, jacobian)))
