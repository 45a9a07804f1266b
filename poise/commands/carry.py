"""`poise carry`: how an arm takes an object from where it lies to where it stays."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from poise.assembly import RigidObject
from poise.commands.assembly_pictures import ScenePictureOption, refuse_folders
from poise.commands.output import JsonOption, console, number_for_json, write_json
from poise.commands.place import (
    AttemptsOption,
    AxesOption,
    CandidatesOption,
    KeepFreeOption,
    OnOption,
    OutputOption,
    PlacementSeedOption,
    RobustOption,
    UpAxes,
    UprightOption,
    content_of,
    failure_of,
    looks_of,
    print_answer,
    read_spec,
    watching,
)
from poise.commands.scenes import SceneArgument, open_scene
from poise.errors import NoAnswerError
from poise.manipulation import Arm, Limits, Reach, Transfer, plan_transfer, pose_of, require_room, standing_at
from poise.placement import Options, Uncertainty, plan_placement
from poise.worlds import save_scene

SpecOption = Annotated[
    str,
    typer.Option(
        "--object",
        metavar="SPEC",
        help="Object to carry, as an entry of a scene file with its present pose: a YAML or JSON file, or the text.",
        show_default=False,
    ),
]
RobotOption = Annotated[
    str, typer.Option("--robot", help="fr3, xarm7, ur5e, ur10e, ridgeback_ur10, or the path of a URDF.")
]
BaseOption = Annotated[
    tuple[float, float, float, float],
    typer.Option("--base", metavar="X Y Z YAW", help="Where the robot stands in the scene, m and rad."),
]
_TcpOption = Annotated[str, typer.Option("--tcp", help="URDF frame between the finger tips, z out of the hand.")]
_SpeedOption = Annotated[float, typer.Option("--speed", help="Largest speed of the tool, m/s.", min=0.01, max=2.0)]
WaysOption = Annotated[float, typer.Option("--seconds", help="Time limit for planning paths of the arm, s.", min=0.1)]


def carry(
    scene: SceneArgument,
    spec: SpecOption,
    robot: RobotOption = "fr3",
    base: BaseOption = (0.0, 0.0, 0.0, 0.0),
    tcp: _TcpOption = "tcp",
    seed: PlacementSeedOption = 0,
    attempts: AttemptsOption = 500,
    candidates: CandidatesOption = 1,
    on: OnOption = "any",
    robust: RobustOption = False,
    speed: _SpeedOption = 0.5,
    seconds: WaysOption = 10.0,
    upright: UprightOption = False,
    axes: AxesOption = None,
    keep_free: KeepFreeOption = None,
    output: OutputOption = None,
    picture: ScenePictureOption = None,
    json_target: JsonOption = None,
) -> None:
    """Plan the arm motion that picks up an object and places it in a stable pose.

    Example:  poise carry scene.yaml --object '{id: box, box: [0.05, 0.05, 0.1], mass: 0.2, pose: [0.4, -0.4, 0.05, 0,
    0, 0, 1]}' --robot fr3 --json plan.json
    """
    refuse_folders(json_target, picture, None)
    up_axes: UpAxes = {}
    item, analysis = read_spec(spec, needs="pose", up_axes=up_axes), open_scene(scene)
    require_room(analysis, item)
    reach = Reach(Arm.load(robot, standing_at(base), tcp_frame=tcp), analysis, item, seed=seed)
    looks = (*looks_of(analysis, keep_free, upright, axes, up_axes), *reach.looks)
    uncertainty = Uncertainty() if robust else None
    options = Options(attempts, candidates=candidates, on=on, uncertainty=uncertainty, tests=reach.tests, looks=looks)
    people = console(json_target)
    known: dict[str, Any] = {}
    try:
        reach.require_pick()
        with watching(people, attempts) as report:
            found = plan_placement(analysis, item, options, seed, report)
        known = content_of(found)
        transfer = plan_transfer(reach, found.analysis, found.item, Limits(speed=speed), seconds, seed)
    except NoAnswerError as error:
        write_json(json_target, known | failure_of(error))
        raise
    write_json(json_target, known | _content(reach, transfer))
    if output is not None:
        save_scene(found.analysis.assembly, output)
    print_answer(people, found)
    _print_motion(people, reach, transfer, found.item, picture)


def _print_motion(people: Console, reach: Reach, transfer: Transfer, placed: RigidObject, picture: Path | None) -> None:
    """Print what the motion is like, and draw it."""
    moving = sum(phase.seconds for phase in transfer.phases)
    people.print(f"the grip holds it up to {transfer.ends.hold:.3g} m/s2; {moving:.1f} s of motion")
    if picture is not None:
        from poise.viewing import transfer_panel, write_picture

        people.print(f"written: {write_picture([transfer_panel(reach, transfer, placed)], picture)}")


def _content(reach: Reach, transfer: Transfer) -> dict[str, Any]:
    ends = transfer.ends
    return {
        "grasp": {"object_tcp": pose_of(transfer.grasp.object_tcp).vector, "width": transfer.grasp.width},
        "hold": ends.hold,
        "approach": {"direction": ends.approach, "robustness": number_for_json(ends.forgiving)},
        "joint_names": reach.arm.joint_names,
        "phases": [
            {
                "name": phase.name,
                "opening": phase.opening,
                "holding": phase.holding,
                "motions": [
                    {name: getattr(motion, name) for name in ("times", "position", "velocity", "acceleration")}
                    for motion in phase.motions
                ],
            }
            for phase in transfer.phases
        ],
        "planning": transfer.seconds,
    }
