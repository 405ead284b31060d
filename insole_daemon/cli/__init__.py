"""The command `insole`: one verb a file, each loading only what it needs."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from . import failures
from .run import run as run_daemon

_VERBS = (  # in the order of the help
    "demo", "run", "simulate", "replay", "watch", "status", "doctor", "boards", "zero", "model", "view", "record",
    "reference", "report", "export", "calibrate", "validate", "diagnose", "prove", "study", "import", "map", "bring-up",
)  # fmt: skip
_MODULES = {"import": "import_", "bring-up": "bring_up"}  # where it has not the verb's name
_FUNCTIONS = {"map": "map_"}  # in a module, where it has not the module's name


class _VerbGroup(typer.core.TyperGroup):
    """Loads only the verb that is asked for: all of them take longer than most of what a daemon's start loads."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._unloaded = set(_VERBS)
        self.commands = {**dict.fromkeys(_VERBS, typer.core.TyperCommand("")), **self.commands}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the verb `cmd_name`, or None."""
        if cmd_name in self._unloaded:
            self._unloaded.remove(cmd_name)
            module = _MODULES.get(cmd_name, cmd_name)
            verb = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
            function = getattr(importlib.import_module(f".{module}", __package__), _FUNCTIONS.get(module, module))
            verb.command(cmd_name)(function)
            self.commands[cmd_name] = typer.main.get_command(verb)
        return self.commands.get(cmd_name)


app = typer.Typer(
    name="insole",
    cls=_VerbGroup,
    help="Pressure maps and wrenches of a sensorised insole: from CAN frames to Zenoh at 50 Hz.",
    epilog="Exit status: 0 done, 1 not confirmed, or problems found, 2 wrong usage, 3 a bus or Zenoh failed, "
    "4 a file was refused, 70 a defect of insole, 130 interrupted.",
    no_args_is_help=True,
    rich_markup_mode=None,  # loading rich would be most of the time `insole --help` takes
    pretty_exceptions_enable=False,
)


def _print_version(is_requested: bool) -> None:
    if is_requested:
        from .. import __version__

        print(f"insole-daemon {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and end.")
    ] = False,
) -> None:
    pass


def _invoke(arguments: Sequence[str]) -> None:
    """Run the verb. A daemon's start is read here: Typer imports pydantic, which takes a third of the start."""
    match arguments:
        case ["run", *options] if not options or (len(options) == 2 and options[0] == "--config"):
            try:
                run_daemon(Path(options[1]) if options else None)
            except KeyboardInterrupt:
                sys.exit(failures.INTERRUPTED)
        case _:
            app()


def main() -> None:
    """Run the command; every failure is one message on stderr and an exit status."""
    failures.report_threads()
    try:
        try:
            _invoke(sys.argv[1:])
        except SystemExit as end:
            if end.code == failures.INTERRUPTED:
                print("insole: interrupted", file=sys.stderr)
            sys.stdout.flush()
            raise
    except BrokenPipeError:  # the reader of our output has gone, as in `insole watch | head`
        failures.discard_output()
        sys.exit(0)
    except Exception as error:
        message, status = failures.explain(error)
        print(f"insole: {message}", file=sys.stderr)
        try:
            sys.stdout.flush()
        except OSError:
            failures.discard_output()
        sys.exit(status)
