"""`insole export`: write a recording in formats that other programs read."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from .options import Calibrations, Force, name_next, refuse_existing_file, replace_folder
from .progress import show_work
from .recordings import load_recordings

_EXPORTED = (".csv", ".parquet", "-layout.yaml")  # endings of the files in a folder


class Form(StrEnum):
    """The format of an export."""

    csv = "csv"
    npz = "npz"
    mat = "mat"
    mcap = "mcap"
    parquet = "parquet"
    c3d = "c3d"


def export(
    recording: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write; .csv has forces and pressure by region. With --to csv and parquet, a folder."
        ),
    ],
    to: Annotated[Form | None, typer.Option(help="Format; default: by the ending of OUT.")] = None,
    calibration: Calibrations = None,
    force: Force = False,
) -> None:
    """Write a recording as CSV, npz, MATLAB, MCAP, Parquet or C3D.

    All but npz and a single .csv file contain the steps; `--to csv` writes a folder with steps.csv.
    """
    from ..errors import FileError
    from ..recording import export_c3d, export_mcap, export_tables, foxglove
    from ..recording.quality import quality

    suffix = out.suffix.lower().removeprefix(".")
    form = to or (Form(suffix) if suffix in list(Form) else None)
    if form is None:
        raise typer.BadParameter(
            f"expected an OUT that ends in .csv, .npz, .mat, .mcap, .parquet or .c3d, or --to, found {out}"
        )
    if form is Form.parquet or (form is Form.csv and suffix != "csv"):
        replaced: AbstractContextManager[None] = replace_folder(out, force, _is_export)
    else:
        refuse_existing_file(out, force)
        replaced = nullcontext()
    loaded = load_recordings([recording], calibration or ())[0]
    try:
        with replaced, show_work(f"writing {out}") as work:
            write = {
                Form.csv: export_tables.export_cycle_table
                if suffix == "csv"
                else partial(export_tables.export_csv, progress=work.done),
                Form.npz: export_tables.export_npz,
                Form.mat: export_tables.export_matlab,
                Form.mcap: partial(export_mcap.export_mcap, progress=work.done),
                Form.parquet: export_tables.export_parquet,
                Form.c3d: export_c3d.export_c3d,
            }[form]
            write(loaded, out)
    except OSError as error:
        raise FileError(f"{out}: cannot be written: {error.strerror or error}") from error
    for foot, data_quality in quality(loaded).items():
        print(f"insole: {foot}: {data_quality.sentence}", file=sys.stderr)
    has_steps = form is not Form.npz and (form, suffix) != (Form.csv, "csv")
    if has_steps:
        for remark in loaded.steps.remarks:
            print(f"insole: steps: {remark}", file=sys.stderr)
    print(f"{out}: {form.value}, {', '.join(f'{foot_data.foot} {len(foot_data)} cycles' for foot_data in loaded.feet)}")
    if form is Form.mcap:
        print(f"insole: Foxglove: open {out}, then import the layout {foxglove.LAYOUT}", file=sys.stderr)
    replaced_by = f", {[str(file) for file in calibration]}" if calibration else ""
    name_next(f"the same in Python: insole_daemon.load({str(recording)!r}{replaced_by})")


def _is_export(folder: Path) -> bool:
    """Return whether `folder` contains only files that an export writes."""
    names = [file.name for file in folder.iterdir()]
    return all(name.startswith(("left", "right", "steps.")) and name.endswith(_EXPORTED) for name in names)
