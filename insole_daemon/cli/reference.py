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
    markers: Annotated[
        Path | None, typer.Option(help="Moments of triggers or markers on the clock of SOURCE: one a line, in seconds.")
    ] = None,
    own_markers: Annotated[
        Path | None,
        typer.Option(help="The same moments on the clock of the recording, in seconds since 1970; else its own marks."),
    ] = None,
    force: Force = False,
) -> None:
    """Add the readings of another instrument to a recording, so that calibrate, validate and diagnose use them.

    The clocks need not agree: those commands align them by the forces. With --markers they are aligned here, by moments
    that both systems have recorded. Of a force plate, only contacts and 0.3 s around each are used: at other times the
    foot may stand beside the plate.
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
    if own_markers is not None and markers is None:
        raise typer.BadParameter("--own-markers is compared with --markers: name that file, too")
    on_clock = "on a clock of their own"
    if markers is not None:
        columns, on_clock = _on_can_clock(columns, recording, markers, own_markers)
    file = add_reference(loaded, side, columns, clock="own" if markers is None else "can", force=force)
    print(f"{file}: {len(columns['fz_n'])} readings, up to {columns['fz_n'].max():.0f} N, {on_clock}")
    name_next(f"insole validate {recording} --calibration CALIBRATION --report side-by-side.html")


def _on_can_clock(
    columns: dict[str, NDArray[np.float64]], recording: Path, markers: Path, own_markers: Path | None
) -> tuple[dict[str, NDArray[np.float64]], str]:
    """Return `columns` with their times on the clock of the CAN frames, and a clause that says how well."""
    from ..calibration.marker_clock import fit_marker_clock
    from ..recording.markers import read_markers, recorded_markers

    own_s = recorded_markers(recording) if own_markers is None else read_markers(own_markers)
    other_s = read_markers(markers)
    # Seconds since 1970 have too many digits for a rate: both clocks count from their first marker.
    own_origin_s, other_origin_s = (float(moments_s[0]) if len(moments_s) else 0.0 for moments_s in (own_s, other_s))
    clock = fit_marker_clock(own_s - own_origin_s, other_s - other_origin_s)
    time_s = (columns["time_s"] - other_origin_s - clock.offset_s) / (1.0 + clock.rate) + own_origin_s
    return columns | {"time_s": time_s}, (
        f"aligned by the markers: at {own_origin_s:.4f} s of our clock, the first of them, the other one shows "
        f"{other_origin_s + clock.offset_s:.4f} s (± {1e3 * clock.offset_std_s:.1f} ms), and it is fast by "
        f"{1e6 * clock.rate:.1f} ± {1e6 * clock.rate_std:.1f} ppm"
    )


def _plate_columns(
    source: Path, number: int | None, origin_mm: tuple[float, float], heading_deg: float
) -> dict[str, NDArray[np.float64]]:
    from ..errors import FileError
    from ..recording.import_c3d import read_force_plates

    plates = read_force_plates(source)
    if number is None and len(plates) > 1:
        numbers = ", ".join(f"--plate {at} (up to {candidate.f_z_n.max():.0f} N)" for at, candidate in plates.items())
        raise typer.BadParameter(f"{source} has {len(plates)} plates: choose one of {numbers}")
    if number is not None and number not in plates:
        known = ", ".join(map(str, plates))
        raise typer.BadParameter(f"{source}: expected --plate {known}, of types 1 to 4, found --plate {number}")
    plate = next(iter(plates.values())) if number is None else plates[number]
    columns = plate.contact_columns((origin_mm[0] * 1e-3, origin_mm[1] * 1e-3), heading_deg)
    if not len(columns["fz_n"]):
        raise FileError(f"{source}: nobody stood on that plate: its force stays below 20 N")
    return columns
