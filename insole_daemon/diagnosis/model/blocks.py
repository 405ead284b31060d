"""The regression of a recording whose load is known on every taxel: a block for each triangle.

Triangles share the parameters of a term, and nothing else but what is wrong with the reference; so all inner products
are sums over triangles, and a term at any set of triangles costs no more than one at the whole insole. What a
calibration may be off by is each triangle's own, and is projected out of its block:

    minimise Σ_t |y_t − X_t·θ − S_t·s − B_t·b_t|² + Σ (b/σ)² + Σ (s/σ)²   over θ, b and s projected out
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import SCOPES, Array
from ..observations.chamber import ChamberObservation
from ..observations.paired import PairedObservation
from ..observations.wrench import WrenchObservation
from ..terms import TERMS
from ..terms.term import Setting, Term, TermColumns
from .curves import curve_splines
from .load import KnownLoad, LoadEstimate
from .regression import LEAST_SIZE, PlacedTerm, Timing, with_companions
from .solve import RIDGE

GAIN_STD = 0.003  # of a triangle's calibration
BASELINE_STD_COUNT = 0.05  # of a triangle's
ROUNDED_STD_COUNT = 0.3  # of a simulation without noise, whose counts round all one way
REZERO_STD_COUNT = 2.0  # of a shift that a few readings tell
CURVE_STD_COUNT = 0.04  # what the polynomials of a calibration miss
UNEVEN_S, UNSTEADY_S = 8.0, 2.0  # over which a person's load and pace wander from a simulation's
ZERO_STD_PA = 100.0  # of the reference
OWN_OFFSET_STD_S, OWN_RATE_STD = 1e-5, 2e-4  # the offset is searched for, the rate is that of edges
RECALIBRATIONS = ("gain", "baseline", "stiffening")
IN_NO_MODEL = frozenset(each.word for each in TERMS if each.is_internal)
AT_REST = {"baseline": 5.0}  # counts that a memory with a share of 1 leaves of an unloaded reading
LEAST_KEPT = 1e-7  # of a column's square, that nuisances leave: single precision cannot tell less from nothing
FEW = 60  # columns, whose products are summed at once


@dataclass(frozen=True, eq=False)
class Atoms:
    """K columns of terms in T blocks of N rows, and their inner products once the calibration's error is taken out."""

    x: NDArray[np.float32]  # (T, N, K) weighted
    gram: Array  # (T, K, K)
    raw: Array  # (T, K, K) without projection
    shared: Array  # (T, K, s) with the columns of the reference
    product: Array  # (T, K) of the echo of noise
    square: Array  # (T, K)


@dataclass(frozen=True, slots=True)
class Priors:
    """One standard deviation of what is not of the sensor, or was there when it was calibrated.

    A simulated load may differ from the person's in time, and by a share. Curves may be off by counts: those of a
    calibration that a memory was in contain its mean curve.
    """

    timing_s: float = 0.0
    share: float = 0.0
    curve_count: float = CURVE_STD_COUNT

    @property
    def has_loose_curves(self) -> bool:
        """Whether a recalibration could be anything, and none can be identified."""
        return self.curve_count > CURVE_STD_COUNT


USUAL = Priors()


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Columns that are in every model, with their priors."""

    own: Array  # (T, N, b) weighted, each triangle's
    own_std: Array
    shared_names: tuple[str, ...]
    shared: Array  # (T, N, s) weighted, of the reference
    shared_std: Array

    @cached_property
    def inverse(self) -> Array:
        """(T, b, b) of the own columns' inner products with their priors."""
        return np.linalg.inv(np.matmul(self.own.transpose(0, 2, 1), self.own) + np.diag(self.own_std**-2.0))

    @cached_property
    def own_rows(self) -> NDArray[np.float32]:
        """(T, b, N)"""
        return np.ascontiguousarray(self.own.transpose(0, 2, 1).astype(np.float32))

    @cached_property
    def shared_left(self) -> Array:
        """(T, N, s) of the reference's columns, what own columns leave."""
        with_own = np.matmul(self.own.transpose(0, 2, 1), self.shared)
        return np.asarray(self.shared - np.matmul(self.own, np.matmul(self.inverse, with_own)))

    @cached_property
    def shared_inverse(self) -> Array:
        """(s, s) of the reference's columns' inner products with their priors, own columns projected out."""
        own = np.matmul(self.shared.transpose(0, 2, 1), self.shared_left).sum(axis=0)
        return np.asarray(np.linalg.inv(own + np.diag(self.shared_std**-2.0)))

    @cached_property
    def log_determinant(self) -> float:
        """Of the rows' covariance with these columns in it, over that of their noise alone."""
        own = -np.linalg.slogdet(self.inverse)[1].sum() + 2.0 * len(self.own) * np.log(self.own_std).sum()
        shared = -np.linalg.slogdet(self.shared_inverse)[1] + 2.0 * np.log(self.shared_std).sum()
        return float(own + shared)

    def left_of(self, y: Array) -> Array:
        """(T, N) of `y`, what own columns leave."""
        with_own = np.matmul(self.own.transpose(0, 2, 1), y[..., None])
        return np.asarray(y - np.matmul(self.own, np.matmul(self.inverse, with_own))[..., 0])


@dataclass(frozen=True, eq=False)
class BlockDesign:
    """Candidates of one recording, and their inner products with all nuisances projected out."""

    load: LoadEstimate
    weights: Array  # (N, T)
    nuisance: Nuisance
    atoms: Atoms
    candidates: tuple[PlacedTerm, ...]
    atom: NDArray[np.intp]  # (p,) of each column of the candidates
    mask: NDArray[np.bool_]  # (p, T) triangles it is at
    y: Array  # (T, N) weighted residual of the static model
    priors: Priors
    timing: Timing = Timing()  # noqa: RUF009 (frozen)
    moved_s: float = 0.0  # of the timing's delay, that the rows' load is already taken earlier by

    @property
    def seen(self) -> ChamberObservation:
        """Its rows."""
        assert isinstance(self.load.observation, ChamberObservation)
        return self.load.observation

    @property
    def known_load(self) -> KnownLoad:
        """What its columns were made of."""
        assert isinstance(self.load, KnownLoad)
        return self.load

    @cached_property
    def unmoved(self) -> ChamberObservation:
        """Its rows on the clock as it was aligned, under the load as the reference says it."""
        return replace(self.seen.with_clock(self.seen.offset_s + self.moved_s, self.seen.rate), lag_s=0.0)

    @cached_property
    def n_rows(self) -> int:
        """Rows with a weight, of most triangles that have any."""
        rows = np.count_nonzero(self.weights, axis=0)
        return int(np.median(rows[rows > 0]))

    def is_seen(self, candidate: PlacedTerm) -> bool:
        """Whether more than half of it is in the residual of the static model."""
        at = self.mask[candidate.columns[0]]
        column = self.atoms.x[at][:, :, self.atom[candidate.columns[0]]]
        return bool(np.sum(column * self.y[at]) > 0.5 * np.sum(column**2))

    @cached_property
    def least(self) -> Array:
        """(c,) squared sum, in variances of the noise, of the smallest effect worth a name, of each candidate."""
        taxels = self.seen.usable.sum(axis=1).astype(float)
        at = self.mask[[each.columns[0] for each in self.candidates]]
        shown = np.array([each.in_means for each in self.candidates])
        return np.asarray(LEAST_SIZE**2 * self.n_rows * (at @ taxels) * shown)

    @cached_property
    def _with_shared(self) -> Array:
        """(p, s) inner products with the reference's columns."""
        return np.asarray(np.einsum("pt,tps->ps", self.mask.astype(float), self.atoms.shared[:, self.atom]))

    @cached_property
    def _left(self) -> Array:
        """(T, N) of y, what own columns leave."""
        return self.nuisance.left_of(self.y)

    @cached_property
    def _y_with_shared(self) -> Array:
        """(s,) inner products of y with the reference's columns."""
        return np.asarray(np.einsum("tns,tn->s", self.nuisance.shared, self._left))

    @cached_property
    def gram(self) -> Array:
        """(p, p)"""
        found = self._summed(self.atoms.gram)
        c = self._with_shared
        found -= c @ self.nuisance.shared_inverse @ c.T
        square = np.einsum("pt,tp->p", self.mask.astype(float), self.atoms.square[:, self.atom])
        own = np.diag(found) - np.minimum(square, 0.9 * np.diag(found))
        # What nuisances take up whole would be a rounding error, of either sign.
        atoms_square = np.einsum("tkk->tk", self.atoms.raw)
        whole = np.einsum("pt,tp->p", self.mask.astype(float), atoms_square[:, self.atom])
        np.fill_diagonal(found, np.maximum(own, LEAST_KEPT * whole))
        return found

    @cached_property
    def raw_gram(self) -> Array:
        """(p, p) without projection: how large an effect is, whatever else could explain it."""
        return self._summed(self.atoms.raw)

    @cached_property
    def left_of_atoms(self) -> Array:
        """(T, K) inner products of the atoms with what own columns leave of y."""
        left = self._left.astype(np.float32)[:, None]
        return np.asarray(np.matmul(left, self.atoms.x)[:, 0].astype(float) - self.atoms.product)

    @cached_property
    def cross(self) -> Array:
        """(p,)"""
        found = np.einsum("pt,tp->p", self.mask.astype(float), self.left_of_atoms[:, self.atom])
        return np.asarray(found - self._with_shared @ self.nuisance.shared_inverse @ self._y_with_shared)

    @cached_property
    def total(self) -> float:
        """Squared residual of the static model."""
        with_y = self._y_with_shared
        return float(np.sum(self.y * self._left)) - float(with_y @ self.nuisance.shared_inverse @ with_y)

    def size(self, candidate: PlacedTerm, shares: Array) -> float:
        """Squared sum of an effect in variances of the noise, whatever else could explain it, but for loose curves."""
        gram = self.gram if self.priors.has_loose_curves else self.raw_gram
        return float(shares @ gram[np.ix_(candidate.columns, candidate.columns)] @ shares)

    def size_of_loop(self, candidate: PlacedTerm, shares: Array) -> float:
        """Squared sum of what no recalibration within its priors or beside a memory could be."""
        columns = candidate.columns
        beside = zip(candidate.companions.tolist(), candidate.companion_words, strict=True)
        static = np.array([k for k, word in beside if word in RECALIBRATIONS], np.intp)
        found = float(shares @ self.gram[np.ix_(columns, columns)] @ shares)
        if not len(static):
            return found
        both, own = self.gram[np.ix_(static, columns)] @ shares, self.gram[np.ix_(static, static)]
        return found - float(both @ np.linalg.solve(own + np.diag(RIDGE * np.diag(own) + 1e-12), both))

    def overlap(self, candidate: PlacedTerm, other: PlacedTerm, shares: Array) -> float:
        """Squared sum of `other` in the triangles of `candidate`; of what nuisances leave, unless they could be it."""
        both = self.mask[candidate.columns[0]] & self.mask[other.columns[0]]
        own = self._products_of(other, self.is_within_priors(candidate))[both]
        return float(np.einsum("k,tkl,l->", shares, own, shares))

    def overlap_of_both(self, one: PlacedTerm, other: PlacedTerm, shares: Array, other_shares: Array) -> float:
        """Squared sum of two candidates together where both are, of what nuisances leave."""
        both = self.mask[one.columns[0]] & self.mask[other.columns[0]]
        atoms, every = self.atom[[*one.columns, *other.columns]], np.concatenate([shares, other_shares])
        own = self.atoms.gram[both][:, atoms[:, None], atoms].sum(axis=0)
        return float(every @ own @ every)

    @cached_property
    def _products(self) -> dict[tuple[int, int, bool], Array]:
        return {}

    def _products_of(self, candidate: PlacedTerm, raw: bool) -> Array:
        """(T, k, k) of a candidate's atoms, gathered once."""
        atoms = self.atom[candidate.columns]
        key = int(atoms[0]), len(atoms), raw
        if key not in self._products:
            every = self.atoms.raw if raw else self.atoms.gram
            self._products[key] = every[:, atoms][:, :, atoms]
        return self._products[key]

    def is_within_priors(self, candidate: PlacedTerm) -> bool:
        """Static terms: each triangle's calibration may be off by what they are, but for its prior."""
        return candidate.word in (*RECALIBRATIONS, "preload")  # on a straight curve this is a baseline

    def retimed(self, timing: Timing) -> BlockDesign:
        """Against the reference after `timing`."""
        found = replace(self, y=residual(self, timing), timing=timing)
        # Inner products of columns are the same, and most of the time that this takes.
        vars(found).update(gram=self.gram, _with_shared=self._with_shared, _products=self._products)
        return found

    def subset(self, chosen: Sequence[int]) -> BlockDesign:
        """With the columns of `chosen` candidates and their companions alone."""
        picked = [self.candidates[k] for k in chosen]
        every = [np.concatenate([each.columns, each.companions]) for each in picked]
        columns = np.unique(np.concatenate([*every, np.empty(0, np.intp)]))
        place = {int(old): new for new, old in enumerate(columns)}

        def renumbered(old: NDArray[np.intp]) -> NDArray[np.intp]:
            return np.array([place[int(k)] for k in old], np.intp)

        candidates = tuple(
            replace(each, columns=renumbered(each.columns), companions=renumbered(each.companions)) for each in picked
        )
        used, atom = np.unique(self.atom[columns], return_inverse=True)
        return replace(
            self, candidates=candidates, atom=atom, mask=self.mask[columns], atoms=_picked(self.atoms, used)
        )  # fmt: skip

    def exchanged(self, i: int, setting: Setting) -> BlockDesign:
        """With another setting of candidate `i`."""
        candidate = self.candidates[i]
        block = candidate.term.column_of(self.load, setting)
        fresh = make_atoms([block], self.weights, self.nuisance, joined=self.atoms)
        k = self.atoms.x.shape[2]
        atom = self.atom.copy()
        atom[candidate.columns] = k + np.arange(len(candidate.columns))
        candidates = tuple(replace(c, settings=block.settings) if j == i else c for j, c in enumerate(self.candidates))
        used, atom = np.unique(atom, return_inverse=True)
        return replace(self, candidates=candidates, atom=atom, atoms=_picked(fresh, used))

    def of_laws(self) -> BlockDesign:
        """With the laws of its candidates alone, as a model has them.

        Without what they leave out of real materials, and what a load before the recording has left.
        """
        return replace(self, candidates=tuple(each.of_law(IN_NO_MODEL) for each in self.candidates))

    def with_settings(self, found: Sequence[tuple[int, Setting]]) -> BlockDesign:
        """With candidates like those of number `k` with other settings."""
        if not found:
            return self
        blocks, candidates, atom, mask = [], list(self.candidates), [self.atom], [self.mask]
        first, number = self.atoms.x.shape[2], len(self.atom)
        for k, setting in found:
            like = self.candidates[k]
            blocks.append(like.term.column_of(self.load, setting))
            ids = np.arange(len(like.columns))
            candidates.append(replace(like, columns=number + ids, settings=(setting,) * len(ids)))
            atom.append(first + ids)
            mask.append(self.mask[like.columns])
            first, number = first + len(ids), number + len(ids)
        return replace(
            self, candidates=tuple(candidates), atom=np.concatenate(atom), mask=np.concatenate(mask),
            atoms=make_atoms(blocks, self.weights, self.nuisance, joined=self.atoms),
        )  # fmt: skip

    def extended(self, at: Sequence[tuple[int, NDArray[np.bool_]]]) -> BlockDesign:
        """With candidates like those of number `k` at other sets of triangles (T,)."""
        plain = {c.word: k for k, c in reversed(list(enumerate(self.candidates))) if c.where.scope == "insole"}
        wanted = {(k, rows.tobytes()): rows for k, rows in at}
        for k, rows in at:
            wanted |= {(plain[word], rows.tobytes()): rows for word in self.candidates[k].term.absorbs if word in plain}
        candidates, atom, mask = list(self.candidates), [self.atom], [self.mask]
        number = len(self.atom)
        for (k, _), rows in wanted.items():
            like = self.candidates[k]
            ids = number + np.arange(len(like.columns))
            number += len(ids)
            atom.append(self.atom[like.columns])
            mask.append(np.broadcast_to(rows, (len(ids), len(rows))))
            searched = math.comb(len(rows), int(rows.sum()))
            candidates.append(replace(like, where=place_of(rows, self.seen), columns=ids, n_places=searched))
        return replace(
            self, candidates=with_companions(candidates, AT_REST), atom=np.concatenate(atom), mask=np.concatenate(mask)
        )

    def _summed(self, by_triangle: Array) -> Array:
        found = np.zeros((len(self.atom), len(self.atom)))
        if len(self.atom) <= FEW:
            own, at = by_triangle[:, self.atom[:, None], self.atom], self.mask.T.astype(float)
            return np.asarray(np.sum(own * at[:, :, None] * at[:, None, :], axis=0))
        for t, block in enumerate(by_triangle):
            here = np.flatnonzero(self.mask[:, t])
            found[np.ix_(here, here)] += block[np.ix_(self.atom[here], self.atom[here])]
        return found


def residual(design: BlockDesign, timing: Timing) -> Array:
    """(T, N) weighted: the reference's pressure after `timing`, less that of the static curves."""
    seen = design.seen
    said = seen.reference.at(seen.reference_s - (timing.delay_s - design.moved_s), timing.lag_s)
    return np.ascontiguousarray(((said - seen.wrench) * design.weights).T)


def block_design(load: LoadEstimate, weights: Array, priors: Priors = USUAL) -> BlockDesign:
    """The regression of one recording, with candidates at the insole, every board and every triangle.

    `weights` (N, T): one over the standard deviation of a row; 0: unknown.
    """
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    nuisance = _nuisance(load, weights, priors)
    excluded = RECALIBRATIONS if priors.has_loose_curves else ()
    terms = [each for each in TERMS if each.needs(load) is None and each.word not in excluded]
    blocks = [(term, block) for term in terms for block in term.placed_columns(load)]
    atoms = make_atoms([block for _, block in blocks], weights, nuisance)
    placed, atom, mask = _placed(blocks, seen)
    candidates = with_companions(placed, AT_REST)
    nothing = np.zeros((weights.shape[1], weights.shape[0]))
    found = BlockDesign(load, weights, nuisance, atoms, candidates, atom, mask, nothing, priors)
    return replace(found, y=residual(found, Timing()))


def _nuisance(load: LoadEstimate, weights: Array, priors: Priors) -> Nuisance:
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    n, n_triangles = weights.shape
    # Beside a gain of the load, loose curves could say that nothing is read: they are functions of readings alone.
    is_loose = priors.has_loose_curves
    slope_pa = seen.slope_pa if is_loose else load.slope_pa
    slope = load.wrench_of(slope_pa)[..., 0]
    gain = load.wrench_of(-slope_pa * (load.activation_count if is_loose else load.gained_count))[..., 0]
    splines = curve_splines(load.activation_count, seen.usable)
    curves = [load.wrench_of(slope_pa * each)[..., 0] for each in splines.at(load.activation_count)]
    rest_std = ROUNDED_STD_COUNT if isinstance(seen, PairedObservation) else BASELINE_STD_COUNT
    parts, stds = [gain, slope, *curves], [GAIN_STD, rest_std, *[priors.curve_count] * len(curves)]
    if seen.rezeroed is not None:
        parts, stds = [*parts, slope * seen.rezeroed], [*stds, REZERO_STD_COUNT]
    edge = seen.reference.slope(seen.reference_s)  # (N, 1)
    names, columns, shared_std = ["zero"], [np.ones((n, 1))], [ZERO_STD_PA]
    if seen.offset_is_free:
        names += ["offset_s", "rate"]
        columns += [-edge, -edge * (seen.t_s - seen.t_s.mean())[:, None]]
        shared_std += [OWN_OFFSET_STD_S, OWN_RATE_STD]
    if priors.share:
        parts, stds = [*parts, gain, *_over_time(seen, gain, UNEVEN_S)], [*stds, priors.share]
        stds += [priors.share] * (len(parts) - len(stds))
    if priors.timing_s:
        late = _over_time(seen, -edge, UNSTEADY_S)
        names += ["late"] * len(late)
        columns += late
        shared_std += [priors.timing_s] * len(late)
    own = np.stack(parts, axis=-1) * weights[..., None]
    shared = np.stack([np.broadcast_to(each, (n, n_triangles)) * weights for each in columns], axis=-1)
    return Nuisance(
        np.ascontiguousarray(own.transpose(1, 0, 2)), np.array(stds), tuple(names),
        np.ascontiguousarray(shared.transpose(1, 0, 2)), np.array(shared_std),
    )  # fmt: skip


def _over_time(seen: ChamberObservation, column: Array, over_s: float) -> list[Array]:
    """`column` times hats over time, `over_s` apart; none of them moves all times alike."""
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], max(round(float(np.ptp(seen.t_s)) / over_s), 1) + 1)
    hats = [np.interp(seen.t_s, knots_s, hat) for hat in np.eye(len(knots_s))]
    return [column * (hat - hat.mean())[:, None] for hat in hats]


def make_atoms(blocks: Sequence[TermColumns], weights: Array, nuisance: Nuisance, joined: Atoms | None = None) -> Atoms:
    """Columns of `blocks`, beside those of `joined`."""
    n, n_triangles = weights.shape
    parts: list[NDArray[np.float32]] = []
    products: list[Array] = []
    squares: list[Array] = []
    for block in blocks:
        if block.by_triangle is not None:
            values = block.by_triangle[:, :, 0]
        else:
            assert block.whole is not None
            values = np.broadcast_to(block.whole, (n, n_triangles, block.whole.shape[-1]))
        parts.append((values * weights[..., None]).astype(np.float32).transpose(1, 0, 2))
        for i, found in enumerate((products, squares)):
            if block.echo is None:
                found.append(np.zeros((n_triangles, values.shape[-1])))
                continue
            echo = block.echo[i][:, :, 0] if block.by_triangle is not None else block.echo[i]
            found.append(np.einsum("ntk,nt->tk", np.broadcast_to(echo, values.shape), weights**2))
    new = np.concatenate(parts, axis=2)
    own = np.matmul(nuisance.own_rows, new).astype(float)
    through = np.matmul(nuisance.inverse, own)
    raw = np.matmul(new.transpose(0, 2, 1), new).astype(float)
    gram = raw - np.matmul(own.transpose(0, 2, 1), through)
    shared = np.matmul(new.transpose(0, 2, 1), nuisance.shared_left.astype(np.float32)).astype(float)
    product, square = np.concatenate(products, axis=1), np.concatenate(squares, axis=1)
    if joined is None:
        return Atoms(new, gram, raw, shared, product, square)
    # Inner products of the columns that were there are kept: only those with the new ones are computed.
    beside = np.matmul(joined.x.transpose(0, 2, 1), new).astype(float)
    projected = beside - np.matmul(np.matmul(nuisance.own_rows, joined.x).astype(float).transpose(0, 2, 1), through)
    return Atoms(
        np.concatenate([joined.x, new], axis=2), _bordered(joined.gram, projected, gram),
        _bordered(joined.raw, beside, raw), np.concatenate([joined.shared, shared], axis=1),
        np.concatenate([joined.product, product], axis=1), np.concatenate([joined.square, square], axis=1),
    )  # fmt: skip


def _bordered(first: Array, beside: Array, last: Array) -> Array:
    """(T, K + k, K + k) symmetric, of its blocks (T, K, K), (T, K, k) and (T, k, k)."""
    return np.concatenate(
        [np.concatenate([first, beside], axis=2), np.concatenate([beside.transpose(0, 2, 1), last], axis=2)], axis=1
    )


def _picked(atoms: Atoms, used: NDArray[np.intp]) -> Atoms:
    return Atoms(
        np.ascontiguousarray(atoms.x[:, :, used]), atoms.gram[:, used][:, :, used], atoms.raw[:, used][:, :, used],
        atoms.shared[:, used], atoms.product[:, used], atoms.square[:, used],
    )  # fmt: skip


def _placed(
    blocks: Sequence[tuple[Term, TermColumns]], seen: ChamberObservation
) -> tuple[list[PlacedTerm], NDArray[np.intp], NDArray[np.bool_]]:
    """Candidates with the atom and the triangles of each of their columns."""
    candidates: list[PlacedTerm] = []
    atom: list[int] = []
    mask: list[NDArray[np.bool_]] = []
    first = 0
    for term, block in blocks:
        k = len(block.settings)
        groups = [list(range(k))] if block.joint else [[j] for j in range(k)]
        for where, rows, n_places in _places(term, block, seen):
            for group in groups:
                if block.places is not None:
                    where, rows = _of_column(block, group[0], seen)
                    n_places = block.n_searched
                ids = len(atom) + np.arange(len(group))
                atom += [first + j for j in group]
                mask += [rows] * len(group)
                settings = tuple(block.settings[j] for j in group)
                candidates.append(PlacedTerm(
                    term, where, settings, ids, n_places, np.empty(0, np.intp), in_means=block.in_means
                ))  # fmt: skip
        first += k
    return candidates, np.array(atom, np.intp), np.array(mask)


def _places(term: Term, block: TermColumns, seen: ChamberObservation) -> Iterator[tuple[Where, NDArray[np.bool_], int]]:
    if block.places is not None:  # columns say it themselves
        yield Where(), np.empty(0, np.bool_), block.n_searched
        return
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    works = seen.usable.any(axis=1)
    scopes = ("insole",) if block.whole is not None else (*term.chamber_scopes, *term.scopes)
    for scope in scopes:
        if (term.word, scope) in seen.settled:
            continue
        depth = SCOPES.index(scope)
        parts = sorted({identity[:depth] for identity in identities})
        for part in parts:
            rows = np.array([identity[:depth] == part for identity in identities]) & works
            if rows.any():
                yield (Where(scope, (part,)) if depth else Where()), rows, len(parts)


def _of_column(block: TermColumns, k: int, seen: ChamberObservation) -> tuple[Where, NDArray[np.bool_]]:
    """Where column `k` is, that says it itself."""
    assert block.places is not None
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    return Where("triangle", block.places[k]), np.array([each in block.places[k] for each in identities])


def place_of(rows: NDArray[np.bool_], seen: WrenchObservation) -> Where:
    """The coarsest place that is the triangles `rows` (T,)."""
    works = seen.usable.any(axis=1)
    if np.array_equal(rows & works, works):
        return Where()
    identities = seen.layout.identities
    boards = np.unique(identities[rows, 0])
    of_boards = np.isin(identities[:, 0], boards) & works
    if np.array_equal(rows & works, of_boards):
        return Where("board", tuple((int(board),) for board in boards))
    return Where("triangle", tuple((int(b), int(t)) for b, t in identities[rows].tolist()))
