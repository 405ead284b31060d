"""Place terms in a block design: on the insole, on each board or triangle, or on given sets of triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import SCOPES
from ..observations.chamber import ChamberObservation
from ..observations.wrench import WrenchObservation
from ..terms.term import Term, TermColumns
from .regression import PlacedTerm


class Placement:
    """Candidates of terms, with the atom and the triangles of each of their columns."""

    def __init__(self, seen: ChamberObservation) -> None:
        self._seen = seen
        self.candidates: list[PlacedTerm] = []
        self._atom: list[int] = []
        self._mask: list[NDArray[np.bool_]] = []
        self._n_atoms = 0

    @property
    def atom(self) -> NDArray[np.intp]:
        """Return the atom of each column (p,)."""
        return np.array(self._atom, np.intp)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Return the triangles of each column (p, T)."""
        return np.array(self._mask)

    def add(self, term: Term, block: TermColumns) -> None:
        """Add the candidates of one block, whose columns are the next atoms."""
        k = len(block.settings)
        groups = [list(range(k))] if block.joint else [[j] for j in range(k)]
        for where, rows, n_places in self._places(term, block):
            for group in groups:
                if block.places is not None:
                    where, rows = self._of_column(block.places[group[0]])
                ids = len(self._atom) + np.arange(len(group))
                self._atom += [self._n_atoms + j for j in group]
                self._mask += [rows] * len(group)
                settings = tuple(block.settings[j] for j in group)
                self.candidates.append(PlacedTerm(
                    term, where, settings, ids, n_places, np.empty(0, np.intp), in_means=block.in_means
                ))  # fmt: skip
        self._n_atoms += k

    def _places(self, term: Term, block: TermColumns) -> Iterator[tuple[Where, NDArray[np.bool_], int]]:
        if block.places is not None:  # each column has a place of its own
            yield Where(), np.empty(0, np.bool_), block.n_searched
            return
        identities = [tuple(identity) for identity in self._seen.layout.identities.tolist()]
        works = self._seen.usable.any(axis=1)
        scopes = ("insole",) if block.whole is not None else term.scopes
        for scope in scopes:
            if (term.word, scope) in self._seen.settled:
                continue
            depth = SCOPES.index(scope)
            parts = sorted({identity[:depth] for identity in identities})
            for part in parts:
                rows = np.array([identity[:depth] == part for identity in identities]) & works
                if rows.any():
                    yield (Where(scope, (part,)) if depth else Where()), rows, len(parts)

    def _of_column(self, triangles: tuple[tuple[int, ...], ...]) -> tuple[Where, NDArray[np.bool_]]:
        """Return the place of a column that has one of its own."""
        identities = [tuple(identity) for identity in self._seen.layout.identities.tolist()]
        return Where("triangle", triangles), np.array([identity in triangles for identity in identities])


def place_of(rows: NDArray[np.bool_], seen: WrenchObservation) -> Where:
    """Return the coarsest place that consists of the triangles `rows` (T,); the insole if there are none."""
    works = seen.usable.any(axis=1)
    if np.array_equal(rows & works, works) or not rows.any():
        return Where()
    identities = seen.layout.identities
    boards = np.unique(identities[rows, 0])
    of_boards = np.isin(identities[:, 0], boards) & works
    if np.array_equal(rows & works, of_boards):
        return Where("board", tuple((int(board),) for board in boards))
    return Where("triangle", tuple((int(b), int(t)) for b, t in identities[rows].tolist()))
