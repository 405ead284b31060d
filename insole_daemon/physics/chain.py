"""Compose effects in the order of the signal path; `effects/__init__.py` shows how to use it."""

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
from .effect import Effect, per_slot, where_problems
from .kernel_stage import MOST_STAGES, MOST_TERMS, CompiledOperator, KernelStage
from .law import Array, Domain, Law, Maker, Moments, Operator, Site, Values, unchanged
from .run import ChainRun
from .static_curve import horner

_PATH: tuple[tuple[Domain, ...], ...] = (("place", "pressure"), ("curve",), ("activation",), ("count",), ("time",))


def _copy(x: Array, moments: Moments) -> Array:
    return x.copy()


class Chain:
    """A chain of effects on an insole, from load to count with a calibration, else from load to effective load.

    Successive entries of one law that have no taxel in common run as one operator, with a value for each taxel.
    """

    def __init__(
        self,
        effects: Iterable[Effect],
        layout: Layout,
        calibration: Calibration | None = None,
        boards: Sequence[Board] = (),
        seed: int = 0,
    ) -> None:
        """Sort the effects by the signal path; EffectError if they do not fit the layout or the calibration.

        `boards` are the boards' configured settings, needed by laws of the digitiser; `seed` is for random laws.
        """
        # The sort is stable: effects of equal order keep the order in which they were given.
        self.effects = tuple(sorted(effects, key=lambda effect: _path_position(effect.law)))
        self._layout, self._calibration = layout, calibration
        self._boards = {board.address: board for board in boards}
        self._seed = seed
        self._xy_m = self._places(self.effects)
        for effect in self.effects:
            problem = "; ".join(message for _, message in where_problems(effect.law, effect.where, layout))
            if calibration is None and effect.law.domain in ("curve", "activation", "count"):
                problem = problem or "it acts on counts, expected a calibration that turns the load into them"
            if problem:
                raise EffectError(f"the effect {effect.law.word}: {problem}")
        self._pressure, self._curve_replacements, self._activation, self._count = (
            list(_join_neighbours(self.effects, layout, domains)) for domains in _PATH[:-1]
        )

    @property
    def xy_m(self) -> Array:
        """Return (n_triangles, 12, 2) the true positions of the taxels, for loads of `forward` and from `inverse`."""
        return self._places(effect for effect in self.effects if effect.law.domain == "place")

    def reference_s(self, t_s: Array) -> Array:
        """Return (n,) the reference's times, in s, at the times `t_s` of the CAN clock."""
        for effect in self.effects:
            t_s = effect.law.times({name: value[None] for name, value in effect.values.items()}, t_s)
        return t_s

    def forward(self) -> ChainRun:
        """Return the operator from load (Pa), at rest, to mean counts, or to effective pressure without a
        calibration.
        """
        pressure, activation, count = (
            [self._stage(work, work.law.forward) for work in works]
            for works in (self._pressure, self._activation, self._count)
        )
        if self._calibration is None:
            return ChainRun(pressure, len(self._layout), None)
        coefficients, baseline, usable = self._curve()
        polynomial = CurveInverse(coefficients)
        curve = self._curve_stage(
            lambda x, _: polynomial(x), [(work, work.law.forward) for work in self._curve_replacements]
        )
        return ChainRun(
            [*pressure, curve, *activation, lambda x, _: baseline - x, *count],
            len(self._layout),
            usable,
        )

    def inverse(self) -> ChainRun:
        """Return the causal inverse of `forward`, from counts or effective pressure to the load.

        EffectError lists the effects that have no inverse, and what to do instead.
        """
        laws = {effect.law.word: effect.law for effect in self.effects if effect.law.inverse is None}
        if laws:
            reasons = [f"the effect {word} has no inverse: {law.inverse_is}" for word, law in laws.items()]
            raise EffectError("\n".join(reasons))
        return self._build_inverse(lambda law: law.inverse)

    def live(self) -> ChainRun:
        """Return the causal inverse for noisy readings: it limits noise, and skips effects without an inverse.

        Its results belong to the time `late_s` before that of the reading.
        """
        return self._build_inverse(lambda law: law.live or law.inverse)

    def kernel_stages(self) -> list[KernelStage] | None:
        """Return the stages of `live` as the compiled kernel takes them; None where it has not all of them.

        It has those from effective pressure to the load, for a chain without a calibration.
        """
        stages: list[KernelStage] = []
        for work in reversed(self._pressure):
            maker = work.law.live or work.law.inverse
            if maker is None or maker is unchanged:
                continue
            operator = self._operator(work, maker)
            if not isinstance(operator, CompiledOperator):
                return None
            stages.append(operator.kernel_stage(work.slots))
        if self.read_by is not None or len(stages) > MOST_STAGES or any(s.n_terms > MOST_TERMS for s in stages):
            return None
        return stages

    @property
    def late_s(self) -> Array:
        """Return (n_triangles, 12) the remaining delay of each reading after `live`, in s."""
        late_s = np.zeros(len(self._layout) * N_TAXELS)
        for effect in self.effects:
            late_s[effect.where.slots(self._layout)] += effect.law.late_s(_values(effect))
        return late_s.reshape(len(self._layout), N_TAXELS)

    @property
    def read_by(self) -> NDArray[np.intp] | None:
        """Return (12 · n_triangles,) the slot that reads the load of each slot, or None if each reads its own."""
        swapped = [effect for effect in self.effects if effect.law.word == "swapped_triangles"]
        if not swapped:
            return None
        slot = np.arange(len(self._layout) * N_TAXELS)
        for effect in reversed(swapped):
            rows = slot.reshape(-1, N_TAXELS)
            pair = [self._layout.rows[identity] for identity in effect.where.ids]  # type: ignore[index]
            rows[pair] = rows[pair[::-1]]
        return slot

    def _build_inverse(self, maker_of: Callable[[Law], Maker | None]) -> ChainRun:
        """Return the operator from readings to the load; effects for which `maker_of` returns None are skipped."""
        pressure, activation, count = (
            [self._stage(work, maker) for work in reversed(works) if (maker := maker_of(work.law)) is not None]
            for works in (self._pressure, self._activation, self._count)
        )
        if self._calibration is None:
            return ChainRun(pressure, len(self._layout), None, self.read_by)
        coefficients, baseline, usable = self._curve()
        rows = np.ascontiguousarray(coefficients.T)
        curve = self._curve_stage(
            lambda x, _: horner(rows, x),
            [(work, maker) for work in self._curve_replacements if (maker := maker_of(work.law)) is not None],
        )
        return ChainRun(
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
        """Return (m, k) coefficients, (m,) baselines and (m,) usable slots; unusable slots get a straight line."""
        assert self._calibration is not None
        usable = self._calibration.usable.ravel()
        coefficients = self._calibration.coefficients_pa.reshape(usable.size, -1)
        if coefficients.shape[1] == 1:
            coefficients = np.concatenate([coefficients, np.zeros_like(coefficients)], axis=1)
        line = np.zeros(coefficients.shape[1])
        line[1] = 1.0
        coefficients = np.where(usable[:, None], coefficients, line)
        return coefficients, np.where(usable, self._calibration.baseline_count.ravel(), 0.0), usable

    def _curve_stage(self, polynomial: Operator, instead: Iterable[tuple[_Work, Maker]]) -> Operator:
        """Return `polynomial`, replaced by the laws of `instead` on their taxels."""
        for work, maker in instead:
            polynomial = self._stage(work, maker, polynomial)
        return polynomial

    def _stage(self, work: _Work, maker: Maker, others: Operator = _copy) -> Operator:
        """Return the operator of `work` for all slots; `others` is applied to the slots without the effect."""
        operator = self._operator(work, maker)
        slots, n_slots = work.slots, len(self._layout) * N_TAXELS
        if work.law.sees_all or len(slots) == n_slots:
            return operator

        def stage(x: Array, moments: Moments) -> Array:
            y = others(x, moments)
            if moments.temperature_c is not None and moments.temperature_c.shape[1] == n_slots:
                moments = replace(moments, temperature_c=moments.temperature_c[:, slots])
            y[:, slots] = operator(x[:, slots], moments)
            return y

        return stage

    def _operator(self, work: _Work, maker: Maker) -> Operator:
        """Return the operator of `work` for its own slots, or for all if its law sees them all."""
        shift, no_load = self._board_settings(work.slots)
        return maker(work.values, Site(self._layout, self._xy_m, work.slots, shift, no_load, self._seed))

    def _board_settings(self, slots: NDArray[np.intp]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (m,) shift and no-load of the slots; empty if one of their boards is unknown."""
        boards = [self._boards.get(int(self._layout.identities[slot // N_TAXELS, 0])) for slot in slots]
        known = [board for board in boards if board is not None]
        if len(known) < len(boards):
            known = []
        shift, no_load = [board.shift for board in known], [board.no_load for board in known]
        return np.array(shift, np.int64), np.array(no_load, np.int64)


@dataclass(frozen=True, slots=True)
class _Work:
    """One law on some slots, in ascending order, with its values for each slot or for all."""

    law: Law
    slots: NDArray[np.intp]
    values: Values

    def join(self, other: _Work) -> _Work | None:
        """Return both as one, or None if they must stay separate."""
        if self.law is not other.law or self.law.sees_all or np.intersect1d(self.slots, other.slots).size:
            return None
        if self.values.keys() != other.values.keys() or any(
            len(value) != len(other.values[name]) for name, value in self.values.items() if value.ndim == 2
        ):
            return None  # other parameters, or lists of different lengths
        slots = np.concatenate([self.slots, other.slots])
        order = np.argsort(slots)
        values = {
            name: np.concatenate(
                [_broadcast_slots(work.values[name], len(work.slots)) for work in (self, other)], axis=-1
            )
            for name in self.values
        }
        return _Work(self.law, slots[order], {name: value[..., order] for name, value in values.items()})


def _join_neighbours(effects: Iterable[Effect], layout: Layout, domains: Sequence[Domain]) -> Iterable[_Work]:
    """Yield the work of the effects in `domains`, with neighbours joined where the result is the same."""
    pending: _Work | None = None
    for effect in effects:
        if effect.law.domain not in domains:
            continue
        slots = effect.where.slots(layout)
        for parameter in effect.law.given(effect.values):
            n = _values(effect)[parameter.name].shape[-1]
            if parameter.size != "pair" and n not in (1, len(slots)):
                raise EffectError(
                    f"the effect {effect.law.word}: expected one value of {parameter.name}, or {len(slots)}, "
                    f"one for each of its taxels, found {n}"
                )
        order = np.argsort(slots)
        values = {name: v if v.shape[-1] != len(slots) else v[..., order] for name, v in _values(effect).items()}
        work = _Work(effect.law, slots[order], values)
        join = pending.join(work) if pending is not None else None
        if join is None and pending is not None:
            yield pending
        pending = join or work
    if pending is not None:
        yield pending


def _values(effect: Effect) -> Values:
    return {p.name: per_slot(p, effect.values[p.name]) for p in effect.law.given(effect.values)}


def _broadcast_slots(value: Array, m: int) -> Array:
    return np.broadcast_to(value, (*value.shape[:-1], m))


def _path_position(law: Law) -> tuple[int, Any]:
    """Return the sort key of a law: its domain's position on the signal path, then its order in the format's table."""
    domain = next(i for i, domains in enumerate(_PATH) if law.domain in domains)
    # The digitiser has no memory, so it commutes with a delay; interpolation is exact only before its rounding.
    return domain, 11 if law.word == "bit_shift" else law.order
