"""Format the tables of a validation, for the terminal and the HTML page."""

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
    """Return one row per result with the columns SHOE_COLUMNS; % are tracking accuracies."""
    rows: list[tuple[str, ...]] = []
    for result in results:
        outcome = result.outcome
        assert isinstance(outcome, ShoeResult)
        rows.append(
            (
                result.title,
                _format(outcome.highest_pressure_pa / 1e3, 0),
                *_cells(outcome.f_z, 1.0, 1),
                _format(outcome.steady_rmse_n, 1),
                *_cells(outcome.m_x, 1.0, 2),
                *_cells(outcome.m_y, 1.0, 2),
                *_cells(outcome.cop_x, 1e3, 1),
                *_cells(outcome.cop_y, 1e3, 1),
                _format(result.clock.offset_s, 3),
            )
        )
    return rows


def chamber_rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """Return one row per result with the columns CHAMBER_COLUMNS."""
    rows: list[tuple[str, ...]] = []
    for result in results:
        outcome = result.outcome
        assert isinstance(outcome, ChamberResult)
        known = outcome.rmse_pa[np.isfinite(outcome.rmse_pa)]
        rows.append(
            (
                result.title,
                _format(outcome.highest_pressure_pa / 1e3, 0),
                str(len(known)),
                str(int(np.count_nonzero(outcome.good))),
                *(_format(float(np.percentile(known, p)) / 1e3, 2) for p in (50, 5, 95, 100)),
                _format(float(np.nanmedian(outcome.mean_error_pa)) / 1e3, 2),
                _format(result.clock.offset_s, 3),
            )
        )
    return rows


def _cells(tracking: Tracking, factor: float, digits: int) -> tuple[str, str]:
    return _format(tracking.rmse * factor, digits), _format(tracking.accuracy, 1)


def _format(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "–"
