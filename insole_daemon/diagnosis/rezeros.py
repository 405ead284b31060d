"""Boards that took their baselines anew, told from what memory and warmth do beside it.

Without physics every ramp of a material that relaxes looks abrupt, and hides a jump of some counts. So they are looked
for twice: in what the static model leaves, and, where one was found or a drift was named, in what all effects leave,
which says how large they are. A drift is smooth: of a jump that was taken for one, or happened beside one, all is left
at its moment. There it has to pay what any effect costs, on the taxels of its board and on blocks that were held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from . import jumps as jumping
from .candidate import Candidate
from .evidence import Group, Taxels, gather
from .fit import Evidence, Hypothesis
from .groups import Located
from .jumps import Jump
from .naming import Tried, heldout, left, worth
from .strengths import freed


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Taxels, and what explains them but for jumps."""

    group: Group
    candidates: tuple[Candidate, ...]
    theta: Array


def rezeroed(taxels: Taxels, known: Sequence[Sequence[Jump]] = (), located: Located | None = None) -> list[list[Jump]]:
    """Jumps of boards in each recording, after the `known` ones: the largest first, each taken out before the next.

    `located`: with what the `taxels` were explained by.
    """
    found = [list(each) for each in known] or [[] for _ in taxels.observed]
    parts, boards = _parts(taxels, located), taxels.boards
    residual, moved = _left(parts, taxels, found)
    for i, each in enumerate(taxels.observed):
        while len(found[i]) < jumping.MOST_JUMPS:
            jump = jumping.strongest(each, residual[i])
            if jump is None:
                break
            tried = [*found[:i], [*found[i], jump], *found[i + 1 :]]
            after, moves = _left(parts, taxels, tried)
            jump = jumping.nearer(each, after[i], jump, _whole(moves, tried, i, boards))
            tried = [*found[:i], [*found[i], jump], *found[i + 1 :]]
            after, moves = _left(parts, taxels, tried)
            before = jumping.unrest(each, residual[i], jump.boards)
            settles = jumping.unrest(each, after[i], jump.boards) < jumping.SETTLES * before
            if not settles or abs(jump.shift_count) < jumping.AT_ONCE * abs(_whole(moves, tried, i, boards)):
                break  # it happens again and again, or little by little: physics
            if located is not None and not _pays(parts, taxels, found, tried, jump.boards):
                break
            found, residual, moved = tried, after, moves
    rows = iter(moved)
    sized = [
        [replace(jump, shift_count=-float(next(rows)[np.isin(boards, jump.boards)].mean())) for jump in own]
        for own in found
    ]
    # What was nearest before a larger one was known may be nothing beside it.
    return [[jump for jump in own if abs(jump.shift_count) > jumping.LEAST_COUNT / 2] for own in sized]


def _whole(moves: Array, tried: Sequence[Sequence[Jump]], i: int, boards: NDArray[np.uint8]) -> float:
    """How far the last jump of recording `i` moves its board: activation, counts."""
    at = sum(map(len, tried[: i + 1])) - 1
    return float(np.mean(moves[at][np.isin(boards, tried[i][-1].boards)]))


def _pays(
    parts: Sequence[_Part],
    taxels: Taxels,
    known: Sequence[Sequence[Jump]],
    tried: Sequence[Sequence[Jump]],
    boards: tuple[int, ...],
) -> bool:
    """Whether the jump that `tried` has beside the `known` ones is worth an effect to most taxels of its `boards`."""
    pays = asked = 0
    for part in parts:
        whole = taxels.at(part.group.slots)
        own = whole.some(np.isin(whole.boards, boards))
        if not own.slots.size:
            continue
        group = gather(own, jumping.columns(own.observed, known))
        with_it = replace(group.evidence, jumps=jumping.columns(own.observed, tried))
        pays += own.slots.size * worth(_judged(part, group, group.evidence), _judged(part, group, with_it, "rezero"))
        asked += own.slots.size
    return 2 * pays > asked


def _judged(part: _Part, group: Group, evidence: Evidence, *more: str) -> Tried:
    """What explains `part` on some of its taxels, `evidence` those of the `group` with other jumps: `more` words."""
    null = Hypothesis(group.evidence, ()).fit()
    excess = max(null.mean_square() - group.floor, 1e-12)
    fitted = Hypothesis(evidence, part.candidates).fit(part.theta)
    unseen = (heldout(fitted, evidence, null.effective_pa.mean(axis=1))[0] - group.floor) / excess
    return Tried((*fitted.words, *more), fitted, left(fitted, evidence, group.floor, excess), unseen)


def _parts(taxels: Taxels, located: Located | None) -> list[_Part]:
    """The located groups and, by the static model, what is left; all taxels by it, where nothing is located."""
    found, rest = [], np.ones(len(taxels.slots), bool)
    for named in located.named if located is not None else ():
        fitted = named.naming.best.fitted
        found.append(_Part(named.group, fitted.candidates, fitted.theta))
        rest[np.searchsorted(taxels.slots, named.group.slots)] = False
    if rest.any():
        group = gather(taxels.some(rest), jumping.columns(taxels.observed, [[] for _ in taxels.observed]))
        found.append(_Part(group, (), Hypothesis(group.evidence, ()).start))
    return found


def _left(parts: Sequence[_Part], taxels: Taxels, known: Sequence[Sequence[Jump]]) -> tuple[list[Array], Array]:
    """(n, m) of each recording that is not explained, and (j, m) how far each jump moves it: activation, counts."""
    columns = jumping.columns(taxels.observed, known)
    n, m = len(columns), len(taxels.slots)
    residual, moves = np.empty((n, m)), np.empty((columns.shape[1], m))
    for part in parts:
        own = np.searchsorted(taxels.slots, part.group.slots)
        mixed = Hypothesis(replace(part.group.evidence, jumps=columns), part.candidates)
        hypothesis = Hypothesis(replace(part.group.taxels, jumps=columns), part.candidates)
        each = freed(hypothesis, hypothesis.at(mixed.fit(part.theta).theta))
        residual[:, own] = each.residual * taxels.noise_count[own]
        moves[:, own] = hypothesis.jumps_of(each) * taxels.noise_count[own]
    return np.split(residual, np.cumsum([len(each.first) for each in taxels.observed])[:-1]), moves
