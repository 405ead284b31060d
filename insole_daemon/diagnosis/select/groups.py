"""Add candidates at sets of triangles that are neither a board nor a single triangle.

For every term, the triangles are ordered by the gain of the term in each, and the m best are a set; m has the highest
gain after the penalty. The order needs one solution per triangle instead of one per subset.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..model.blocks import BlockDesign
from .each_triangle import of_each_triangle
from .search import FittedSet, SubsetSearch

MOST_GROUPS = 16
LEAST_BETTER = 1.02  # times the gain at the insole or at the best board


def with_groups(design: BlockDesign, best: FittedSet) -> BlockDesign:
    """Return `design` with up to MOST_GROUPS further candidates at sets of triangles.

    Sets are looked for in the residual of `best`, and in that of `best` without one of its words, or without all
    memories: an effect on a set may have been selected as several effects, with one word or with two.
    """
    groups: dict[tuple[int, bytes], tuple[float, NDArray[np.bool_]]] = {}
    search = SubsetSearch(design)
    selected = [design.candidates[k] for k in best.chosen]
    memories = frozenset(candidate.word for candidate in selected if candidate.term.absorbs)
    for words in {frozenset(), memories, *(frozenset({candidate.word}) for candidate in selected)}:
        rest = search.fit([k for k, one in zip(best.chosen, selected, strict=True) if one.word not in words])
        for k, triangles, score in _groups(design, rest, words):
            groups[k, triangles.tobytes()] = (score, triangles)
    ordered = sorted(groups.items(), key=lambda item: -item[1][0])[:MOST_GROUPS]
    return design.extended([(k, triangles) for (k, _), (_, triangles) in ordered])


def _groups(design: BlockDesign, rest: FittedSet, words: frozenset[str]) -> list[tuple[int, NDArray[np.bool_], float]]:
    """Return (k, triangles (T,), gain less penalty) of sets in the residual of `rest`; with `words`, of these only."""
    cross = design.residual_cross([design.candidates[k] for k in rest.chosen], rest.shares)
    works = np.asarray(design.seen.usable.any(axis=1))
    taxels = design.seen.usable.sum(axis=1)
    groups = []
    for k, candidate in enumerate(design.candidates):
        if candidate.where.scope != "insole" or "triangle" not in candidate.term.scopes or candidate.term.is_internal:
            continue
        if words and candidate.word not in words:
            continue
        r, gram, shares = of_each_triangle(design, candidate, cross)
        gains = np.where(works, np.einsum("tk,tk->t", r, shares), -np.inf)
        if candidate.term.share == "positive":
            gains = np.where((r > 0).any(axis=1), gains, -np.inf)
        # One effect has the same sign in all triangles.
        strongest = shares[int(np.argmax(gains))]
        gains = np.where(shares @ strongest > 0, gains, -np.inf)
        order = [t for t in np.argsort(-gains).tolist() if np.isfinite(gains[t])]
        least_per_taxel = design.least[k] / max(float(taxels.sum()), 1.0)
        scores = []
        for m in range(1, len(order) + 1):
            group = order[:m]
            r_sum, gram_sum = r[group].sum(axis=0), gram[group].sum(axis=0)
            penalty = least_per_taxel * float(taxels[group].sum()) + 2 * math.log(math.comb(int(works.sum()), m))
            scores.append(float(r_sum @ np.linalg.solve(gram_sum, r_sum)) - penalty)
        if not scores or max(scores) <= 0:
            continue
        m = int(np.argmax(scores)) + 1
        triangles = np.zeros(len(works), np.bool_)
        triangles[order[:m]] = True
        if 1 < m < works.sum() and scores[m - 1] > LEAST_BETTER * _best_regular_gain(design, r, gram, works):
            groups.append((k, triangles, scores[m - 1]))
    return groups


def _best_regular_gain(design: BlockDesign, r: Array, gram: Array, works: NDArray[np.bool_]) -> float:
    """Return the largest gain at one of the places that are candidates anyway: the insole, and each board.

    `r` (T, k): inner products of a term's columns with the residual; `gram` (T, k, k): among themselves; `works` (T,).
    """
    boards = design.seen.layout.identities[:, 0]
    places = [works, *(works & (boards == board) for board in np.unique(boards))]
    return max(
        float(r[p].sum(axis=0) @ np.linalg.solve(gram[p].sum(axis=0), r[p].sum(axis=0))) for p in places if p.any()
    )
