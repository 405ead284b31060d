"""Any effects, composed in the order of the signal path; how it is used stands in `effects`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from ..errors import EffectError
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from .calibration import Calibration
from .curve_inverse import CurveInverse
from .effect import Effect, per_slot, wrong_where
from .law import Array, Domain, Law, Maker, Moments, Operator, Site, Values
from .run import Run
from .static_curve import horner

_PATH: tuple[tuple[Domain, ...], ...] = (("place", "pressure"), ("curve",), ("activation",), ("count",), ("time",))


def _copied(x: Array, moments: Moments) -> Array:
    return x.copy()


class Chain:
    """`effects` on an insole: with a calibration between load and count, without one between load and effective load.

    Entries of one law that follow each other and have no taxel in common run as one, with a value for each taxel.
    """

    def __init__(
        self,
        effects: Iterable[Effect],
        layout: Layout,
        calibration: Calibration | None = None,
        boards: Sequence[Board] = (),
        seed: int = 0,
    ) -> None:
        """`boards`: their believed settings, for laws of the digitiser; `seed`: of laws of chance.

        EffectError says what does not go together.
        """
        # A stable sort: of equal order, what was named first comes first.
        self.effects = tuple(sorted(effects, key=lambda effect: _turn(effect.law)))
        self._layout, self._calibration = layout, calibration
        self._boards = {board.address: board for board in boards}
        self._seed = seed
        self._xy_m = self._places(self.effects)
        for effect in self.effects:
            wrong = "; ".join(message for _, message in wrong_where(effect.law, effect.where, layout))
            if calibration is None and effect.law.domain in ("curve", "activation", "count"):
                wrong = wrong or "it acts on counts, expected a calibration that turns the load into them"
            if wrong:
                raise EffectError(f"the effect {effect.law.word}: {wrong}")
        self._pressure, self._instead, self._activation, self._count = (
            list(_together(self.effects, layout, domains)) for domains in _PATH[:-1]
        )

    @property
    def xy_m(self) -> Array:
        """(n_triangles, 12, 2) where the taxels really lie: of the loads given to `forward`, found by `inverse`."""
        return self._places(effect for effect in self.effects if effect.law.domain == "place")

    def reference_s(self, t_s: Array) -> Array:
        """(n,) seconds of the reference's clock when the CAN's says `t_s`."""
        for effect in self.effects:
            t_s = effect.law.times({name: value[None] for name, value in effect.values.items()}, t_s)
        return t_s

    def forward(self) -> Run:
        """From the load (Pa), at rest, to what is read: mean counts, or effective pressure without a calibration."""
        pressure, activation, count = (
            [self._stage(work, work.law.forward) for work in works]
            for works in (self._pressure, self._activation, self._count)
        )
        if self._calibration is None:
            return Run(pressure, len(self._layout), None)
        coefficients, baseline, usable = self._curve()
        polynomial = CurveInverse(coefficients)
        curve = self._curved(lambda x, _: polynomial(x), [(work, work.law.forward) for work in self._instead])
        return Run(
            [*pressure, curve, *activation, lambda x, _: baseline - x, *count],
            len(self._layout),
            usable,
        )

    def inverse(self) -> Run:
        """What `forward` does undone by causal steps: from counts, or effective pressure, to the load.

        EffectError lists the effects that have no inverse, and what to do instead.
        """
        laws = {effect.law.word: effect.law for effect in self.effects if effect.law.inverse is None}
        if laws:
            said = [f"the effect {word} has no inverse: {law.inverse_is}" for word, law in laws.items()]
            raise EffectError("\n".join(said))
        return self._undone(lambda law: law.inverse)

    def live(self) -> Run:
        """The same for readings as they are: noise is kept small, and what has no inverse is left as it is.

        What comes out belongs to a moment `late_s` before that of the reading.
        """
        return self._undone(lambda law: law.live or law.inverse)

    @property
    def late_s(self) -> Array:
        """(n_triangles, 12) by how much older than its stamp each reading is that `live` has undone."""
        late_s = np.zeros(len(self._layout) * N_TAXELS)
        for effect in self.effects:
            late_s[effect.where.slots(self._layout)] += effect.law.late_s(_values(effect))
        return late_s.reshape(len(self._layout), N_TAXELS)

    @property
    def read_by(self) -> NDArray[np.intp] | None:
        """(12 · n_triangles,) of every slot of a load, the slot that reads it; None: each its own."""
        swapped = [effect for effect in self.effects if effect.law.word == "swapped_triangles"]
        if not swapped:
            return None
        slot = np.arange(len(self._layout) * N_TAXELS)
        for effect in reversed(swapped):
            rows = slot.reshape(-1, N_TAXELS)
            pair = [self._layout.rows[identity] for identity in effect.where.ids]  # type: ignore[index]
            rows[pair] = rows[pair[::-1]]
        return slot

    def _undone(self, by: Callable[[Law], Maker | None]) -> Run:
        """From readings to the load; what `by` has no maker for is passed over."""
        pressure, activation, count = (
            [self._stage(work, maker) for work in reversed(works) if (maker := by(work.law)) is not None]
            for works in (self._pressure, self._activation, self._count)
        )
        if self._calibration is None:
            return Run(pressure, len(self._layout), None, self.read_by)
        coefficients, baseline, usable = self._curve()
        rows = np.ascontiguousarray(coefficients.T)
        curve = self._curved(
            lambda x, _: horner(rows, x),
            [(work, maker) for work in self._instead if (maker := by(work.law)) is not None],
        )
        return Run(
            [*count, lambda x, _: baseline - x, *activation, curve, *pressure],
            len(self._layout),
            usable,
            self.read_by,
        )

    def _places(self, effects: Iterable[Effect]) -> Array:
        xy_m = self._layout.xy_m
        for effect in effects:
            xy_m = effect.law.places(_values(effect), xy_m, self._layout)
        return xy_m

    def _curve(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """(m, k) coefficients, (m,) baselines and which slots these belong to; the others get a line that works."""
        assert self._calibration is not None
        usable = self._calibration.usable.ravel()
        coefficients = self._calibration.coefficients_pa.reshape(usable.size, -1)
        if coefficients.shape[1] == 1:
            coefficients = np.concatenate([coefficients, np.zeros_like(coefficients)], axis=1)
        line = np.zeros(coefficients.shape[1])
        line[1] = 1.0
        coefficients = np.where(usable[:, None], coefficients, line)
        return coefficients, np.where(usable, self._calibration.baseline_count.ravel(), 0.0), usable

    def _curved(self, polynomial: Operator, instead: Iterable[tuple[_Work, Maker]]) -> Operator:
        """`polynomial`, and `instead` of it the curves of another kind on their taxels."""
        for work, maker in instead:
            polynomial = self._stage(work, maker, polynomial)
        return polynomial

    def _stage(self, work: _Work, maker: Maker, others: Operator = _copied) -> Operator:
        """`work` on all slots; `others` is what happens to those that it is not at work on."""
        shift, no_load = self._settings(work.slots)
        operator = maker(work.values, Site(self._layout, self._xy_m, work.slots, shift, no_load, self._seed))
        slots, every = work.slots, len(self._layout) * N_TAXELS
        if work.law.sees_all or len(slots) == every:
            return operator

        def stage(x: Array, moments: Moments) -> Array:
            y = others(x, moments)
            if moments.temperature_c is not None and moments.temperature_c.shape[1] == every:
                moments = replace(moments, temperature_c=moments.temperature_c[:, slots])
            y[:, slots] = operator(x[:, slots], moments)
            return y

        return stage

    def _settings(self, slots: NDArray[np.intp]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(m,) shift and no-load of the slots; empty where not all of their boards are known."""
        of_slots = [self._boards.get(int(self._layout.identities[slot // N_TAXELS, 0])) for slot in slots]
        known = [board for board in of_slots if board is not None]
        if len(known) < len(of_slots):
            known = []
        shift, no_load = [board.shift for board in known], [board.no_load for board in known]
        return np.array(shift, np.int64), np.array(no_load, np.int64)


@dataclass(frozen=True, slots=True)
class _Work:
    """One law on some slots, in ascending order, with its values for each of them or for all."""

    law: Law
    slots: NDArray[np.intp]
    values: Values

    def joined(self, other: _Work) -> _Work | None:
        """Both as one, None where they have to stay two."""
        if self.law is not other.law or self.law.sees_all or np.intersect1d(self.slots, other.slots).size:
            return None
        if any(len(value) != len(other.values[name]) for name, value in self.values.items() if value.ndim == 2):
            return None  # lists of different lengths
        slots = np.concatenate([self.slots, other.slots])
        order = np.argsort(slots)
        values = {
            name: np.concatenate([_wide(work.values[name], len(work.slots)) for work in (self, other)], axis=-1)
            for name in self.values
        }
        return _Work(self.law, slots[order], {name: value[..., order] for name, value in values.items()})


def _together(effects: Iterable[Effect], layout: Layout, domains: Sequence[Domain]) -> Iterable[_Work]:
    """The work of the effects in `domains`, neighbours joined where that changes nothing."""
    last: _Work | None = None
    for effect in effects:
        if effect.law.domain not in domains:
            continue
        slots = effect.where.slots(layout)
        for parameter in effect.law.parameters:
            n = _values(effect)[parameter.name].shape[-1]
            if parameter.size != "pair" and n not in (1, len(slots)):
                raise EffectError(
                    f"the effect {effect.law.word}: expected one value of {parameter.name}, or {len(slots)}, "
                    f"one for each of its taxels, found {n}"
                )
        order = np.argsort(slots)
        values = {name: v if v.shape[-1] != len(slots) else v[..., order] for name, v in _values(effect).items()}
        work = _Work(effect.law, slots[order], values)
        joined = last.joined(work) if last is not None else None
        if joined is None and last is not None:
            yield last
        last = joined or work
    if last is not None:
        yield last


def _values(effect: Effect) -> Values:
    return {p.name: per_slot(p, effect.values[p.name]) for p in effect.law.parameters}


def _wide(value: Array, m: int) -> Array:
    return np.broadcast_to(value, (*value.shape[:-1], m))


def _turn(law: Law) -> tuple[int, Any]:
    """Where on the path a law stands: by its domain, the order of the table within that."""
    domain = next(i for i, domains in enumerate(_PATH) if law.domain in domains)
    # A delay and the digitiser, which has no memory, may change places; and interpolation between two counts is
    # exact only before the floor.
    return domain, 11 if law.word == "bit_shift" else law.order
