"""`insole report`: draw a recording into one HTML file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Calibrations, Force, name_next, refuse_existing_file, write_whole
from .progress import show_work
from .recordings import load_recordings

_RECORDINGS = Path("recordings")  # folder of the web page's recordings


def report(
    recording: Annotated[
        Path | None,
        typer.Argument(help="Folder of a recording; left out: the newest one here and in recordings/."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File to write; left out: report.html in the folder, which is replaced."),
    ] = None,
    calibration: Calibrations = None,
    force: Force = False,
) -> None:
    """Draw a recording: pressure, forces, steps and health, as one HTML file that needs no internet."""
    from ..view.recorded import recorded_page

    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise typer.BadParameter(f"expected an --out that ends in .html, found {out}")
    refuse_existing_file(out, force)
    folder = recording or newest_recording()
    file = out or folder / "report.html"
    loaded = load_recordings([folder], calibration or ())[0]
    with show_work(f"drawing {folder}"):
        write_whole(file, recorded_page(loaded))
    print(f"insole: wrote {file}", file=sys.stderr)
    name_next(f"insole export {folder} {folder.name}.csv, or .npz, .mat, .mcap")


def newest_recording() -> Path:
    """Return the folder of the newest recording, here or in recordings/; FileError if there is none."""
    from ..errors import FileError
    from ..recording.document import FILE

    documents = [
        file
        for file in (*Path().glob(f"*/{FILE}"), *_RECORDINGS.glob(f"*/{FILE}"))
        if not file.parent.name.startswith(".")  # unfinished
    ]
    if not documents:
        raise FileError(
            f"no recording here or in {_RECORDINGS}/: name the folder of one, or make one with 'insole record walk-1'"
        )
    return max(documents, key=lambda file: file.stat().st_mtime).parent
