"""The regression of a recording in which the load is known only as a wrench.

Rows are weighted by their variance. Nuisance columns (timing, zero of the reference, errors of the calibration) are in
every model, with tight priors. They are projected out once, so the fit of a set of candidates is a small problem:

    minimise |y − X·θ|² + Σ (θ_j/σ_j)²   over θ of the candidates, nuisance columns projected out
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import SCOPES, Array
from ...skin.geometry import N_TAXELS
from ..load_estimate import LoadEstimate
from ..observations.broken_taxels import DONORS
from ..observations.wrench import WrenchObservation
from ..terms import TERMS
from ..terms.term import Setting, Term, TermColumns
from .regression import PlacedTerm, Timing, with_companions
from .solve import RIDGE
from .wrench_nuisance import NuisanceColumns, apply_weights, nuisance_columns, project

LEAST_SHARE = 0.1  # smallest gain of an effect, in the noise's sum of squares of one channel
LEAST_GAIN = (
    30.0  # smallest gain, sum of squares: for short recordings, and for what priors exclude from nuisance columns
)
MOST_NOISE = 0.5  # of the sum of squares of a column beside the nuisance columns
ROWS_AT_ONCE = 2048  # of the columns, to project nuisances out without a copy of all of them
BETWEEN_READINGS = 0.87  # mean share of the noise at the times of readings that cubics between them keep
LEAST_LOADED = 0.05  # of the largest force, below which no board bears a share of it
AT_REST, BEFORE_LOAD_S = 0.03, 0.1  # of the usual largest force: the foot is in the air; margin before its first load
# Companions whose columns are computed from the reference, by their words.
COMPANIONS_OF_REFERENCE = {term.word: term for term in TERMS if term.is_of_reference and term.is_internal}
STATIC = frozenset({"gain", "baseline", "stiffening", "preload", "bit_shift"})  # effects that a calibration contains


@dataclass(frozen=True, slots=True, eq=False)
class MovedColumns:
    """Columns computed from the reference after a timing, in place of those numbered `numbers` (q,)."""

    numbers: NDArray[np.intp]
    raw: NDArray[np.float32]  # (3N, q)


@dataclass(frozen=True, eq=False)
class Design:
    """Regression of one recording: candidates, and their Gram matrix with nuisance columns projected out."""

    load: LoadEstimate
    weights: Array  # (N, 3) one over the standard deviation of a row; 0 if unknown
    base: NuisanceColumns
    candidates: tuple[PlacedTerm, ...]
    raw: NDArray[np.float32]  # (3N, p) weighted columns of the candidates
    target: Array  # (3N + b,) weighted residual of the static model, nuisance columns projected out
    gram: Array  # (p, p) inner products of the columns, nuisance columns projected out
    cross: Array  # (p,) inner products with `target`, less `product`
    product: Array  # (p,) covariance of noise in a column with that of the target
    total: float  # sum of squares of `target`, with the noise that the interpolation averaged
    timing: Timing = Timing()  # noqa: RUF009 (frozen)
    moved: MovedColumns | None = None  # those of `timing`; `raw`, which is large, is shared

    @cached_property
    def kept_share(self) -> Array:
        """Return the share (p,) of a column's sum of squares that the projection leaves."""
        whole = np.einsum("ij,ij->j", self.raw, self.raw, dtype=np.float64)
        return np.asarray(np.diag(self.gram) / np.maximum(whole, 1e-300))

    @cached_property
    def n_rows(self) -> int:
        """Return the number of rows with a weight, in one channel."""
        return int(np.count_nonzero(self.weights[:, 0]))

    @cached_property
    def noise(self) -> float:
        """Return the expected sum of squares of y by noise alone, in variances of the noise."""
        return float(np.count_nonzero(self.weights))

    @cached_property
    def undone(self) -> float:
        """Return the sum of squares of what memories changed that were undone, in variances of the noise."""
        change = self.load.observation.undone_change
        if change is None:
            return 0.0
        return float(np.sum(project(self.base, apply_weights(change[..., None], self.weights)) ** 2))

    @cached_property
    def least(self) -> Array:
        """Return the gain (c,) of the smallest effect that each candidate may report, in variances of the noise."""
        return np.full(len(self.candidates), max(LEAST_GAIN, LEAST_SHARE * self.n_rows))

    @cached_property
    def _at_rest(self) -> tuple[NDArray[np.intp], Array, Array]:
        """Return the rows, of 3N, before the first load, the residual there, and the nuisances' covariance (b, b)."""
        seen = self.load.observation
        wrench = seen.reference.at(seen.reference_s)
        bears_load = wrench[:, 0] > AT_REST * float(np.quantile(wrench[:, 0], 0.99))
        first = int(np.argmax(bears_load)) if bears_load.any() else 0
        is_before = seen.t_s < seen.t_s[first] - BEFORE_LOAD_S
        rows = np.flatnonzero(np.repeat(is_before, wrench.shape[1]))
        residual = apply_weights((wrench - seen.wrench)[is_before, :, None], self.weights[is_before])[:, 0]
        matrix = self.base.matrix[rows]
        covariance = np.asarray(np.linalg.inv(matrix.T @ matrix + np.diag(self.base.prior_std**-2.0)), np.float64)
        return np.asarray(rows), residual, covariance

    def gain_at_rest(self, candidate: PlacedTerm) -> float:
        """Return the gain of `candidate` alone on the rows before the first load, in variances of the noise."""
        rows, residual, covariance = self._at_rest
        if not rows.size:
            return 0.0
        matrix, columns = self.base.matrix[rows], self.raw[np.ix_(rows, candidate.columns)].astype(np.float64)
        beside = columns - matrix @ (covariance @ (matrix.T @ columns))
        gram, cross = beside.T @ columns, beside.T @ residual
        return float(cross @ np.linalg.lstsq(gram, cross, rcond=RIDGE)[0])

    def is_within_priors(self, candidate: PlacedTerm) -> bool:
        """Return whether nuisance columns, all together, explain the same within their priors."""
        return candidate.is_recalibration and candidate.where.scope == "insole"

    def size(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the sum of squares of what `candidate` changes, before nuisance columns are projected out."""
        return float(np.sum((self.raw[:, candidate.columns].astype(np.float64) @ shares) ** 2))

    def retimed(self, timing: Timing) -> Design:
        """Return the regression on the reference after `timing`."""
        target, total = _target(self.load, self.weights, self.base, timing)
        moved, gram = (self.moved, self.gram) if timing == self.timing else self._moved(timing)
        cross = _products(self.raw, target) - self.product
        if moved is not None:
            cross[moved.numbers] = _products(moved.raw, target) - self.product[moved.numbers]
        return replace(
            self, target=target, gram=gram, cross=cross, total=total, timing=timing, moved=moved,
        )  # fmt: skip

    def _moved(self, timing: Timing) -> tuple[MovedColumns | None, Array]:
        """Return the columns that move with the reference, after `timing`, and the Gram matrix with them."""
        of_terms = self._columns_of_reference()
        if not of_terms:
            return None, self.gram
        load = LoadEstimate(_after(self.load.observation, timing))
        blocks = [_columns_at(block, Where(), self) for term, _ in of_terms for block in term.columns(load)]
        numbers = np.concatenate([numbers for _, numbers in of_terms])
        weighted = apply_weights(np.concatenate(blocks, axis=2), self.weights)
        projected = project(self.base, weighted)
        products = _products(self.raw, projected)
        products[numbers] = projected.T @ projected
        gram = self.gram.copy()
        gram[:, numbers] = products
        gram[numbers] = products.T
        return MovedColumns(numbers, weighted.astype(np.float32)), gram

    def _columns_of_reference(self) -> list[tuple[Term, NDArray[np.intp]]]:
        """Return the terms whose columns are computed from the reference, with the numbers of the columns."""
        by_first = {int(c.columns[0]): (c.term, c.columns) for c in self.candidates if c.term.is_of_reference}
        for candidate in self.candidates:
            for word, column in zip(candidate.companion_words, candidate.companions.tolist(), strict=True):
                if word in COMPANIONS_OF_REFERENCE:
                    by_first[column] = (COMPANIONS_OF_REFERENCE[word], np.array([column]))
        return list(by_first.values())

    def subset(self, chosen: Sequence[int]) -> Design:
        """Return the regression with the columns of `chosen` candidates and their companions."""
        return self._with([self.candidates[k] for k in chosen])

    def _with(self, picked: Sequence[PlacedTerm]) -> Design:
        """Return the regression with the columns of the candidates `picked` and their companions."""
        columns, candidates = _renumbered(picked)
        raw = self.raw[:, columns]
        if self.moved is not None:
            for k, number in enumerate(self.moved.numbers.tolist()):
                raw[:, columns == number] = self.moved.raw[:, k, None]
        return replace(
            self, candidates=candidates, raw=raw, gram=self.gram[np.ix_(columns, columns)],
            cross=self.cross[columns], product=self.product[columns], moved=None,
        )  # fmt: skip

    def of_laws(self) -> Design:
        """Return the regression with the laws alone, without columns for their misfit."""
        return self._with([candidate.of_law() for candidate in self.candidates])

    def with_wider_laws(self) -> Design | None:
        """Return the regression with columns of laws that the search has not; None if there are none."""
        wider = None
        for i, candidate in enumerate(self.candidates):
            if candidate.term.also_in_law is not None:
                load = self.load.before(candidate.term.order)
                wider = (wider or self)._with_more_columns(i, candidate.term.also_in_law(load))
        return wider

    def _with_more_columns(self, i: int, block: TermColumns) -> Design:
        """Return the regression whose candidate `i` has the columns of `block`, too."""
        candidate = self.candidates[i]
        weighted = apply_weights(_columns_at(block, candidate.where, self), self.weights)
        projected = project(self.base, weighted)
        numbers = len(self.cross) + np.arange(weighted.shape[1])
        raw = np.concatenate([self.raw, weighted.astype(np.float32)], axis=1)
        products = _exact_products(raw, projected)
        gram = np.block([[self.gram, products[: len(self.cross)]], [products.T]])
        more = replace(
            candidate, settings=(*candidate.settings, *block.settings), columns=np.append(candidate.columns, numbers)
        )
        return replace(
            self, raw=raw, gram=gram, cross=np.append(self.cross, projected.T @ self.target),
            product=np.append(self.product, np.zeros(len(numbers))),
            candidates=tuple(more if j == i else other for j, other in enumerate(self.candidates)),
        )  # fmt: skip

    def without_companions(self, words: Collection[str]) -> Design:
        """Return the regression whose candidates have no companions of these `words`."""
        return replace(self, candidates=tuple(candidate.without(words) for candidate in self.candidates))

    def without_internal_companions(self) -> Design:
        """Return the regression itself: on a walk there are no companions for the misfit of laws."""
        return self

    def relinearised(self, i: int, setting: Setting, shares: Sequence[Array]) -> Design:
        """Return the regression with candidate `i` linearised at `setting`, about the readings."""
        return self.exchanged(i, setting)

    def exchanged(self, i: int, setting: Setting) -> Design:
        """Return the regression with another setting of candidate `i`."""
        copy = replace(self, raw=self.raw.copy(), gram=self.gram.copy(), cross=self.cross.copy())
        return copy.exchange(i, setting)

    def exchange(self, i: int, setting: Setting) -> Design:
        """Return the regression with another setting of candidate `i`, which shares the arrays with this one.

        Its columns overwrite those before: a copy of all columns is too large.
        """
        candidate, raw, gram = self.candidates[i], self.raw, self.gram
        block = candidate.term.column_of(self.load, setting)
        weighted = apply_weights(_columns_at(block, candidate.where, self), self.weights)
        projected = project(self.base, weighted)
        numbers = candidate.columns
        # The covariance of noise with a column changes little with its setting, so it is kept.
        before = raw[:, numbers].astype(float)
        product = _products(before, self.target) - self.cross[numbers]
        square = np.sum(project(self.base, before) ** 2, axis=0) - np.diag(gram)[numbers]
        raw[:, numbers] = weighted
        gram[:, numbers] = _exact_products(raw, projected)
        gram[numbers] = gram[:, numbers].T
        gram[numbers, numbers] -= np.minimum(square, 0.9 * gram[numbers, numbers])
        self.cross[numbers] = projected.T @ self.target - product
        candidates = tuple(replace(c, settings=block.settings) if j == i else c for j, c in enumerate(self.candidates))
        return replace(self, candidates=candidates)


def place_terms(
    load: LoadEstimate, substituted: NDArray[np.bool_]
) -> Iterator[tuple[PlacedTerm, Array, tuple[Array, Array] | None]]:
    """Yield every candidate with its columns (N, 3, k) and their noise echo; column numbers count up."""
    seen = load.observation
    unreliable = _substituted_and_donors(seen, substituted)
    number = 0
    for term in TERMS:
        if term.needs(load) is not None or term.word in seen.ruled_out:
            continue
        for block in term.placed_columns(load):
            for where, column, n_places, echo in _columns_at_places(term, block, seen):
                numbers = range(len(block.settings))
                groups = [list(numbers)] if block.joint else [[k] for k in numbers]
                for group in groups:
                    place = where if block.places is None else Where("triangle", block.places[group[0]])
                    places = n_places if block.places is None else block.n_searched or len(block.places)
                    if place.scope == "triangle" and unreliable & set(place.ids):
                        continue
                    if term.word in STATIC and _is_estimated(place, seen):
                        continue
                    ids = np.arange(number, number + len(group))
                    number += len(group)
                    settings = tuple(block.settings[k] for k in group)
                    echo_of_group = None if echo is None else (echo[0][..., group], echo[1][..., group])
                    no_companions = np.empty(0, np.intp)
                    candidate = PlacedTerm(term, place, settings, ids, places, no_companions, block.is_recalibration)
                    yield candidate, column[..., group], echo_of_group


def _substituted_and_donors(seen: WrenchObservation, substituted: NDArray[np.bool_]) -> set[tuple[int, ...]]:
    """Return the triangles with substituted taxels and their donors: an effect there would be that of a neighbour."""
    rows = [
        row
        for row_substituted in np.flatnonzero(substituted).tolist()
        for row in seen.nearest(row_substituted)[: 1 + DONORS].tolist()
    ]
    return {tuple(identity) for identity in seen.layout.identities[rows].tolist()}


def _is_estimated(place: Where, seen: WrenchObservation) -> bool:
    """Return whether a place has only uncalibrated triangles, so a static term has nothing to deviate from."""
    slots = place.slots(seen.layout)
    return seen.is_estimated is not None and bool(seen.is_estimated[np.unique(slots // N_TAXELS)].all())


def _columns_at_places(
    term: Term, block: TermColumns, seen: WrenchObservation
) -> Iterator[tuple[Where, Array, int, tuple[Array, Array] | None]]:
    """Yield the places of a block, with its columns (N, 3, k) there, the number of places and their noise echo."""

    def summed(rows: Sequence[int] | slice) -> tuple[Array, tuple[Array, Array] | None]:
        assert block.by_triangle is not None
        echo = block.echo
        echo_of_rows = None if echo is None else (echo[0][:, rows].sum(axis=1), echo[1][:, rows].sum(axis=1))
        return block.by_triangle[:, rows].sum(axis=1), echo_of_rows

    if block.whole is not None:
        yield Where(), block.whole, 1, block.echo
        return
    assert block.by_triangle is not None
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    for scope in term.scopes:
        if scope == "insole":
            column, echo = summed(slice(None))
            yield Where(), column, 1, echo
            continue
        depth = SCOPES.index(scope)
        places = sorted({identity[:depth] for identity in identities})
        for place in places:
            rows = [row for row, identity in enumerate(identities) if identity[:depth] == place]
            if seen.usable[rows].any():
                column, echo = summed(rows)
                yield Where(scope, (place,)), column, len(places), echo


def design(load: LoadEstimate, weights: Array, substituted: NDArray[np.bool_]) -> Design:
    """Return the regression of one recording."""
    base = nuisance_columns(load, weights, substituted)
    candidates: list[PlacedTerm] = []
    blocks: list[NDArray[np.float32]] = []
    product: list[Array] = []
    square: list[Array] = []
    for candidate, columns, echo in place_terms(load, substituted):
        candidates.append(candidate)
        blocks.append(apply_weights(columns, weights).astype(np.float32))
        for i, sums in enumerate((product, square)):
            if echo is None:
                sums.append(np.zeros(columns.shape[-1]))
            else:
                sums.append(np.asarray(np.sum(echo[i] * weights[..., None] ** 2, axis=(0, 1))))
    candidates = list(with_companions(candidates))
    raw = _joined(blocks)
    gram = _projected_gram(raw, base)
    target, total = _target(load, weights, base, Timing())
    cross = _products(raw, target) - np.concatenate(product)
    noise = np.concatenate(square)
    # Where nuisance columns leave more noise than signal of a column, its share would be that of the noise.
    is_noise = noise > MOST_NOISE * np.diag(gram)
    used, shown = _renumbered([each for each in candidates if not is_noise[each.columns].any()])
    np.fill_diagonal(gram, np.diag(gram) - np.minimum(noise, 0.9 * np.diag(gram)))
    return Design(
        load, weights, base, shown, _picked(raw, used), target, gram[np.ix_(used, used)], cross[used],
        np.concatenate(product)[used], total,
    )  # fmt: skip


def _target(load: LoadEstimate, weights: Array, base: NuisanceColumns, timing: Timing) -> tuple[Array, float]:
    """Return y (3N + b,) on the reference after `timing`, nuisance columns projected out, and its sum of squares.

    What interpolation and a lag take from the noise of the reference is added to the sum: otherwise the timing that
    averages most rows of the reference would have the smallest one.
    """
    seen = load.observation
    after = _after(seen, timing)
    kept = seen.reference.noise_kept(after.reference_s, timing.lag_s)[:, None]
    expected, kept = as_read(load, after, kept)
    target = project(base, apply_weights((expected - seen.wrench)[..., None], weights))[:, 0]
    removed = float(np.sum((weights * seen.reference.noise) ** 2 * (1.0 - kept)))
    return target, float(target @ target) + removed


def _after(seen: WrenchObservation, timing: Timing) -> WrenchObservation:
    """Return the same rows with the reference after `timing`."""
    return seen.timed(offset_s=seen.offset_s - timing.delay_s, reference=seen.reference.denoised.lagged(timing.lag_s))


def as_read(load: LoadEstimate, after: WrenchObservation, kept: Array) -> tuple[Array, Array]:
    """Return the reference (N, 3) as rows of readings show it, and the share (N, 3) of its noise that is left.

    Between the readings of a board the load is a cubic. Each board has the part of that error which it bears of the
    load in that row; nuisance columns describe what differs from it. `after`: the rows with the reference after a
    timing; `kept` (N, 1): the share of the noise in the reference itself.
    """
    force_n = load.by_triangle[..., 0]
    whole_n = np.maximum(force_n.sum(axis=1), LEAST_LOADED * float(np.max(force_n.sum(axis=1))))
    expected = after.reference.at(after.reference_s)
    replaced, squares = np.zeros_like(expected), np.zeros_like(expected)
    for board, (_, error) in after.interpolation_error.items():
        of_board = after.layout.identities[:, 0] == board
        share = np.clip(force_n[:, of_board].sum(axis=1) / whole_n, 0.0, 1.0)[:, None] * (error != 0.0)
        expected += share * error
        replaced += share
        squares += share**2
    return expected, kept * ((1.0 - replaced) ** 2 + BETWEEN_READINGS * squares)


def _projected_gram(raw: NDArray[np.float32], base: NuisanceColumns) -> Array:
    """Return the inner products (p, p) of weighted columns (3N, p), nuisance columns projected out."""
    basis = base.range.astype(np.float32)
    taken_up = basis[: len(raw)].T @ raw
    of_priors = basis[len(raw) :] @ taken_up
    gram: Array = (of_priors.T @ of_priors).astype(np.float64)
    for first in range(0, len(raw), ROWS_AT_ONCE):
        rows = slice(first, min(first + ROWS_AT_ONCE, len(raw)))
        left = raw[rows] - basis[rows] @ taken_up
        gram += left.T @ left
    return gram


def _products(raw: Array | NDArray[np.float32], projected: Array) -> Array:
    """Return the inner products (p, ...) of weighted columns (3N, p) with what is `projected`, (3N + b, ...).

    What the projection takes from the columns is orthogonal to `projected`, so they need no projection.
    """
    return np.asarray(raw.T @ projected[: len(raw)].astype(raw.dtype), np.float64)


def _exact_products(raw: NDArray[np.float32], projected: Array) -> Array:
    """Return the inner products of `_products` in double precision, without a copy of all columns."""
    parts = range(0, len(raw), ROWS_AT_ONCE)
    of_rows = projected[: len(raw)]
    return np.asarray(sum(raw[k : k + ROWS_AT_ONCE].astype(float).T @ of_rows[k : k + ROWS_AT_ONCE] for k in parts))


def _renumbered(picked: Sequence[PlacedTerm]) -> tuple[NDArray[np.intp], tuple[PlacedTerm, ...]]:
    """Return the columns (k,) of the candidates `picked` and their companions, and the candidates on these columns."""
    columns = np.unique(
        np.concatenate([np.concatenate([c.columns, c.companions]) for c in picked] or [np.empty(0, np.intp)])
    )

    def places(old: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.asarray(np.searchsorted(columns, old), np.intp)

    return columns, tuple(
        replace(c, columns=places(c.columns), companions=places(c.companions)) for c in picked
    )  # fmt: skip


def _picked(array: NDArray[np.float32], columns: NDArray[np.intp]) -> NDArray[np.float32]:
    """Return the `columns`, in rising order, of an array that is overwritten: a copy of it is too large."""
    for first in range(0, len(array), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        array[rows, : len(columns)] = array[rows, columns]
    return array[:, : len(columns)]


def _joined(blocks: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the columns of `blocks` as one array and empty the list: they are the largest arrays of a diagnosis."""
    joined = np.empty((len(blocks[0]), sum(block.shape[1] for block in blocks)), np.float32)
    end = joined.shape[1]
    while blocks:
        block = blocks.pop()
        joined[:, end - block.shape[1] : end] = block
        end -= block.shape[1]
    return joined


def _columns_at(block: TermColumns, where: Where, design: Design) -> Array:
    """Return the columns (N, 3, k) of a block at a place."""
    if block.whole is not None:
        return block.whole
    assert block.by_triangle is not None
    depth = SCOPES.index(where.scope)
    rows = [
        row for row, identity in enumerate(design.load.observation.layout.identities.tolist())
        if depth == 0 or tuple(identity[:depth]) in where.ids
    ]  # fmt: skip
    return np.asarray(block.by_triangle[:, rows].sum(axis=1))
