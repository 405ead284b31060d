"""Findings and their parameters: the structs of `insole-diagnosis/1`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..config import Foot
from ..physics.effect import Where

Verdict = Literal["no mismatch", "explained", "partly explained", "unexplained", "not decidable"]
LEFT_OUT = ("dead_taxels", "open_triangle", "noise_burst", "frame_loss")  # faults, which no effect of a model describes
OF_FAULT = 0.85  # confidence of a fault that the readings or the reference show by themselves


@dataclass(frozen=True, slots=True)
class Quantity:
    """One parameter with its standard deviation: numbers, or lists of the same length."""

    value: Any
    std: Any
    unit: str

    def document(self) -> dict[str, Any]:
        """Return the content for JSON."""
        return {"value": _plain(self.value), "std": _plain(self.std), "unit": self.unit}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """An effect or fault that a diagnosis reports."""

    effect: str
    foot: Foot
    where: Where
    sentence: str
    recordings: tuple[str, ...]
    alternatives: tuple[str, ...] = ()
    contradicted_by: tuple[str, ...] = ()
    when_s: tuple[tuple[float, float], ...] = ()
    regime: Mapping[str, Any] = field(default_factory=dict)
    equation: str = ""
    parameters: Mapping[str, Quantity] = field(default_factory=dict)
    explains: float = 0.0  # reduction of the mean square over all taxels, counts²
    left: float = 0.0  # of an `unknown`: the mean square beyond the noise that no effect explains, in the same unit
    heldout_count: tuple[float, float] | None = None  # without and with this finding
    heldout_n: tuple[float, float] | None = None  # the same of f_z, if the load of single taxels is not known
    confidence: float = OF_FAULT
    margin: float | None = None  # loss without it, in units of the least gain of an effect

    @property
    def size(self) -> float:
        """Mean square that it explains, or leaves unexplained: orders the findings."""
        return max(self.explains, self.left)

    def document(self) -> dict[str, Any]:
        """Return the content of the finding in `insole-diagnosis/1`."""
        content: dict[str, Any] = {
            "effect": self.effect,
            "alternatives": list(self.alternatives),
            "foot": self.foot,
            "recordings": list(self.recordings),
            "contradicted_by": list(self.contradicted_by),
            "where": {"scope": self.where.scope, "ids": [list(identity) for identity in self.where.ids]},
            "when_s": [[round(a, 3), round(b, 3)] for a, b in self.when_s],
            "regime": dict(self.regime),
            "equation": self.equation,
            "parameters": {name: quantity.document() for name, quantity in self.parameters.items()},
        }
        for unit, figures in (("count", self.heldout_count), ("N", self.heldout_n)):
            if figures is not None:
                content["heldout"] = {"unit": unit, "before": round(figures[0], 4), "after": round(figures[1], 4)}
        content["confidence"] = round(self.confidence, 3)
        content["sentence"] = self.sentence
        return content


def heldout_of(load_is_known: bool, before: float, after: float) -> dict[str, Any]:
    """Return the field of a `Finding` for the errors before and after it, in the unit of its rows."""
    return {"heldout_count" if load_is_known else "heldout_n": (before, after)}


def _plain(value: Any) -> Any:
    return [_plain(x) for x in value] if np.ndim(value) else round(float(value), 9)
