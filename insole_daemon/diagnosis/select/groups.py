"""Sets of triangles that are neither a board nor one triangle: for every term, those that gain by it together."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..model.blocks import BlockDesign
from .search import FittedSet, SubsetSearch

MOST_GROUPS = 16
LEAST_BETTER = 1.02  # times what the best board, triangle or the insole gains


def with_groups(design: BlockDesign, best: FittedSet) -> BlockDesign:
    """`design` with further candidates, beside `best` and in the place of each of its candidates."""
    found: dict[tuple[int, bytes], tuple[float, NDArray[np.bool_]]] = {}
    search = SubsetSearch(design)
    every = [design.candidates[k] for k in best.chosen]
    memories = frozenset(each.word for each in every if each.term.absorbs)
    # What stands at several places may be one effect, under one name or, by chance, under two.
    for words in {frozenset(), memories, *(frozenset({each.word}) for each in every)}:
        rest = search.fit([k for k, each in zip(best.chosen, every, strict=True) if each.word not in words])
        for k, rows, score in _groups(design, rest, words):
            found[k, rows.tobytes()] = (score, rows)
    ordered = sorted(found.items(), key=lambda item: -item[1][0])[:MOST_GROUPS]
    return design.extended([(k, rows) for (k, _), (_, rows) in ordered])


def _groups(design: BlockDesign, rest: FittedSet, words: frozenset[str]) -> list[tuple[int, NDArray[np.bool_], float]]:
    """Candidates' numbers, triangles (T,) and what they gain less their price."""
    left = _left(design, rest)
    works = np.asarray(design.seen.usable.any(axis=1))
    taxels = design.seen.usable.sum(axis=1)
    found = []
    for k, candidate in enumerate(design.candidates):
        if candidate.where.scope != "insole" or "triangle" not in candidate.term.scopes or candidate.term.is_internal:
            continue
        if words and candidate.word not in words:
            continue
        atoms = design.atom[candidate.columns]
        r, gram = left[:, atoms], design.atoms.gram[:, atoms][:, :, atoms]
        ridge = 1e-6 * np.einsum("tkk->tk", gram)[..., None] * np.eye(len(atoms)) + 1e-12 * np.eye(len(atoms))
        shares = np.linalg.solve(gram + ridge, r[..., None])[..., 0]
        gains = np.where(works, np.einsum("tk,tk->t", r, shares), -np.inf)
        if candidate.term.share == "positive":
            gains = np.where((r > 0).any(axis=1), gains, -np.inf)
        # Triangles that have the same effect have it with the same sign.
        strongest = shares[int(np.argmax(gains))]
        gains = np.where(shares @ strongest > 0, gains, -np.inf)
        order = [t for t in np.argsort(-gains).tolist() if np.isfinite(gains[t])]
        each = design.least[k] / max(float(taxels.sum()), 1.0)
        scores = []
        for m in range(1, len(order) + 1):
            part = order[:m]
            r_sum, gram_sum = r[part].sum(axis=0), (gram + ridge)[part].sum(axis=0)
            price = each * float(taxels[part].sum()) + 2 * math.log(math.comb(int(works.sum()), m))
            scores.append(float(r_sum @ np.linalg.solve(gram_sum, r_sum)) - price)
        if not scores or max(scores) <= 0:
            continue
        m = int(np.argmax(scores)) + 1
        rows = np.zeros(len(works), np.bool_)
        rows[order[:m]] = True
        if 1 < m < works.sum() and scores[m - 1] > LEAST_BETTER * _best_usual(design, r, gram + ridge, works):
            found.append((k, rows, scores[m - 1]))
    return found


def _best_usual(design: BlockDesign, r: Array, gram: Array, works: NDArray[np.bool_]) -> float:
    """What the best board or triangle, or the whole insole, gains, without a price."""
    boards = design.seen.layout.identities[:, 0]
    places = [works, *(works & (boards == board) for board in np.unique(boards))]
    return max(
        float(r[p].sum(axis=0) @ np.linalg.solve(gram[p].sum(axis=0), r[p].sum(axis=0))) for p in places if p.any()
    )


def _left(design: BlockDesign, rest: FittedSet) -> Array:
    """(T, K) inner products of all atoms with what `rest` leaves, by triangle."""
    left = design.left_of_atoms.copy()
    for k, shares in zip(rest.chosen, rest.shares, strict=True):
        for column, share in zip(design.candidates[k].columns, shares, strict=True):
            left -= design.atoms.gram[:, design.atom[column]] * (share * design.mask[column])[:, None]
    return left
