"""The command `poise`, one subcommand per job; a subcommand is imported when it runs or shows its own help."""

import errno
import gc
import importlib
import io
import os
import sys
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from poise.errors import InputError, PoiseError

INTERRUPTED = 130
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
INTERNAL_ERROR = 1

COMMANDS = {
    "identify": ("identify", "Estimate mass, centre of mass and inertia of the payload on a force-torque sensor."),
    "evaluate": ("evaluate", "Run a job over many recordings, clouds or scenes and compare the results."),
    "excite": ("excite", "Plan a slow joint motion that reveals the inertial parameters of the payload."),
    "scan": ("scan", "Reconstruct an object on a table from a camera sweep and segment it into parts."),
    "calibrate": ("calibrate", "Estimate where a camera sits on the hand, and the zero offsets of the joints."),
    "segment": ("segment", "Segment a surface point cloud or a closed mesh into parts and compute their volumes."),
    "scene": ("scene", "Convert a world of Gazebo, MuJoCo, URDF or MoveIt into a scene file, or a scene into one."),
    "robustness": ("assembly", "Compute the force that each object of a scene withstands before something moves."),
    "msa": ("assembly", "Compute the maximum safe acceleration of a base in each direction."),
    "disassemble": ("assembly", "Find an order in which a scene can be taken apart without moving other objects."),
    "sensitivity": (
        "sensitivity",
        "Differentiate robustness with respect to masses, poses, friction and the push.",
    ),
    "place": ("place", "Find a stable placement for one or more objects in a scene."),
    "carry": ("carry", "Plan the arm motion that picks up an object and places it in a stable pose."),
    "mismatch": ("mismatch", "Identify the physical effects that a recording shows and the simulation lacks."),
    "compare": (
        "compare",
        "Identify what changed from one recording of a robot to another, or from several to several.",
    ),
    "rollout": (
        "rollout",
        "Run MuJoCo models freely from recorded states, and compare their motion and wrench with the recording.",
    ),
    "simulate": ("simulate", "Simulate the sensor and the joints along a motion and write a recording."),
    "loop": ("loop", "Run the whole loop on a fake robot: scan, pick, weigh, place and carry unknown objects."),
    "run": ("run", "Start a ROS 2 node of Poise; works without ros2cli."),
    "keystore": ("keystore", "Make an SROS 2 keystore with the least permissions that nodes need."),
}
"""Subcommand -> (file in poise/commands that defines it, first line of its help)."""


class LazyGroup(TyperGroup):
    """Lists the subcommands from the table above and imports only the one that is called."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        if args and args[0] in COMMANDS:
            self.commands[args[0]] = load_command(args[0])
        return super().resolve_command(ctx, args)


def load_command(name: str) -> Any:
    """Import a subcommand and build its parser."""
    module = importlib.import_module(f"poise.commands.{COMMANDS[name][0]}")
    if not gc.isenabled():
        gc.freeze()  # modules stay: they are not searched for cycles
        gc.enable()
    function = getattr(module, name)
    single = typer.Typer(add_completion=False, rich_markup_mode="markdown", pretty_exceptions_enable=False)
    single.command(name, context_settings=getattr(module, "CONTEXT_SETTINGS", None))(function)
    return typer.main.get_command(single)


def _placeholder() -> None:
    """Stand in the list of subcommands for a function that is not imported yet."""


app = typer.Typer(
    cls=LazyGroup,
    help="Weigh what a robot holds, compute how hard a stack can be pushed, and find stable placements.",
    epilog="Exit status: 0 done, 2 bad input, 3 the job has no answer, 1 an internal error.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
for _name, (_, _help) in COMMANDS.items():
    app.command(_name, help=_help)(_placeholder)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        from poise.kernels import COMPILED

        print(f"poise {version('poise')}")
        if not COMPILED:
            print(
                "without the compiled kernels, which only make it faster: reinstall Poise where there is a C compiler"
            )
        raise typer.Exit


@app.callback()
def main_options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error (also: POISE_DEBUG=1).")
    ] = False,
) -> None:
    """Weigh what a robot holds, compute how hard a stack can be pushed, and find stable placements."""


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit status; every error is one line on stderr."""
    debug = "--debug" in arguments or os.environ.get("POISE_DEBUG", "0") not in ("", "0")
    arguments = [argument for argument in arguments if argument != "--debug"]  # accepted at any position
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without a character shows a question mark
    try:
        status = app(args=arguments, prog_name="poise", standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except PoiseError as error:
        return _report(error, error.message, error.exit_status, debug)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except BrokenPipeError:  # the reader closed the pipe (`poise ... | head`)
        _close_stdout()
        return INTERNAL_ERROR
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            _close_stdout()
            return _report(error, f"cannot write: {error.strerror}; free some space", InputError.exit_status, debug)
        usage = getattr(error, "format_message", None)  # errors of typer, which may bundle its own click
        if usage is not None:
            reason = usage().rstrip(".")  # empty when the help was shown instead
            message = f"{reason}; see poise --help" if reason else ""
            return _report(error, message, getattr(error, "exit_code", 2), debug)
        message = f"internal error: {type(error).__name__}: {error}; --debug shows the traceback. Please report it."
        return _report(error, message, INTERNAL_ERROR, debug)


def main() -> None:
    """Run the command line; exit 0 done, 2 bad input, 3 no answer, 1 internal error."""
    # Before numpy is imported: matrices are small here, and threads that wait for each other cost more than they do.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(20_000)  # arrays are no cycles; looking for them took 5 % of a diagnosis
    gc.disable()  # until the command is imported
    sys.exit(run(sys.argv[1:]))


def _close_stdout() -> None:
    """Keep Python from writing the rest of stdout a second time at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _report(error: Exception, message: str, status: int, debug: bool) -> int:
    if debug:
        traceback.print_exception(error)
    if message:
        print(f"poise: {' '.join(message.split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
