"""`insole report`: a recording as pictures, in one file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import write_whole


def report(
    recording: Annotated[Path, typer.Argument(help="Folder of a recording.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Where to write it; left out: report.html in the folder.")
    ] = None,
) -> None:
    """Draw a recording: pressure, forces, steps and health, as one HTML file that needs no internet."""
    from ..recording.loading import load
    from ..view.recorded import recorded_page

    file = out or recording / "report.html"
    write_whole(file, recorded_page(load(recording)))
    print(f"insole: wrote {file}", file=sys.stderr)
