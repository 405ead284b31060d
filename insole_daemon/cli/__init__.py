"""The command `insole`: one verb a file, each loading only what it needs."""

from __future__ import annotations

import sys

import typer

from ..errors import InsoleError
from . import (
    boards,
    calibrate,
    demo,
    diagnose,
    doctor,
    export,
    import_,
    model,
    prove,
    record,
    replay,
    report,
    run,
    simulate,
    status,
    validate,
    view,
    watch,
    zero,
)
from . import map as mapping

app = typer.Typer(
    name="insole",
    help="Pressure maps and wrenches of a sensorised insole: from CAN frames to Zenoh at 50 Hz.",
    epilog="Exit status: 0 done, 1 not confirmed, or problems found, 2 wrong usage, 3 a bus or Zenoh failed, "
    "4 a file was refused.",
    no_args_is_help=True,
    rich_markup_mode=None,  # loading rich would be most of the time `insole --help` takes
    add_completion=False,
    pretty_exceptions_enable=False,
)
for verb in (
    demo.demo, run.run, simulate.simulate, replay.replay, watch.watch, status.status, doctor.doctor, boards.boards,
    zero.zero, model.model, view.view, record.record, report.report, export.export, calibrate.calibrate,
    validate.validate, diagnose.diagnose, prove.prove,
):  # fmt: skip
    app.command()(verb)
app.command("import")(import_.import_)
app.command("map")(mapping.map_)


def main() -> None:
    """Run the command; an error a person can act on is one message on stderr, never a traceback."""
    try:
        app()
    except InsoleError as error:
        print(f"insole: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the reader of our output has gone, as in `insole watch | head`
        sys.stderr.close()
        sys.exit(0)
