"""The one command `poise`, a subcommand per job."""

import sys

import typer

from poise.errors import PoiseError

app = typer.Typer(
    help="Weigh what a robot holds, say how hard a stack can be pushed, put the next object where it stays.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback()
def main_options() -> None:
    """Options common to every subcommand (none yet)."""


def main() -> None:
    """Run the command line; exit 0 done, 2 bad input, 3 no answer, 1 a fault of ours."""
    try:
        app()
    except PoiseError as error:
        print(f"poise: {error.message}", file=sys.stderr)
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
