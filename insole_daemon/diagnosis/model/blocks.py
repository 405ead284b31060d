"""The regression of a recording whose load is known on every taxel: a block for each triangle.

Triangles have in common only the shares θ of the terms and the errors s of the reference, so all inner products are
sums over triangles, and a term at any set of triangles costs no more than one at the whole insole. The errors b_t of a
triangle's calibration are its own and are projected out of its block t:

    minimise Σ_t |y_t − X_t·θ − S_t·s − B_t·b_t|² + Σ (b/σ)² + Σ (s/σ)²   over θ, b and s projected out
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..caches import forget_cached
from ..load_estimate import KnownLoad, LoadEstimate
from ..observations.chamber import ChamberObservation
from ..observations.wrench import CLOCK_INDEPENDENT
from ..terms import TERMS
from ..terms.term import LEAST_SIZE, Setting, TermColumns
from .atoms import Atoms, Rows, make_atoms, projected
from .gram import GramMatrix, PlacedColumns
from .nuisance import USUAL, Nuisance, Priors, nuisance_of
from .placement import Placement, place_of
from .regression import Gram, PlacedTerm, Timing, with_companions
from .solve import solve_companions, with_ridge

RECALIBRATIONS = ("gain", "baseline", "stiffening")
IN_NO_MODEL = frozenset(term.word for term in TERMS if term.is_internal)
AT_REST = {"baseline": 5.0}  # companion of every memory: prior standard deviation in counts, per share of the memory
LEAST_KEPT = 1e-7  # smallest part of a column's square after projection; single precision resolves no less
LEAST_SLOPE_PA = 1.0  # per count, of a curve
FEW = 100  # largest number of columns whose Gram matrix is computed at once


@dataclass(frozen=True, eq=False)
class BlockDesign:
    """Candidates of one recording, and their inner products with all nuisances projected out."""

    load: LoadEstimate
    weights: Array  # (N, T)
    nuisance: Nuisance
    atoms: Atoms
    candidates: tuple[PlacedTerm, ...]
    atom: NDArray[np.intp]  # (p,) number of the atom of each column of the candidates
    mask: NDArray[np.bool_]  # (p, T) triangles at which the column is not 0
    y: Array  # (T, N) weighted residual of the static model
    priors: Priors
    timing: Timing = Timing()  # noqa: RUF009 (frozen)
    moved_s: float = 0.0  # part of the timing's delay by which the load of the rows is already shifted
    amplitudes: Array | None = None  # (T,) of effects of the material, relative to those of their laws; None: 1

    @property
    def seen(self) -> ChamberObservation:
        """Return the rows."""
        assert isinstance(self.load.observation, ChamberObservation)
        return self.load.observation

    @property
    def known_load(self) -> KnownLoad:
        """Return the load from which the columns were computed."""
        assert isinstance(self.load, KnownLoad)
        return self.load

    @cached_property
    def unmoved(self) -> ChamberObservation:
        """Return the rows on the clock of the alignment, under the load of the reference without a lag."""
        return self.seen.timed(offset_s=self.seen.offset_s + self.moved_s, lag_s=0.0)

    @property
    def log_determinant(self) -> float:
        """Return the log determinant of the rows' covariance, less that of noise."""
        of_switching = 0.0
        if self.seen.switching_pa is not None:
            of_switching = -float(np.log1p(-((self.seen.switching_pa * self.weights) ** 2)).sum())
        return self.nuisance.log_determinant + of_switching

    @cached_property
    def n_rows(self) -> int:
        """Return the number of rows with a weight, the median of the triangles that have any."""
        rows = np.count_nonzero(self.weights, axis=0)
        return int(np.median(rows[rows > 0]))

    @cached_property
    def noise(self) -> float:
        """Return the expected sum of squares of y by noise alone, in variances of the noise."""
        return float(np.count_nonzero(self.weights))

    @property
    def undone(self) -> float:
        """Return 0: under a known load, no memory was undone."""
        return 0.0

    def is_seen(self, candidate: PlacedTerm) -> bool:
        """Return whether y contains more than half of a candidate's first column, for a share of 1."""
        at = self.mask[candidate.columns[0]]
        column = self.atoms.columns(self.atom[candidate.columns[:1]])[at, 0]
        return bool(np.sum(column * self.y[at]) > 0.5 * np.sum(column**2))

    def rows_of(self, columns: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the weighted rows (T, k, N) of `columns` (k,); 0 outside their triangles."""
        rows = self.atoms.columns(self.atom[columns])
        rows *= self.mask[columns].T[..., None]
        return rows

    def contribution(self, candidate: PlacedTerm, shares: Array) -> Array:
        """Return the weighted rows (T, N) of a candidate's effect with `shares`."""
        return np.stack([shares @ rows for rows in self.rows_of(candidate.columns)])

    @cached_property
    def least(self) -> Array:
        """Return the gain (c,) of the smallest effect that each candidate may report, in variances of the noise."""
        taxels = self.seen.usable.sum(axis=1).astype(float)
        at = self.mask[[candidate.columns[0] for candidate in self.candidates]]
        in_means = np.array([candidate.in_means for candidate in self.candidates])
        return np.asarray(LEAST_SIZE**2 * self.n_rows * (at @ taxels) * in_means)

    @cached_property
    def _columns(self) -> PlacedColumns:
        return PlacedColumns(self.atom, self.mask)

    @cached_property
    def _with_shared(self) -> Array:
        """Return the inner products (p, s) with the shared nuisance columns."""
        return self._columns.summed(self.atoms.shared)

    @cached_property
    def _y_residual(self) -> Array:
        """Return y (T, N) after regression on the own nuisance columns of each triangle."""
        return self.nuisance.residual_of(self.y)

    @cached_property
    def _y_with_shared(self) -> Array:
        """Return the inner products (s,) of y with the shared nuisance columns."""
        return self.nuisance.summed_with_shared(self._y_residual)

    @cached_property
    def gram(self) -> Gram:
        """Return the inner products (p, p) of the columns, nuisance columns projected out."""
        atoms, columns = self.atoms, self._columns
        if len(self.atom) <= FEW:
            gram = self._summed(atoms.gram) - self._with_shared @ self.nuisance.shared_inverse @ self._with_shared.T
            np.fill_diagonal(gram, self._squares(np.diag(gram)))
            return gram
        projected = columns.summed(np.einsum("tkk->tk", atoms.gram))
        taken_up = np.einsum("ps,ps->p", self._with_shared @ self.nuisance.shared_inverse, self._with_shared)
        return GramMatrix(
            columns, atoms.gram, self._with_shared, self.nuisance.shared_inverse, self._squares(projected - taken_up)
        )

    def _squares(self, projected: Array) -> Array:
        """Return the squares (p,) of the columns without their noise echo, from those after the projection."""
        without_echo = projected - np.minimum(self._columns.summed(self.atoms.square), 0.9 * projected)
        # The square of a column that nuisance columns explain fully is a rounding error, of either sign.
        taken_up = np.einsum("tbk,tbk->tk", self.atoms.with_own, np.matmul(self.nuisance.inverse, self.atoms.with_own))
        raw = np.einsum("tkk->tk", self.atoms.gram) + taken_up
        return np.maximum(without_echo, LEAST_KEPT * self._columns.summed(raw))

    @cached_property
    def atom_cross(self) -> Array:
        """Return the inner products (T, K) of the atoms with y, own nuisance columns projected out."""
        return self.atoms.products_with(self._y_residual) - self.atoms.product

    def residual_cross(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> Array:
        """Return inner products (T, K) of all atoms with the residual of `terms`, nuisance columns projected out."""
        cross = self.atom_cross.copy()
        with_shared = self._y_with_shared.copy()
        for term, own in zip(terms, shares, strict=True):
            for column, share in zip(term.columns, own, strict=True):
                cross -= self.atoms.gram[:, self.atom[column]] * (share * self.mask[column])[:, None]
                with_shared -= share * self._with_shared[column]
        return np.asarray(cross - self.atoms.shared @ (self.nuisance.shared_inverse @ with_shared))

    @cached_property
    def cross(self) -> Array:
        """Return the inner products (p,) of the columns with y, nuisance columns projected out."""
        products = self._columns.summed(self.atom_cross)
        return np.asarray(products - self._with_shared @ self.nuisance.shared_inverse @ self._y_with_shared)

    @cached_property
    def total(self) -> float:
        """Return the sum of squares of y, nuisance columns projected out."""
        with_y = self._y_with_shared
        return float(np.sum(self.y * self._y_residual)) - float(with_y @ self.nuisance.shared_inverse @ with_y)

    def size(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the sum of squares of an effect, in variances of the noise; with loose curves, of what they leave."""
        if self.priors.has_loose_curves:
            return float(shares @ self.gram[candidate.columns[:, None], candidate.columns] @ shares)
        return float(shares @ self._products_of([candidate], True) @ shares)

    def mismatch(self, candidate: PlacedTerm) -> float:
        """Return the sum of squares of y in the triangles of a candidate, in variances of the noise."""
        return float(np.sum(self.y[self.mask[candidate.columns[0]]] ** 2))

    def size_of_loop(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the sum of squares of an effect after regression on its static companions."""
        columns = candidate.columns
        companions = zip(candidate.companions.tolist(), candidate.companion_words, strict=True)
        static = np.array([k for k, word in companions if word in RECALIBRATIONS], np.intp)
        square = float(shares @ self.gram[columns[:, None], columns] @ shares)
        if not len(static):
            return square
        cross, gram = self.gram[static[:, None], columns] @ shares, self.gram[static[:, None], static]
        return square - float(cross @ np.linalg.solve(with_ridge(gram), cross))

    def overlap(self, candidate: PlacedTerm, other: PlacedTerm, shares: Array) -> float:
        """Return the sum of squares of `other`, with its `shares`, in the triangles of `candidate`.

        Nuisance columns are projected out, unless `candidate` itself differs from them only by its priors.
        """
        products = self._products_of([candidate, other], self.is_within_priors(candidate))
        own = products[len(candidate.columns) :, len(candidate.columns) :]
        return float(shares @ own @ shares)

    def products_of_two(
        self, one: PlacedTerm, other: PlacedTerm, shares: Array, other_shares: Array, raw: bool
    ) -> Array:
        """Return the inner products (2, 2) of two effects in common triangles.

        Unless `raw`, own nuisance columns are projected out.
        """
        k, products = len(shares), self._products_of([one, other], raw)
        between = float(shares @ products[:k, k:] @ other_shares)
        squares = float(shares @ products[:k, :k] @ shares), float(other_shares @ products[k:, k:] @ other_shares)
        return np.array([[squares[0], between], [between, squares[1]]])

    def _products_of(self, candidates: Sequence[PlacedTerm], raw: bool) -> Array:
        """Return the inner products (k, k) of the columns of `candidates`, summed over their common triangles.

        Unless `raw`, own nuisance columns are projected out.
        """
        key = (*[candidate.columns.item(0) for candidate in candidates], raw)
        if key not in self._products:
            triangles = np.flatnonzero(self.mask[list(key[:-1])].all(axis=0))
            atoms = self.atom[np.concatenate([candidate.columns for candidate in candidates])]
            products = self.atoms.gram[triangles[:, None, None], atoms[:, None], atoms].sum(axis=0, dtype=float)
            if raw:
                own = self.atoms.with_own[triangles[:, None], :, atoms].transpose(0, 2, 1)
                products += np.einsum("tbj,tbc,tck->jk", own, self.nuisance.inverse[triangles], own, optimize=True)
            self._products[key] = products
        return self._products[key]

    @cached_property
    def _products(self) -> dict[tuple[int, ...], Array]:
        return {}

    def is_within_priors(self, candidate: PlacedTerm) -> bool:
        """Return whether a candidate is a static term, which differs from nuisance columns only by its priors."""
        return candidate.word in (*RECALIBRATIONS, "preload")  # on a straight curve this is a baseline

    def retimed(self, timing: Timing) -> BlockDesign:
        """Return the regression on the reference after `timing`."""
        retimed = replace(self, y=residual(self, timing), timing=timing)
        # The inner products of columns stay the same, and take most of the time to compute.
        vars(retimed).update(
            gram=self.gram, _columns=self._columns, _with_shared=self._with_shared, _products=self._products
        )
        return retimed

    def _changed(self, atoms: Atoms, kept: NDArray[np.intp] | slice, **changes: Any) -> BlockDesign:
        """Return a regression on the same rows with other `atoms`: those `kept` of this one, then new ones."""
        changed = replace(self, atoms=atoms, **changes)
        vars(changed).update(_y_residual=self._y_residual, _y_with_shared=self._y_with_shared, total=self.total)
        if "atom_cross" in vars(self):
            known = self.atom_cross[:, kept]
            new = atoms.products_with(self._y_residual, known.shape[1]) - atoms.product[:, known.shape[1] :]
            vars(changed).update(atom_cross=np.concatenate([known, new], axis=1))
        return changed

    def with_amplitudes(self, amplitudes: Array | None) -> BlockDesign:
        """Return the regression with these amplitudes (T,) of all effects of the material; None: 1."""
        change = (1.0 if amplitudes is None else amplitudes) / (1.0 if self.amplitudes is None else self.amplitudes)
        factors = np.ones(self.atoms.product.shape)
        for candidate in self.candidates:
            if candidate.term.is_of_material:
                factors[:, self.atom[candidate.columns]] = np.reshape(change, (-1, 1))
        changed = replace(self, atoms=self.atoms.scaled(factors), amplitudes=amplitudes)
        vars(changed).update(
            _columns=self._columns, _y_residual=self._y_residual, _y_with_shared=self._y_with_shared, total=self.total
        )
        return changed

    def unexplained(self, seen: ChamberObservation) -> float:
        """Return the sum of squares of the rows `seen`, other curves of the same readings, without any term."""
        load = KnownLoad(seen)
        empty = replace(self.subset(()), load=load, nuisance=nuisance_of(load, self.weights, self.priors))
        return replace(empty, y=residual(empty, Timing())).total

    def under(self, priors: Priors) -> BlockDesign:
        """Return the regression with the same candidates under other `priors`."""
        if priors == self.priors:
            return self
        nuisance = nuisance_of(self.load, self.weights, priors)
        return replace(self, nuisance=nuisance, atoms=projected(self.atoms, self.nuisance, nuisance), priors=priors)

    def forget_load(self) -> None:
        """Delete the cached arrays of the load, to free memory; they are computed again on demand."""
        forget_cached(self.load)
        forget_cached(self.seen, kept=CLOCK_INDEPENDENT)
        forget_cached(self, kept=vars(self).keys() - {"unmoved", "_products"})

    def subset(self, chosen: Sequence[int]) -> BlockDesign:
        """Return the regression with the columns of `chosen` candidates and their companions."""
        picked = [self.candidates[k] for k in chosen]
        numbers = [np.concatenate([candidate.columns, candidate.companions]) for candidate in picked]
        columns = np.unique(np.concatenate([*numbers, np.empty(0, np.intp)]))
        place = {int(old): new for new, old in enumerate(columns)}

        def renumbered(old: NDArray[np.intp]) -> NDArray[np.intp]:
            return np.array([place[int(k)] for k in old], np.intp)

        candidates = tuple(
            replace(candidate, columns=renumbered(candidate.columns), companions=renumbered(candidate.companions))
            for candidate in picked
        )
        used, atom = np.unique(self.atom[columns], return_inverse=True)
        return self._changed(
            self.atoms.picked(used), used, candidates=candidates, atom=atom, mask=self.mask[columns]
        )  # fmt: skip

    def exchanged(self, i: int, setting: Setting) -> BlockDesign:
        """Return the regression with another setting of candidate `i`, whose columns are 0 outside its place."""
        return self._exchanged(i, setting, np.asarray(self.mask[self.candidates[i].columns].any(axis=0)))

    def relinearised(self, i: int, setting: Setting, shares: Sequence[Array]) -> BlockDesign:
        """Return the regression with candidate `i` linearised at `setting`, about readings that `shares` predict."""
        at = np.asarray(self.mask[self.candidates[i].columns].any(axis=0))
        return self._exchanged(i, setting, at, self._predicted_load(shares))

    def everywhere(self, i: int, shares: Sequence[Array]) -> BlockDesign:
        """Return the regression with the columns of candidate `i` in all triangles, also if it was exchanged.

        A linearised column is computed from the readings that `shares` predict.
        """
        candidate = self.candidates[i]
        if candidate.term.column is None:
            return self
        load = self._predicted_load(shares) if candidate.term.linear_at else None
        return self._exchanged(i, candidate.settings[0], None, load)

    def _predicted_load(self, shares: Sequence[Array]) -> KnownLoad:
        """Return the load with readings that `shares` of the candidates predict in the mean of each triangle.

        The noise of that mean is a part of the residual: it would distinguish a column from that of a nuisance, and
        decide its share.
        """
        rest = self.y - sum(self.contribution(one, own) for one, own in zip(self.candidates, shares, strict=True))
        columns, coefficients = solve_companions(self, self.candidates, shares)
        rest -= np.stack([coefficients @ rows for rows in self.rows_of(columns)])
        residual = self.nuisance.residual_of(rest).T
        above_pa = np.divide(residual, self.weights, out=np.zeros_like(residual), where=self.weights > 0.0)
        steepness = np.maximum(self.known_load.slope_pa, LEAST_SLOPE_PA)
        return replace(self.known_load, predicted_count=self.seen.activation_count + above_pa[:, :, None] / steepness)

    def _exchanged(
        self, i: int, setting: Setting, at: NDArray[np.bool_] | None, load: KnownLoad | None = None
    ) -> BlockDesign:
        """Return the regression with another setting of candidate `i`; its columns are 0 but for the triangles `at`.

        `load`: from which the columns are computed, if it is another one.
        """
        candidate = self.candidates[i]
        block = candidate.term.column_of(load or self.load, setting)
        others, rest = self._beside(i)
        atom = np.empty_like(self.atom)
        atom[candidate.columns] = len(others) + np.arange(len(candidate.columns))
        kept = np.setdiff1d(np.arange(len(atom)), candidate.columns)
        atom[kept] = np.searchsorted(others, self.atom[kept])
        candidates = tuple(replace(c, settings=block.settings) if j == i else c for j, c in enumerate(self.candidates))
        atoms = make_atoms([block], self.weights, self.nuisance, rest, at)
        return self._changed(atoms, others, candidates=candidates, atom=atom)

    def _beside(self, i: int) -> tuple[NDArray[np.intp], Atoms]:
        """Return the numbers of the atoms of all columns but those of candidate `i`, and these atoms."""
        if i not in self._rests:
            others = np.unique(np.delete(self.atom, self.candidates[i].columns))
            self._rests[i] = others, self.atoms.picked(others)
        return self._rests[i]

    @cached_property
    def _rests(self) -> dict[int, tuple[NDArray[np.intp], Atoms]]:
        return {}

    def of_laws(self) -> BlockDesign:
        """Return the regression with the laws alone, as the exported model has them.

        It has no columns or companions for the misfit of laws and for loads before the recording, and the same
        amplitudes in all triangles.
        """
        alike = self if self.amplitudes is None else self.with_amplitudes(None)
        candidates = tuple(candidate.of_law().without(IN_NO_MODEL) for candidate in alike.candidates)
        return alike._changed(alike.atoms, slice(None), candidates=candidates)

    def with_wider_laws(self) -> None:
        """Return None: under a known load, the search has all columns of laws."""

    def without_companions(self, words: Collection[str]) -> BlockDesign:
        """Return the regression whose candidates have no companions of these `words`."""
        candidates = tuple(candidate.without(words) for candidate in self.candidates)
        return self._changed(self.atoms, slice(None), candidates=candidates)

    def without_internal_companions(self) -> BlockDesign:
        """Return the regression with all columns of its candidates, without companions that are in no model."""
        return self.without_companions(IN_NO_MODEL)

    def with_settings(self, settings: Sequence[tuple[int, Setting]]) -> BlockDesign:
        """Return the regression with further candidates: for each (k, setting), candidate k with that setting."""
        if not settings:
            return self
        blocks, candidates, atom, mask = [], list(self.candidates), [self.atom], [self.mask]
        first, number = self.atoms.product.shape[1], len(self.atom)
        for k, setting in settings:
            like = self.candidates[k]
            blocks.append(like.term.column_of(self.load, setting))
            ids = np.arange(len(like.columns))
            candidates.append(replace(like, columns=number + ids, settings=(setting,) * len(ids)))
            atom.append(first + ids)
            mask.append(self.mask[like.columns])
            first, number = first + len(ids), number + len(ids)
        return self._changed(
            make_atoms(blocks, self.weights, self.nuisance, joined=self.atoms), slice(None),
            candidates=tuple(candidates), atom=np.concatenate(atom), mask=np.concatenate(mask),
        )  # fmt: skip

    def extended(self, at: Sequence[tuple[int, NDArray[np.bool_]]]) -> BlockDesign:
        """Return the regression with further candidates: for each (k, triangles (T,)), candidate k at these."""
        on_insole = {c.word: k for k, c in reversed(list(enumerate(self.candidates))) if c.where.scope == "insole"}
        wanted = {(k, rows.tobytes()): rows for k, rows in at}
        for k, rows in at:
            absorbed = (on_insole[word] for word in self.candidates[k].term.absorbs if word in on_insole)
            wanted |= {(companion, rows.tobytes()): rows for companion in absorbed}
        candidates, atom, mask = list(self.candidates), [self.atom], [self.mask]
        number = len(self.atom)
        for (k, _), rows in wanted.items():
            like = self.candidates[k]
            ids = number + np.arange(len(like.columns))
            number += len(ids)
            atom.append(self.atom[like.columns])
            mask.append(np.broadcast_to(rows, (len(ids), len(rows))))
            n_places = math.comb(len(rows), int(rows.sum()))
            candidates.append(replace(like, where=place_of(rows, self.seen), columns=ids, n_places=n_places))
        return self._changed(
            self.atoms, slice(None),
            candidates=with_companions(candidates, AT_REST), atom=np.concatenate(atom), mask=np.concatenate(mask),
        )  # fmt: skip

    def _summed(self, by_triangle: Rows) -> Array:
        """Return the sums (p, p) of values (T, K, K) of the atoms over the common triangles of two columns."""
        of_columns, at = by_triangle[:, self.atom[:, None], self.atom], self.mask.T.astype(float)
        return np.asarray(np.sum(of_columns * at[:, :, None] * at[:, None, :], axis=0))


def residual(design: BlockDesign, timing: Timing) -> Array:
    """Return the weighted residual (T, N): pressure of the reference after `timing` minus that of the static curves."""
    seen = design.seen
    reference_pa = seen.reference.at(seen.reference_s - (timing.delay_s - design.moved_s), timing.lag_s)
    return np.ascontiguousarray(((reference_pa - seen.wrench) * design.weights).T)


def block_design(load: KnownLoad, weights: Array, priors: Priors = USUAL) -> BlockDesign:
    """Return the regression of one recording, with candidates at the insole, every board and every triangle.

    `weights` (N, T): one over the standard deviation of a row; 0 if unknown.
    """
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    nuisance = nuisance_of(load, weights, priors)
    excluded = RECALIBRATIONS if priors.has_loose_curves else ()
    terms = [term for term in TERMS if term.needs(load) is None and term.word not in excluded]
    if priors.has_wide_bounds:
        terms = [term.with_wide_bound() for term in terms]
    last_at = {term.order: term for term in terms}  # of those at one place of the signal path
    placement = Placement(seen)

    def blocks() -> Iterator[TermColumns]:
        for term in terms:
            for block in term.placed_columns(load):
                placement.add(term, block)
                yield block
            if last_at[term.order] is term:
                load.forget_before(term.order)

    atoms = make_atoms(blocks(), weights, nuisance)
    candidates = with_companions(placement.candidates, AT_REST)
    zero = np.zeros((weights.shape[1], weights.shape[0]))
    design = BlockDesign(load, weights, nuisance, atoms, candidates, placement.atom, placement.mask, zero, priors)
    return replace(design, y=residual(design, Timing()))
