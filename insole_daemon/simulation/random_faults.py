"""Draw random faults with realistic parameters, for tests and benchmarks of fault detection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from ..errors import SimulationError
from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Layout
from .faults import LINE_KINDS, TAXEL_KINDS, ComesBack, FaultKind, InjectedFault

_TAXELS = np.flatnonzero(PRESSURE_TAXELS)


def random_fault(
    kind: FaultKind, rng: np.random.Generator, layouts: Sequence[Layout], t_s: float, seconds: float
) -> list[InjectedFault]:
    """Draw one occurrence of `kind` on the insoles `layouts`, within `seconds` from `t_s` on.

    It begins in the first half of that time; half of the faults that can end do so within it. The result is a list,
    because one of four cases of "loose" is a whole data line (four triangles: 4k to 4k + 3).
    """
    identities = np.concatenate([layout.identities for layout in layouts])
    board, triangle = (int(number) for number in identities[rng.integers(len(identities))])
    begin_s = t_s + float(rng.uniform(0, 0.5)) * seconds
    end_s = begin_s + float(rng.uniform(0.3, 1.0)) * (t_s + seconds - begin_s)
    until_s = end_s if rng.random() < 0.5 else None
    if kind in LINE_KINDS:
        return _line_faults(kind, rng, identities, (board, triangle), begin_s, until_s)
    if kind in TAXEL_KINDS:
        return [_taxel_fault(kind, rng, (board, triangle), begin_s, until_s)]
    if kind == "rezero":
        return [InjectedFault(kind, begin_s, None, board)]
    if kind == "reset":
        recoveries: tuple[ComesBack, ...] = get_args(ComesBack)
        up_s = min(begin_s + float(rng.uniform(0.2, 2.0)), end_s)
        return [InjectedFault(kind, begin_s, up_s, board, comes_back=recoveries[rng.integers(len(recoveries))])]
    if kind == "address_clash":
        others = [int(address) for address in np.unique(identities[:, 0]) if address != board]
        if not others:
            raise SimulationError(f"{kind}: expected layouts of at least two boards, found board {board} alone")
        return [InjectedFault(kind, begin_s, until_s, board, other=others[rng.integers(len(others))])]
    return [InjectedFault(kind, begin_s, until_s, board)]


def _line_faults(
    kind: FaultKind,
    rng: np.random.Generator,
    identities: np.ndarray[tuple[int, ...], np.dtype[np.uint8]],
    where: tuple[int, int],
    begin_s: float,
    until_s: float | None,
) -> list[InjectedFault]:
    """Draw faults of a triangle's data line or chip."""
    board, triangle = where
    if kind == "dead_chip":
        chance = 1.0 if rng.random() < 0.5 else float(rng.uniform(0.02, 0.3))
        return [InjectedFault(kind, begin_s, until_s, board, triangle, chance=chance)]
    case = rng.random()  # four cases: always open, a whole line, under pressure, or intermittently
    if case < 0.25:
        return [InjectedFault(kind, begin_s, until_s, board, triangle)]
    if case < 0.5:
        line = [int(t) for b, t in identities if b == board and t // 4 == triangle // 4]
        return [InjectedFault(kind, begin_s, until_s, board, line_triangle) for line_triangle in line]
    if case < 0.75:
        return [InjectedFault(kind, begin_s, until_s, board, triangle, level_pa=float(rng.uniform(10e3, 60e3)))]
    return [InjectedFault(kind, begin_s, until_s, board, triangle, chance=float(rng.uniform(0.03, 0.3)))]


def _taxel_fault(
    kind: FaultKind,
    rng: np.random.Generator,
    where: tuple[int, int],
    begin_s: float,
    until_s: float | None,
) -> InjectedFault:
    """Draw a fault of one taxel of a triangle."""
    level_pa: float | None = None
    if kind == "stuck":
        level_pa = float(rng.uniform(-80e3, 1500e3))
    elif kind == "saturated" and rng.random() < 0.5:
        level_pa = float(rng.uniform(50e3, 200e3))
    factor = float(rng.uniform(4, 20))
    taxel = int(_TAXELS[rng.integers(len(_TAXELS))])
    return InjectedFault(kind, begin_s, until_s, *where, taxel, level_pa=level_pa, factor=factor)
