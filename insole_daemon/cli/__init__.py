"""The command `insole`: one verb a file, each loading only what it needs."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from . import (
    boards,
    bring_up,
    calibrate,
    demo,
    diagnose,
    doctor,
    export,
    failures,
    import_,
    model,
    prove,
    record,
    reference,
    replay,
    report,
    run,
    simulate,
    status,
    study,
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
    "4 a file was refused, 70 a defect of insole, 130 interrupted.",
    no_args_is_help=True,
    rich_markup_mode=None,  # loading rich would be most of the time `insole --help` takes
    pretty_exceptions_enable=False,
)
for verb in (
    demo.demo, run.run, simulate.simulate, replay.replay, watch.watch, status.status, doctor.doctor, boards.boards,
    zero.zero, model.model, view.view, record.record, reference.reference, report.report, export.export,
    calibrate.calibrate, validate.validate, diagnose.diagnose, prove.prove, study.study,
):  # fmt: skip
    app.command()(verb)
app.command("import")(import_.import_)
app.command("map")(mapping.map_)
app.command("bring-up")(bring_up.bring_up)


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


def main() -> None:
    """Run the command; every failure is one message on stderr and an exit status."""
    failures.report_threads()
    try:
        try:
            app()
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
