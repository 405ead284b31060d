"""`insole import`: what others wrote, as a recording."""

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
    foot: Annotated[OneFoot | None, typer.Option("--foot", help="Of a table of counts: whose it is.")] = None,
    layout: Annotated[
        Path | None, typer.Option(help="Of a table of counts: insole-layout/1, whose order is that of the columns.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="Of a CAN log: the config.yaml it was recorded with.")
    ] = None,
    force: Force = False,
) -> None:
    """Make a recording of a file that another program wrote.

    What such a file leaves out is not made up silently: recording.yaml lists it under `invented`.
    """
    from .. import config as configs
    from ..recording.importing import import_recording
    from ..skin import layout as layouts
    from .record import insoles_of

    side: Foot | None = foot.value if foot is not None else None
    own_layout = layouts.load(layout, side) if layout is not None else None
    if own_layout is not None and side is None:
        side = own_layout.foot
    insoles = insoles_of(configs.load(config)) if config is not None else None
    with replace_folder(out, force, is_repeatable), show_work(f"importing {source.name}") as work:
        import_recording(source, out, side, own_layout, insoles, work.done)
    recording = load_recordings([out])[0]
    for each in recording.feet:
        print(f"{each.foot}: {len(each)} cycles, {len(each.layout)} triangles, {recording.kind}, in {out}")
    for line in recording.invented:
        print(f"insole: invented: {line}", file=sys.stderr)
    name_next(f"insole report {out}")
