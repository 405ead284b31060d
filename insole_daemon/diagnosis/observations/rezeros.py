"""Boards that took their baselines anew under a load: from one reading to the next all taxels say that there is none.

`no_load` is where the firmware lands; what the load was then is missing from every later reading.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...physics.effect import Where
from ...physics.effects import laws
from ...recording.loading import FootRecording
from ..finding import Finding, Quantity
from ..places import said
from .wrench import WrenchObservation

LEAST_COUNT = 5.0  # of load, on the average of a board: less is no step that could be told
NEAR_COUNT = 2.5  # of a taxel to where a rezero lands, beside three standard deviations of its noise
MOST_OFF = 0.1  # of the taxels, that land elsewhere
MOST_LOST = 0.3  # of what is read afterwards: the rest is the load's peaks alone
LASTS_S = 3.0
MISSING = (0.5, 1.6)  # times what the step took, that is missing on the median until the end
LEAST_READ = 50  # rows that are not cut off, to ask that of
STEP_S = 0.12  # that it takes at the most, each way


def with_rezeros(foot: FootRecording, seen: WrenchObservation) -> tuple[WrenchObservation, list[Finding]]:
    """`seen` with what later readings miss added again, and what is said of it, where the load is known."""
    findings: list[Finding] = []
    if not seen.load_is_known:
        return seen, findings
    boards = seen.layout.identities[:, 0]
    no_load = {board.address: board.no_load for board in foot.boards if board.no_load is not None}
    for board, lands in sorted(no_load.items()):
        own = boards == board
        width = max(round(STEP_S / seen.step_s), 2)
        at = _step(seen, own, float(lands), width)
        if at is None:
            continue
        shift = seen.activation_count[at - width, own] - seen.activation_count[at + width, own]
        shift = np.where(seen.usable[own], shift, 0.0)
        activation, missing = seen.activation_count.copy(), seen.missing.copy()
        lost = seen.cut_off[at:, own].any(axis=2)
        missing[at:, own] |= lost | (lost.mean() > MOST_LOST)
        missing[at - width : at + width, own] = True
        activation[at:, own] += shift
        rezeroed = np.zeros(missing.shape, bool) if seen.rezeroed is None else seen.rezeroed.copy()
        rezeroed[at:, own] = True
        seen = replace(seen, activation_count=activation, missing=missing, rezeroed=rezeroed)
        size, t_s = float(shift[seen.usable[own]].mean()), float(seen.t_s[at])
        findings.append(
            Finding(
                effect="rezero", foot=seen.layout.foot, where=Where("board", ((int(board),),)),
                recordings=(seen.name,), when_s=((t_s, float(seen.t_s[-1])),), equation=laws()["rezero"].equation,
                parameters={"t_s": Quantity(t_s, seen.step_s, "s"), "shift_count": Quantity(size, 0.3, "count")},
                explains=size**2 * float(np.mean(own)) * float(np.mean(seen.t_s > t_s)),
                sentence=f"{said(Where('board', ((int(board),),)))} took its baselines anew at {t_s:.1f} s under load: "
                f"{size:+.1f} counts are missing since.",
            )
        )  # fmt: skip
    return seen, findings


def _step(
    seen: WrenchObservation, own: np.ndarray[tuple[int], np.dtype[np.bool_]], lands: float, width: int
) -> int | None:
    """The row from which on a board's taxels start anew at the count `lands`; None: they never do."""
    usable = seen.usable[own]
    if not usable.any():
        return None
    activation = seen.activation_count[:, own][:, usable]
    rest = seen.calibration.baseline_count[own][usable] - lands
    near = np.abs(activation - rest) < NEAR_COUNT + 3.0 * seen.noise_count[own][usable]
    landed = near.mean(axis=1) > 1.0 - MOST_OFF
    loaded = (activation - rest).mean(axis=1) > LEAST_COUNT
    expected = (seen.expected_count[:, own][:, usable] - rest).mean(axis=1)
    rows = np.arange(width, len(activation) - width)
    loads = np.minimum(expected[rows - width], expected[rows + width]) > LEAST_COUNT
    steps = rows[loaded[rows - width] & landed[rows + width] & loads]
    cut_off = seen.cut_off[:, own][:, usable].mean(axis=1) > MOST_OFF
    away = expected - (activation - rest).mean(axis=1)  # what readings miss
    for row in steps.tolist():
        if away[row + width] - away[row - width] < LEAST_COUNT:
            continue  # the load did it
        # A pulse is over at once, readings that come late catch up; what a rezero takes is missing from then on.
        taken = float(np.mean(activation[row - width] - activation[row + width]))
        later, reads = away[row + width :], ~cut_off[row + width :]
        soon = later[: round(LASTS_S / seen.step_s)]
        if (
            taken < LEAST_COUNT
            or np.median(soon) < LEAST_COUNT
            or abs(float(np.median(away[: row - width]))) > LEAST_COUNT
        ):
            continue
        if reads.sum() < LEAST_READ or MISSING[0] * taken < np.median(later[reads]) < MISSING[1] * taken:
            return int(row) + width // 2
    return None
