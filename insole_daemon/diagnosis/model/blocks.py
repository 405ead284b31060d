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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..load_estimate import KnownLoad, LoadEstimate
from ..observations.chamber import ChamberObservation
from ..terms import TERMS
from ..terms.term import LEAST_SIZE, Setting, TermColumns
from .atoms import Atoms, make_atoms, projected
from .gram import GramMatrix, PlacedColumns
from .nuisance import USUAL, Nuisance, Priors, nuisance_of
from .placement import Placement, place_of
from .regression import Gram, PlacedTerm, Timing, with_companions
from .solve import RIDGE

RECALIBRATIONS = ("gain", "baseline", "stiffening")
IN_NO_MODEL = frozenset(each.word for each in TERMS if each.is_internal)
AT_REST = {"baseline": 5.0}  # counts that a memory with a share of 1 leaves of an unloaded reading
LEAST_KEPT = 1e-7  # of a column's square, that nuisances leave: single precision cannot tell less from nothing
FEW = 100  # columns, all of whose inner products are kept


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
        return self.seen.timed(offset_s=self.seen.offset_s + self.moved_s, lag_s=0.0)

    @cached_property
    def n_rows(self) -> int:
        """Rows with a weight, of most triangles that have any."""
        rows = np.count_nonzero(self.weights, axis=0)
        return int(np.median(rows[rows > 0]))

    def is_seen(self, candidate: PlacedTerm) -> bool:
        """Whether more than half of it is in the residual of the static model."""
        at = self.mask[candidate.columns[0]]
        column = self.atoms.columns(self.atom[candidate.columns[:1]])[at, 0]
        return bool(np.sum(column * self.y[at]) > 0.5 * np.sum(column**2))

    def rows_of(self, columns: NDArray[np.intp]) -> NDArray[np.float32]:
        """(T, k, N) the weighted rows of `columns` (k,); 0 at triangles that they are not at."""
        found = self.atoms.columns(self.atom[columns])
        found *= self.mask[columns].T[..., None]
        return found

    def moved_by(self, candidate: PlacedTerm, shares: Array) -> Array:
        """(T, N) weighted rows of a candidate with `shares`."""
        return np.stack([shares @ rows for rows in self.rows_of(candidate.columns)])

    @cached_property
    def least(self) -> Array:
        """(c,) squared sum, in variances of the noise, of the smallest effect worth a name, of each candidate."""
        taxels = self.seen.usable.sum(axis=1).astype(float)
        at = self.mask[[each.columns[0] for each in self.candidates]]
        shown = np.array([each.in_means for each in self.candidates])
        return np.asarray(LEAST_SIZE**2 * self.n_rows * (at @ taxels) * shown)

    @cached_property
    def _columns(self) -> PlacedColumns:
        return PlacedColumns(self.atom, self.mask)

    @cached_property
    def _with_shared(self) -> Array:
        """(p, s) inner products with the reference's columns."""
        return self._columns.summed(self.atoms.shared)

    @cached_property
    def _left(self) -> Array:
        """(T, N) of y, what own columns leave."""
        return self.nuisance.left_of(self.y)

    @cached_property
    def _y_with_shared(self) -> Array:
        """(s,) inner products of y with the reference's columns."""
        return self.nuisance.summed_with_shared(self._left)

    @cached_property
    def gram(self) -> Gram:
        """(p, p)"""
        atoms, columns = self.atoms, self._columns
        if len(self.atom) <= FEW:
            found = self._summed(atoms.gram) - self._with_shared @ self.nuisance.shared_inverse @ self._with_shared.T
            np.fill_diagonal(found, self._squares(np.diag(found)))
            return found
        projected = columns.summed(np.einsum("tkk->tk", atoms.gram))
        taken_up = np.einsum("ps,ps->p", self._with_shared @ self.nuisance.shared_inverse, self._with_shared)
        return GramMatrix(
            columns, atoms.gram, self._with_shared, self.nuisance.shared_inverse, self._squares(projected - taken_up)
        )

    def _squares(self, projected: Array) -> Array:
        """(p,) squared sums of the columns, from those of what nuisances leave, without the echo of noise."""
        own = projected - np.minimum(self._columns.summed(self.atoms.square), 0.9 * projected)
        # What nuisances take up whole would be a rounding error, of either sign.
        return np.maximum(own, LEAST_KEPT * self._columns.summed(np.einsum("tkk->tk", self.atoms.raw)))

    @cached_property
    def left_of_atoms(self) -> Array:
        """(T, K) inner products of the atoms with what own columns leave of y."""
        return self.atoms.products_with(self._left) - self.atoms.product

    @cached_property
    def cross(self) -> Array:
        """(p,)"""
        found = self._columns.summed(self.left_of_atoms)
        return np.asarray(found - self._with_shared @ self.nuisance.shared_inverse @ self._y_with_shared)

    @cached_property
    def total(self) -> float:
        """Squared residual of the static model."""
        with_y = self._y_with_shared
        return float(np.sum(self.y * self._left)) - float(with_y @ self.nuisance.shared_inverse @ with_y)

    def size(self, candidate: PlacedTerm, shares: Array) -> float:
        """Squared sum of an effect in variances of the noise, whatever else could explain it, but for loose curves."""
        if self.priors.has_loose_curves:
            return float(shares @ self.gram[np.ix_(candidate.columns, candidate.columns)] @ shares)
        own = self._products_of(candidate, True)[self.mask[candidate.columns[0]]]
        return float(np.einsum("k,tkl,l->", shares, own, shares))

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
        vars(found).update(
            gram=self.gram, _columns=self._columns, _with_shared=self._with_shared, _products=self._products
        )
        return found

    def _changed(self, atoms: Atoms, kept: NDArray[np.intp] | slice, **changes: Any) -> BlockDesign:
        """On the same rows with other `atoms`: those `kept` of its own, and new ones."""
        found = replace(self, atoms=atoms, **changes)
        vars(found).update(_left=self._left, _y_with_shared=self._y_with_shared, total=self.total)
        if "left_of_atoms" in vars(self):
            left = self.left_of_atoms[:, kept]
            fresh = atoms.products_with(self._left, left.shape[1]) - atoms.product[:, left.shape[1] :]
            vars(found).update(left_of_atoms=np.concatenate([left, fresh], axis=1))
        return found

    def under(self, priors: Priors) -> BlockDesign:
        """With the same candidates under other `priors`, which recalibrations can be told under as well."""
        if priors == self.priors:
            return self
        nuisance = nuisance_of(self.load, self.weights, priors)
        return replace(self, nuisance=nuisance, atoms=projected(self.atoms, nuisance), priors=priors)

    def released(self) -> BlockDesign:
        """The same, without the arrays that its columns were made of: what is asked for is computed again."""
        found = replace(self, load=self.load.released())
        of_load = ("unmoved", *self.__dataclass_fields__)
        vars(found).update({name: known for name, known in vars(self).items() if name not in of_load})
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
        return self._changed(
            self.atoms.picked(used), used, candidates=candidates, atom=atom, mask=self.mask[columns]
        )  # fmt: skip

    def exchanged(self, i: int, setting: Setting) -> BlockDesign:
        """With another setting of candidate `i`."""
        candidate = self.candidates[i]
        block = candidate.term.column_of(self.load, setting)
        others, rest = self._beside(i)
        atom = np.empty_like(self.atom)
        atom[candidate.columns] = len(others) + np.arange(len(candidate.columns))
        kept = np.setdiff1d(np.arange(len(atom)), candidate.columns)
        atom[kept] = np.searchsorted(others, self.atom[kept])
        candidates = tuple(replace(c, settings=block.settings) if j == i else c for j, c in enumerate(self.candidates))
        atoms = make_atoms([block], self.weights, self.nuisance, joined=rest)
        return self._changed(atoms, others, candidates=candidates, atom=atom)

    def _beside(self, i: int) -> tuple[NDArray[np.intp], Atoms]:
        """Numbers of the atoms that others than candidate `i` need, and these."""
        if i not in self._rests:
            others = np.unique(np.delete(self.atom, self.candidates[i].columns))
            self._rests[i] = others, self.atoms.picked(others)
        return self._rests[i]

    @cached_property
    def _rests(self) -> dict[int, tuple[NDArray[np.intp], Atoms]]:
        return {}

    def of_laws(self) -> BlockDesign:
        """With the laws of its candidates alone, as a model has them.

        Without what they leave out of real materials, and what a load before the recording has left.
        """
        candidates = tuple(each.of_law().without(IN_NO_MODEL) for each in self.candidates)
        return self._changed(self.atoms, slice(None), candidates=candidates)

    def of_families(self) -> BlockDesign:
        """Return it with all columns of its candidates, without companions for uneven materials and earlier loads."""
        candidates = tuple(each.without(IN_NO_MODEL) for each in self.candidates)
        return self._changed(self.atoms, slice(None), candidates=candidates)

    def with_settings(self, found: Sequence[tuple[int, Setting]]) -> BlockDesign:
        """With candidates like those of number `k` with other settings."""
        if not found:
            return self
        blocks, candidates, atom, mask = [], list(self.candidates), [self.atom], [self.mask]
        first, number = self.atoms.product.shape[1], len(self.atom)
        for k, setting in found:
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
        return self._changed(
            self.atoms, slice(None),
            candidates=with_companions(candidates, AT_REST), atom=np.concatenate(atom), mask=np.concatenate(mask),
        )  # fmt: skip

    def _summed(self, by_triangle: Array) -> Array:
        """(p, p) sums of values (T, K, K) of the atoms over the triangles that two columns both are at."""
        own, at = by_triangle[:, self.atom[:, None], self.atom], self.mask.T.astype(float)
        return np.asarray(np.sum(own * at[:, :, None] * at[:, None, :], axis=0))


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
    nuisance = nuisance_of(load, weights, priors)
    excluded = RECALIBRATIONS if priors.has_loose_curves else ()
    terms = [each for each in TERMS if each.needs(load) is None and each.word not in excluded]
    placement = Placement(seen)

    def blocks() -> Iterator[TermColumns]:
        for term in terms:
            for block in term.placed_columns(load):
                placement.add(term, block)
                yield block

    atoms = make_atoms(blocks(), weights, nuisance)
    candidates = with_companions(placement.candidates, AT_REST)
    nothing = np.zeros((weights.shape[1], weights.shape[0]))
    found = BlockDesign(load, weights, nuisance, atoms, candidates, placement.atom, placement.mask, nothing, priors)
    return replace(found, y=residual(found, Timing()))
