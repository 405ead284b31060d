"""`insole import`: convert a file of another program into a recording."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Force, OneFoot, is_repeatable, name_next, replace_folder
from .progress import show_work
from .recordings import load_recordings

if TYPE_CHECKING:
    from ..config import Foot


def import_(
    source: Annotated[
        Path,
        typer.Argument(
            help="MATLAB file (C, P), YARP dump, bench CSV, MCAP of insole export, or a CAN log: candump, ASC, BLF, "
            "TRC, CSV, MF4."
        ),
    ],
    out: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    foot: Annotated[OneFoot | None, typer.Option("--foot", help="For a table of counts: the foot.")] = None,
    layout: Annotated[
        Path | None, typer.Option(help="For a table of counts: insole-layout/1 in the order of the columns.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="For a CAN log: the config.yaml it was recorded with.")
    ] = None,
    force: Force = False,
) -> None:
    """Convert a file that another program wrote into a recording.

    recording.yaml lists values that the file does not contain under `invented`.
    """
    from .. import config as configs
    from ..recording.importing import import_recording
    from ..skin import layout as layouts
    from .record import insoles_of

    side: Foot | None = foot.value if foot is not None else None
    given_layout = layouts.load(layout, side) if layout is not None else None
    if given_layout is not None and side is None:
        side = given_layout.foot
    insoles = insoles_of(configs.load(config)) if config is not None else None
    with replace_folder(out, force, is_repeatable), show_work(f"importing {source.name}") as work:
        import_recording(source, out, side, given_layout, insoles, work.done)
    recording = load_recordings([out])[0]
    for foot_data in recording.feet:
        print(
            f"{foot_data.foot}: {len(foot_data)} cycles, {len(foot_data.layout)} triangles, {recording.kind}, in {out}"
        )
    for line in recording.invented:
        print(f"insole: invented: {line}", file=sys.stderr)
    name_next(f"insole report {out}")
