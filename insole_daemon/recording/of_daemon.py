"""What a recording over the network says of its insoles: from a daemon's `meta` and `calibration`."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..config import Board
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from .copies import InsoleContents, layout_of_meta

if TYPE_CHECKING:
    from ..wire.client import Client


def insole_in_use(client: Client, foot: str) -> InsoleContents:
    """The insole of `foot` as the daemon reads it; WireError where none has that foot.

    The calibration's baselines are those in use, so a zero that is in use is in them too.
    """
    meta, said = client.meta(foot), client.calibration(foot)
    layout = layout_of_meta(dataclasses.asdict(meta), meta.xy_m)
    calibration = Calibration(
        foot=said.foot,
        baseline_count=said.baseline_count,
        coefficients_pa=said.coefficients_pa,
        covariance_pa2=None,
        usable=said.usable.astype(np.bool_),
        provenance={"source": said.source, **said.provenance},
        builtin=said.builtin,
    )
    zero = None
    if meta.zero is not None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "zero.json"
            path.write_text(json.dumps(meta.zero))
            zero = zeros.load(path, layout)
    boards = tuple(Board(**board) for board in meta.boards)
    return InsoleContents(foot=said.foot, boards=boards, layout=layout, calibration=calibration, zero=zero)
