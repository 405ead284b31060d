"""Add a reference that was measured by another instrument to an existing recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from ..config import Foot
from ..errors import FileError
from ..files import write_text
from . import reference as references
from .document import FILE, Clock, dump
from .loading import Recording


def add_reference(
    recording: Recording,
    foot: Foot,
    columns: Mapping[str, NDArray[np.float64]],
    *,
    clock: Clock = "own",
    force: bool = False,
) -> Path:
    """Write `columns` (time_s on `clock`, fz_n, mx_nm, my_nm) as the reference of `foot`; return the file.

    Names it in recording.yaml and sets the recording's kind to shoe. Raises FileError if the foot is not recorded, if
    it has a reference already (unless `force`), or if the recording is of a chamber or a bench.
    """
    recorded = next((side for side in recording.feet if side.foot == foot), None)
    if recorded is None:
        raise FileError(f"{recording.folder}: expected a recording of the {foot} foot, found only the other one")
    if recording.kind not in ("free", "shoe"):
        raise FileError(
            f"{recording.folder}: expected a recording of kind free or shoe, found {recording.kind}: "
            "forces are no reference for it"
        )
    if recorded.reference is not None and not force:
        raise FileError(f"{recording.folder}: the {foot} foot has a reference already: give --force to replace it")
    document = yaml.safe_load((recording.folder / FILE).read_text(encoding="utf-8"))
    others = [other for other in document.get("reference", ()) if other["foot"] != foot]
    file = recording.folder / f"{foot}-reference.csv"
    entry = {"foot": foot, "file": file.name, "clock": clock}
    document |= {"kind": "shoe", "reference": [*others, entry]}
    try:
        write_text(file, references.text(columns))
        write_text(recording.folder / FILE, dump(document))
    except OSError as error:
        raise FileError(f"{recording.folder}: cannot be written: {error.strerror or error}") from error
    return file
