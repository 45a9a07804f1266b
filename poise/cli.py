"""The one command `poise`, a subcommand per job."""

import errno
import io
import os
import sys
import traceback
from importlib.metadata import version
from typing import Annotated

import typer

from poise.commands.assembly import disassemble, msa, robustness
from poise.commands.carry import carry
from poise.commands.evaluate import evaluate
from poise.commands.excite import excite
from poise.commands.identify import identify
from poise.commands.mismatch import mismatch
from poise.commands.place import place
from poise.commands.scan import scan
from poise.commands.segment import segment
from poise.commands.sensitivity import sensitivity
from poise.commands.simulate import simulate
from poise.errors import InputError, PoiseError

INTERRUPTED = 130
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
FAULT_OF_OURS = 1

app = typer.Typer(
    help="Weigh what a robot holds, say how hard a stack can be pushed, put the next object where it stays.",
    epilog="Exit status: 0 done, 2 bad input, 3 the job has no answer, 1 a fault of ours.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command()(identify)
app.command()(evaluate)
app.command()(excite)
app.command()(scan)
app.command()(segment)
app.command()(robustness)
app.command()(msa)
app.command()(disassemble)
app.command()(sensitivity)
app.command()(place)
app.command()(carry)
app.command()(mismatch)
app.command()(simulate)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"poise {version('poise')}")
        raise typer.Exit


@app.callback()
def main_options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error (also: POISE_DEBUG=1).")
    ] = False,
) -> None:
    """Weigh what a robot holds, say how hard a stack can be pushed, put the next object where it stays."""


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit status; whatever goes wrong is one line on stderr."""
    debug = "--debug" in arguments or os.environ.get("POISE_DEBUG", "0") not in ("", "0")
    arguments = [argument for argument in arguments if argument != "--debug"]  # welcome anywhere
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that cannot show a sign shows a question mark
    try:
        status = app(args=arguments, prog_name="poise", standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except PoiseError as error:
        return _report(error, error.message, error.exit_status, debug)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except BrokenPipeError:  # the reader left (`poise ... | head`)
        _close_stdout()
        return FAULT_OF_OURS
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            _close_stdout()
            return _report(error, f"cannot write: {error.strerror}; free some space", InputError.exit_status, debug)
        usage = getattr(error, "format_message", None)  # typer's own errors, wherever it keeps click
        if usage is not None:
            said = usage().rstrip(".")  # nothing, when the help was shown instead
            return _report(error, f"{said}; see poise --help" if said else "", getattr(error, "exit_code", 2), debug)
        message = f"a fault of ours: {type(error).__name__}: {error}; --debug shows where. Please report it."
        return _report(error, message, FAULT_OF_OURS, debug)


def main() -> None:
    """Run the command line; exit 0 done, 2 bad input, 3 no answer, 1 a fault of ours."""
    sys.exit(run(sys.argv[1:]))


def _close_stdout() -> None:
    """Keep Python from trying again, when it leaves, to write what could not be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _report(error: Exception, message: str, status: int, debug: bool) -> int:
    if debug:
        traceback.print_exception(error)
    if message:
        print(f"poise: {' '.join(message.split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
