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
from ..skin.geometry import N_TAXELS
from . import jumps as jumping
from .candidate import Candidate
from .evidence import Group, gather
from .fit import Evidence, Hypothesis
from .groups import Located
from .jumps import Jump
from .naming import Tried, heldout, left, worth
from .observed import Observed
from .strengths import freed


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Taxels, and what explains them but for jumps."""

    group: Group
    candidates: tuple[Candidate, ...]
    theta: Array


def rezeroed(
    observed: Sequence[Observed],
    slots: NDArray[np.intp],
    noise_count: Array,
    known: Sequence[Sequence[Jump]] = (),
    located: Located | None = None,
) -> list[list[Jump]]:
    """Jumps of boards in each recording, after the `known` ones: the largest first, each taken out before the next.

    `noise_count` (m,) of the taxels `slots`; `located`: with what they were explained by.
    """
    found = [list(each) for each in known] or [[] for _ in observed]
    parts = _parts(observed, slots, noise_count, located)
    boards = observed[0].layout.identities[:, 0][slots // N_TAXELS]
    residual, moved = _left(parts, observed, slots, noise_count, found)
    for i, each in enumerate(observed):
        while len(found[i]) < jumping.MOST_JUMPS:
            jump = jumping.strongest(each, residual[i])
            if jump is None:
                break
            tried = [*found[:i], [*found[i], jump], *found[i + 1 :]]
            after, moves = _left(parts, observed, slots, noise_count, tried)
            jump = jumping.nearer(each, after[i], jump, _whole(moves, tried, i, boards))
            tried = [*found[:i], [*found[i], jump], *found[i + 1 :]]
            after, moves = _left(parts, observed, slots, noise_count, tried)
            before = jumping.unrest(each, residual[i], jump.boards)
            settles = jumping.unrest(each, after[i], jump.boards) < jumping.SETTLES * before
            if not settles or abs(jump.shift_count) < jumping.AT_ONCE * abs(_whole(moves, tried, i, boards)):
                break  # it happens again and again, or little by little: physics
            if located is not None and not _pays(parts, observed, slots, noise_count, found, tried, jump.boards):
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
    observed: Sequence[Observed],
    slots: NDArray[np.intp],
    noise_count: Array,
    known: Sequence[Sequence[Jump]],
    tried: Sequence[Sequence[Jump]],
    boards: tuple[int, ...],
) -> bool:
    """Whether the jump that `tried` has beside the `known` ones is worth an effect to most taxels of its `boards`."""
    pays = asked = 0
    for part in parts:
        own = part.group.slots[np.isin(observed[0].layout.identities[:, 0][part.group.slots // N_TAXELS], boards)]
        if not own.size:
            continue
        group = gather(observed, own, noise_count[np.searchsorted(slots, own)], jumping.columns(observed, known))
        with_it = replace(group.evidence, jumps=jumping.columns(observed, tried))
        pays += own.size * worth(_judged(part, group, group.evidence), _judged(part, group, with_it, "rezero"))
        asked += own.size
    return 2 * pays > asked


def _judged(part: _Part, group: Group, evidence: Evidence, *more: str) -> Tried:
    """What explains `part` on some of its taxels, `evidence` those of the `group` with other jumps: `more` words."""
    null = Hypothesis(group.evidence, ()).fit()
    excess = max(null.mean_square() - group.floor, 1e-12)
    fitted = Hypothesis(evidence, part.candidates).fit(part.theta)
    unseen = (heldout(fitted, evidence, null.effective_pa.mean(axis=1))[0] - group.floor) / excess
    return Tried((*fitted.words, *more), fitted, left(fitted, evidence, group.floor, excess), unseen)


def _parts(
    observed: Sequence[Observed], slots: NDArray[np.intp], noise_count: Array, located: Located | None
) -> list[_Part]:
    """The located groups and, by the static model, what is left; all taxels by it, where nothing is located."""
    found, rest = [], np.ones(len(slots), bool)
    for named in located.named if located is not None else ():
        fitted = named.naming.best.fitted
        found.append(_Part(named.group, fitted.candidates, fitted.theta))
        rest[np.searchsorted(slots, named.group.slots)] = False
    if rest.any():
        group = gather(observed, slots[rest], noise_count[rest], jumping.columns(observed, [[] for _ in observed]))
        found.append(_Part(group, (), Hypothesis(group.evidence, ()).start))
    return found


def _left(
    parts: Sequence[_Part],
    observed: Sequence[Observed],
    slots: NDArray[np.intp],
    noise_count: Array,
    known: Sequence[Sequence[Jump]],
) -> tuple[list[Array], Array]:
    """(n, m) of each recording that is not explained, and (j, m) how far each jump moves it: activation, counts."""
    columns = jumping.columns(observed, known)
    residual, moves = np.empty((len(columns), len(slots))), np.empty((columns.shape[1], len(slots)))
    for part in parts:
        own = np.searchsorted(slots, part.group.slots)
        mixed = Hypothesis(replace(part.group.evidence, jumps=columns), part.candidates)
        hypothesis = Hypothesis(replace(part.group.taxels, jumps=columns), part.candidates)
        taxels = freed(hypothesis, hypothesis.at(mixed.fit(part.theta).theta))
        residual[:, own] = taxels.residual * noise_count[own]
        moves[:, own] = hypothesis.jumps_of(taxels) * noise_count[own]
    return np.split(residual, np.cumsum([len(each.first) for each in observed])[:-1]), moves
