"""`insole reference`: add a force plate or another sensor's text export to a recording as its reference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Force, OneFoot, name_next
from .recordings import load_recordings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def reference(
    recording: Annotated[Path, typer.Argument(help="Folder of a recording of the same trial, without a reference.")],
    source: Annotated[Path, typer.Argument(help="C3D file with force plates, or a text export with --mapping.")],
    foot: Annotated[OneFoot | None, typer.Option("--foot", help="For a C3D file: the foot on the plate.")] = None,
    plate: Annotated[
        int | None, typer.Option(min=1, help="For a C3D file with several plates: the number of the plate.")
    ] = None,
    origin_mm: Annotated[
        tuple[float, float],
        typer.Option(help="Position of the insole's heel end: along the plate's x from its centre, and left of it."),
    ] = (0.0, 0.0),
    heading_deg: Annotated[
        float, typer.Option(help="Direction of the toes, counter-clockwise from the plate's x, seen from above.")
    ] = 0.0,
    mapping: Annotated[
        Path | None, typer.Option(help="For a text export: insole-table/1, which names its columns.")
    ] = None,
    force: Force = False,
) -> None:
    """Add the readings of another instrument to a recording, so that calibrate, validate and diagnose use them.

    The clocks need not agree: those commands align them by the forces. From a plate, only contacts and 0.3 s around
    each are used: at other times the foot may stand beside it.
    """
    from ..recording.added_reference import add_reference
    from ..recording.import_text import reference_of_table

    loaded = load_recordings([recording])[0]
    if mapping is not None:
        side, columns = reference_of_table(source, mapping)
    elif foot is None:
        raise typer.BadParameter("expected --foot for the plates of a C3D file, or --mapping for a text export")
    else:
        side = "left" if foot is OneFoot.left else "right"
        columns = _plate_columns(source, plate, origin_mm, heading_deg)
    file = add_reference(loaded, side, columns, force=force)
    print(f"{file}: {len(columns['fz_n'])} readings, up to {columns['fz_n'].max():.0f} N, on a clock of their own")
    name_next(f"insole validate {recording} --calibration CALIBRATION --report side-by-side.html")


def _plate_columns(
    source: Path, number: int | None, origin_mm: tuple[float, float], heading_deg: float
) -> dict[str, NDArray[np.float64]]:
    from ..errors import FileError
    from ..recording.import_c3d import read_force_plates

    plates = read_force_plates(source)
    if number is None and len(plates) > 1:
        numbers = ", ".join(
            f"--plate {at} (up to {candidate.f_z_n.max():.0f} N)" for at, candidate in enumerate(plates, 1)
        )
        raise typer.BadParameter(f"{source} has {len(plates)} plates: choose one of {numbers}")
    if number is not None and number > len(plates):
        raise typer.BadParameter(f"{source} has {len(plates)} plates, found --plate {number}")
    columns = plates[(number or 1) - 1].contact_columns((origin_mm[0] * 1e-3, origin_mm[1] * 1e-3), heading_deg)
    if not len(columns["fz_n"]):
        raise FileError(f"{source}: nobody stood on that plate: its force stays below 20 N")
    return columns
