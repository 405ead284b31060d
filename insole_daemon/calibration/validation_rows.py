"""The tables of a validation as text, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .validation import ChamberResult, Result, ShoeResult, Tracking

SHOE_COLUMNS = (
    "recording", "highest kPa", "f_z RMSE N", "f_z %", "steady N", "m_x RMSE N·m", "m_x %", "m_y RMSE N·m", "m_y %",
    "CoP_x RMSE mm", "CoP_x %", "CoP_y RMSE mm", "CoP_y %", "clock s",
)  # fmt: skip
CHAMBER_COLUMNS = (
    "recording", "highest kPa", "taxels", "good", "RMSE median kPa", "5 %", "95 %", "worst", "mean error kPa",
    "clock s",
)  # fmt: skip


def shoe_rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """As SHOE_COLUMNS; % are tracking accuracies."""
    rows: list[tuple[str, ...]] = []
    for each in results:
        found = each.outcome
        assert isinstance(found, ShoeResult)
        rows.append(
            (
                each.title,
                _of(found.highest_pressure_pa / 1e3, 0),
                *_cells(found.f_z, 1.0, 1),
                _of(found.steady_rmse_n, 1),
                *_cells(found.m_x, 1.0, 2),
                *_cells(found.m_y, 1.0, 2),
                *_cells(found.cop_x, 1e3, 1),
                *_cells(found.cop_y, 1e3, 1),
                _of(each.clock.offset_s, 3),
            )
        )
    return rows


def chamber_rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """As CHAMBER_COLUMNS."""
    rows: list[tuple[str, ...]] = []
    for each in results:
        found = each.outcome
        assert isinstance(found, ChamberResult)
        known = found.rmse_pa[np.isfinite(found.rmse_pa)]
        rows.append(
            (
                each.title,
                _of(found.highest_pressure_pa / 1e3, 0),
                str(len(known)),
                str(int(np.count_nonzero(found.good))),
                *(_of(float(np.percentile(known, p)) / 1e3, 2) for p in (50, 5, 95, 100)),
                _of(float(np.nanmedian(found.mean_error_pa)) / 1e3, 2),
                _of(each.clock.offset_s, 3),
            )
        )
    return rows


def _cells(tracking: Tracking, factor: float, digits: int) -> tuple[str, str]:
    return _of(tracking.rmse * factor, digits), _of(tracking.accuracy, 1)


def _of(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "–"
