"""Columns of all terms as sufficient statistics of one weighted regression.

Rows are weighted by their variance. Base terms (timing, zero of the reference, what a calibration may be off by) are
in every model, with tight priors; they are eliminated once, so that a set of candidates is a small problem:

    minimise |y − X·θ|² + Σ (θ_j/σ_j)²   over θ of the candidates, base terms projected out
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import SCOPES, Array
from ...skin.geometry import N_TAXELS
from ..observations.reading_faults import DONORS
from ..observations.wrench import WrenchObservation
from ..terms import TERMS
from ..terms.term import Setting, Term, TermColumns
from .load import LoadEstimate
from .regression import PlacedTerm, Timing, with_companions

LEAST_SHARE = 0.1  # of the noise's squared sum in one channel: less is no effect worth a name
LEAST_GAIN = 30.0  # squared residual: of a recording that is short, and of what nuisances could be but for their priors
GAIN_STD = 0.005  # of a triangle's calibration
BASELINE_STD_COUNT = 0.02  # of a board's, common to its taxels
ZERO_STD = (0.5, 0.02, 0.05)  # of the reference, N and N·m
OWN_OFFSET_STD_S, OWN_RATE_STD = 1.0, 0.1  # of a clock that is not declared to be that of the CAN frames
UNRESOLVED_STD = 0.5  # of the share of the load that a board carries while a cubic misses an edge
CURVE_STD_COUNT, CURVE_KNOTS = 0.05, 7
CURVE_STD_AT_REST_COUNT = 0.015  # of the first knot: a baseline is read, not fitted
SUBSTITUTED_STD = 0.5  # of the share of a triangle whose dead taxels are stood in for by their neighbours
NEIGHBOURS = 6  # each of which a triangle without a working taxel may bear the load of, by as much
STATIC = frozenset({"gain", "baseline", "stiffening", "preload", "bit_shift"})  # what a calibration would contain


@dataclass(frozen=True, eq=False)
class Base:
    """Columns of the base terms (3N, b), weighted, with their prior standard deviations."""

    names: tuple[str, ...]
    matrix: Array
    prior_std: Array

    @cached_property
    def range(self) -> Array:
        """(3N + b, b) orthonormal, of the columns with the rows of their priors below them."""
        return np.asarray(np.linalg.qr(np.concatenate([self.matrix, np.diag(1.0 / self.prior_std)]))[0])


@dataclass(frozen=True, eq=False)
class Design:
    """The regression of one recording: candidates, and their Gram matrix with the base projected out."""

    load: LoadEstimate
    weights: Array  # (N, 3) one over the standard deviation of a row; 0: unknown
    base: Base
    candidates: tuple[PlacedTerm, ...]
    raw: NDArray[np.float32]  # (3N, p) weighted columns of the candidates
    matrix: NDArray[np.float32]  # (3N + b, p) the same, base projected out
    target: Array  # (3N,) weighted residual of the static model, base projected out
    gram: Array  # (p, p)
    cross: Array  # (p,)
    product: Array  # (p,) of the echo of noise, taken off `cross`
    total: float  # squared sum of `target`

    @cached_property
    def kept_share(self) -> Array:
        """(p,) share of a column's square that the base leaves."""
        whole = np.einsum("ij,ij->j", self.raw, self.raw, dtype=np.float64)
        return np.asarray(np.diag(self.gram) / np.maximum(whole, 1e-300))

    @cached_property
    def n_rows(self) -> int:
        """Rows with a weight, of one channel."""
        return int(np.count_nonzero(self.weights[:, 0]))

    @cached_property
    def least(self) -> Array:
        """(c,) squared sum, in variances of the noise, of the smallest effect worth a name, of each candidate."""
        return np.full(len(self.candidates), max(LEAST_GAIN, LEAST_SHARE * self.n_rows))

    def retimed(self, timing: Timing) -> Design:
        """Against the reference after `timing`.

        A lag averages the reference's noise; what of its square is missing for that is added again.
        """
        seen = self.load.observation
        said = seen.reference.at(seen.reference_s - timing.delay_s, timing.lag_s) - seen.wrench
        target = project(self.base, apply_weights(said[..., None], self.weights))[:, 0]
        cross = (self.matrix.T @ target.astype(np.float32)).astype(np.float64) - self.product
        missing = 1.0 - seen.reference.noise_kept(timing.lag_s)
        averaged = float(np.sum(self.weights**2 * seen.reference.noise**2)) * missing
        return replace(self, target=target, cross=cross, total=float(target @ target) + averaged)

    def subset(self, chosen: Sequence[int]) -> Design:
        """With the columns of `chosen` candidates and their companions alone."""
        picked = [self.candidates[k] for k in chosen]
        columns = np.unique(
            np.concatenate([np.concatenate([c.columns, c.companions]) for c in picked] or [np.empty(0, np.intp)])
        )
        place = {int(old): new for new, old in enumerate(columns)}

        def renumbered(old: NDArray[np.intp]) -> NDArray[np.intp]:
            return np.array([place[int(k)] for k in old], np.intp)

        candidates = tuple(
            replace(c, columns=renumbered(c.columns), companions=renumbered(c.companions)) for c in picked
        )
        return replace(
            self, candidates=candidates, raw=self.raw[:, columns],
            matrix=self.matrix[:, columns], gram=self.gram[np.ix_(columns, columns)],
            cross=self.cross[columns], product=self.product[columns],
        )  # fmt: skip

    def of_laws(self) -> Design:
        """Itself: of a load that readings tell, nothing beside the laws is fitted."""
        return self

    def exchanged(self, i: int, setting: Setting) -> Design:
        """With another setting of candidate `i`."""
        candidate = self.candidates[i]
        block = candidate.term.column_of(self.load, setting)
        column = _there(block, candidate.where, self)
        weighted = apply_weights(column, self.weights)
        projected = project(self.base, weighted)
        raw, matrix = self.raw.copy(), self.matrix.copy()
        gram, cross = self.gram.copy(), self.cross.copy()
        own = candidate.columns
        # What noise echoes in a column changes little with its setting.
        product = self.matrix[:, own].T.astype(float) @ self.target - self.cross[own]
        square = np.sum(self.matrix[:, own].astype(float) ** 2, axis=0) - np.diag(self.gram)[own]
        raw[:, own], matrix[:, own] = weighted, projected
        gram[own] = projected.T @ matrix
        gram[:, own] = gram[own].T
        gram[own, own] -= np.minimum(square, 0.9 * gram[own, own])
        cross[own] = projected.T @ self.target - product
        candidates = tuple(replace(c, settings=block.settings) if j == i else c for j, c in enumerate(self.candidates))
        return replace(self, candidates=candidates, raw=raw, matrix=matrix, gram=gram, cross=cross)


def apply_weights(columns: Array, weights: Array) -> Array:
    """(3N, k) of (N, 3, k), each row times its weight."""
    return np.asarray((columns * weights[..., None]).reshape(-1, columns.shape[-1]))


def project(base: Base, columns: Array) -> Array:
    """`columns` (3N, k) less what base terms within their priors explain; appended prior rows make it exact.

    With R the augmented matrix [B; diag(1/σ)], the part orthogonal to its range keeps priors in the inner products
    only if the prior rows are kept, too; the columns are 0 there, so their residual rows are kept beside.
    """
    q, n = base.range, len(columns)
    padded = np.concatenate([columns, np.zeros((len(base.names), columns.shape[1]))])
    return np.asarray(padded - q @ (q[:n].T @ columns))


def base_terms(load: LoadEstimate, weights: Array, substituted: NDArray[np.bool_]) -> Base:
    """Timing, zero of the reference, gains of triangles and baselines of boards."""
    seen = load.observation
    names: list[str] = []
    columns: list[Array] = []
    stds: list[float] = []

    def add(name: str, column: Array, std: float) -> None:
        names.append(name)
        columns.append(column)
        stds.append(std)

    slope = seen.reference.slope(seen.reference_s)
    if seen.offset_is_free:
        # The residual is reference(as read) − insole: a clock that is later moves the reference by its slope.
        add("offset_s", -slope, OWN_OFFSET_STD_S)
        if seen.rate_is_free:
            add("rate", -slope * (seen.t_s - seen.t_s.mean())[:, None], OWN_RATE_STD)
    for board, error in seen.interpolation_error.items():
        add(f"unresolved_{board}", error, UNRESOLVED_STD)
    for channel, std in enumerate(ZERO_STD):
        add(f"zero_{channel}", np.broadcast_to(np.eye(3)[channel], slope.shape), std)
    gain = load.wrench_of(-load.slope_pa * load.activation_count)
    offset = load.wrench_of(load.slope_pa)
    for row, (board, triangle) in enumerate(seen.layout.identities.tolist()):
        std = SUBSTITUTED_STD if substituted[row] else GAIN_STD
        add(f"gain_{board}_{triangle}", gain[:, row], std)
    for row, readings in enumerate(seen.readings):
        if seen.is_wholly_substituted is not None and seen.is_wholly_substituted[row]:
            bears = ~seen.is_wholly_substituted & seen.usable.any(axis=1)
            for donor in [each for each in seen.nearest(row).tolist() if bears[each]][:NEIGHBOURS]:
                mean_pa = np.mean(load.read_pa[:, donor, seen.usable[donor]], axis=1)
                add(f"like_{row}_{donor}", mean_pa[:, None] * seen.arms[row].sum(axis=0), SUBSTITUTED_STD)
        if readings.latest_s:
            rate = np.gradient(load.by_triangle[:, row], seen.step_s, axis=0)
            add(f"time_{row}", rate, readings.latest_s / np.sqrt(12.0))
    # What the polynomials of a calibration miss of the curves, the same on all taxels.
    highest = float(np.quantile(seen.activation_count[:, seen.usable], 0.999))
    knots = np.linspace(0.0, max(highest, 1.0), CURVE_KNOTS)
    for k, hat in enumerate(np.eye(CURVE_KNOTS)):
        shape = np.interp(load.activation_count, knots, hat)
        std = CURVE_STD_COUNT if k else CURVE_STD_AT_REST_COUNT
        add(f"curve_{k}", load.wrench_of(load.slope_pa * shape).sum(axis=1), std)
    boards = seen.layout.identities[:, 0]
    for board in np.unique(boards):
        add(f"baseline_{board}", offset[:, boards == board].sum(axis=1), BASELINE_STD_COUNT)
    matrix = apply_weights(np.stack(columns, axis=-1), weights)
    return Base(tuple(names), matrix, np.array(stds))


def place_terms(
    load: LoadEstimate, substituted: NDArray[np.bool_]
) -> Iterator[tuple[PlacedTerm, Array, tuple[Array, Array] | None]]:
    """Every candidate with its columns (N, 3, k) and their echo of noise; the columns' numbers count up."""
    seen = load.observation
    lost = _stood_in(seen, substituted)
    number = 0
    for term in TERMS:
        if term.needs(load) is not None:
            continue
        for block in term.placed_columns(load):
            for where, column, n_places, echo in _placed(term, block, seen):
                every = range(len(block.settings))
                groups = [list(every)] if block.joint else [[k] for k in every]
                for group in groups:
                    place = where if block.places is None else Where("triangle", block.places[group[0]])
                    places = n_places if block.places is None else block.n_searched or len(block.places)
                    if place.scope == "triangle" and lost & set(place.ids):
                        continue
                    if term.word in STATIC and _is_estimated(place, seen):
                        continue
                    ids = np.arange(number, number + len(group))
                    number += len(group)
                    settings = tuple(block.settings[k] for k in group)
                    own = None if echo is None else (echo[0][..., group], echo[1][..., group])
                    none = np.empty(0, np.intp)
                    candidate = PlacedTerm(term, place, settings, ids, places, none, block.is_recalibration)
                    yield candidate, column[..., group], own


def _stood_in(seen: WrenchObservation, substituted: NDArray[np.bool_]) -> set[tuple[int, ...]]:
    """Triangles that others stand in for, and those others: what is wrong there would be told of a neighbour."""
    near = [row for lost in np.flatnonzero(substituted).tolist() for row in seen.nearest(lost)[: 1 + DONORS].tolist()]
    return {tuple(identity) for identity in seen.layout.identities[near].tolist()}


def _is_estimated(place: Where, seen: WrenchObservation) -> bool:
    """Whether nothing is calibrated there: what a static term would differ from is not known."""
    slots = place.slots(seen.layout)
    return seen.is_estimated is not None and bool(seen.is_estimated[np.unique(slots // N_TAXELS)].all())


def _placed(
    term: Term, block: TermColumns, seen: WrenchObservation
) -> Iterator[tuple[Where, Array, int, tuple[Array, Array] | None]]:
    """The places a block is tried at, with its columns (N, 3, k) there and their echo."""

    def of(rows: Sequence[int] | slice) -> tuple[Array, tuple[Array, Array] | None]:
        assert block.by_triangle is not None
        echo = block.echo
        own = None if echo is None else (echo[0][:, rows].sum(axis=1), echo[1][:, rows].sum(axis=1))
        return block.by_triangle[:, rows].sum(axis=1), own

    if block.whole is not None:
        yield Where(), block.whole, 1, block.echo
        return
    assert block.by_triangle is not None
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    for scope in term.scopes:
        if scope == "insole":
            column, echo = of(slice(None))
            yield Where(), column, 1, echo
            continue
        depth = SCOPES.index(scope)
        parts = sorted({identity[:depth] for identity in identities})
        for part in parts:
            rows = [row for row, identity in enumerate(identities) if identity[:depth] == part]
            if seen.usable[rows].any():
                column, echo = of(rows)
                yield Where(scope, (part,)), column, len(parts), echo


def design(load: LoadEstimate, weights: Array, substituted: NDArray[np.bool_]) -> Design:
    """The regression of one recording."""
    seen = load.observation
    base = base_terms(load, weights, substituted)
    every: list[PlacedTerm] = []
    parts: list[NDArray[np.float32]] = []
    product: list[Array] = []
    square: list[Array] = []
    for candidate, columns, echo in place_terms(load, substituted):
        every.append(candidate)
        parts.append(apply_weights(columns, weights).astype(np.float32))
        for i, found in enumerate((product, square)):
            if echo is None:
                found.append(np.zeros(columns.shape[-1]))
            else:
                found.append(np.asarray(np.sum(echo[i] * weights[..., None] ** 2, axis=(0, 1))))
    every = list(with_companions(every))
    raw = np.concatenate(parts, axis=1)
    q = base.range
    n = len(raw)
    coefficients = (q[:n].T.astype(np.float32)) @ raw
    matrix = np.concatenate([raw, np.zeros((len(base.names), raw.shape[1]), np.float32)])
    matrix -= q.astype(np.float32) @ coefficients
    said = seen.reference.at(seen.reference_s) - seen.wrench
    target = project(base, apply_weights(said[..., None], weights))[:, 0]
    gram = (matrix.T @ matrix).astype(np.float64)
    cross = (matrix.T @ target.astype(np.float32)).astype(np.float64) - np.concatenate(product)
    own = np.diag(gram) - np.minimum(np.concatenate(square), 0.9 * np.diag(gram))
    np.fill_diagonal(gram, own)
    return Design(
        load,
        weights,
        base,
        tuple(every),
        raw,
        matrix,
        target,
        gram,
        cross,
        np.concatenate(product),
        float(target @ target),
    )


def _there(block: TermColumns, where: Where, design: Design) -> Array:
    """(N, 3, k) of a block at a place."""
    if block.whole is not None:
        return block.whole
    assert block.by_triangle is not None
    depth = SCOPES.index(where.scope)
    rows = [
        row for row, identity in enumerate(design.load.observation.layout.identities.tolist())
        if depth == 0 or tuple(identity[:depth]) in where.ids
    ]  # fmt: skip
    return np.asarray(block.by_triangle[:, rows].sum(axis=1))
