"""Describe an insole for a recording over the network, from a daemon's `meta` and `calibration`."""

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
    """Return the insole of `foot` as the daemon uses it; WireError if no daemon publishes that foot.

    The calibration has the baselines in use, including those of a zero.
    """
    meta, in_use = client.meta(foot), client.calibration(foot)
    layout = layout_of_meta(dataclasses.asdict(meta), meta.xy_m)
    calibration = Calibration(
        foot=in_use.foot,
        baseline_count=in_use.baseline_count,
        coefficients_pa=in_use.coefficients_pa,
        covariance_pa2=None,
        usable=in_use.usable.astype(np.bool_),
        provenance={"source": in_use.source, **in_use.provenance},
        builtin=in_use.builtin,
    )
    zero = None
    if meta.zero is not None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "zero.json"
            path.write_text(json.dumps(meta.zero))
            zero = zeros.load(path, layout)
    boards = tuple(Board(**board) for board in meta.boards)
    return InsoleContents(foot=in_use.foot, boards=boards, layout=layout, calibration=calibration, zero=zero)
