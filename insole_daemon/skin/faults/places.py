"""The pressure taxels among a foot's 12 · n_triangles words, with their triangles and boards."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..geometry import PRESSURE_TAXELS
from ..layout import Layout


class Places:
    """The n pressure taxels of one foot, row-major without the thermal pads, their triangles and boards."""

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        """`boards` by address, those of the layout at least."""
        self.layout = layout
        self.taxel = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout)))  # (n,) among the 12 · n_triangles
        self.triangle = self.taxel // 12  # (n,)
        of_triangle = [triangle.board for triangle in layout.triangles]
        self.addresses = tuple(dict.fromkeys(of_triangle))
        self.board_of_triangle = np.array([self.addresses.index(address) for address in of_triangle])
        self.board = self.board_of_triangle[self.triangle]  # (n,) place of its board among `addresses`
        settings = [boards[address] for address in self.addresses]
        self.period_ns = np.array([board.period_ms * 1_000_000 for board in settings], np.int64)
        self.no_load = np.array([board.no_load for board in settings])
        self.shift = np.array([board.shift for board in settings])
        self._by_board = np.argsort(self.board_of_triangle)
        self._first = np.searchsorted(self.board_of_triangle[self._by_board], np.arange(len(self.addresses)))

    def most_of_board(self, of_triangle: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the maximum of (n_triangles,) on each board, (n_boards,)."""
        most: NDArray[np.int64] = np.maximum.reduceat(of_triangle[self._by_board], self._first)
        return most

    def any_of_board(self, of_triangle: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return whether any of (n_triangles,) is True on each board, (n_boards,)."""
        any_triangle: NDArray[np.bool_] = np.logical_or.reduceat(of_triangle[self._by_board], self._first)
        return any_triangle
