"""Read a walk by the model of a chamber of the same insole: without the memories that were found there.

On a walk only the force and two moments of the load are known, and a strong memory can describe other effects as well.
In a chamber the load of every taxel is known. So memories and curves are taken from the chamber, and the walk is
searched for the remaining effects.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files import write_text
from ..physics import calibration as calibrations
from ..physics.chain import Chain
from ..physics.curve_inverse import CurveInverse
from ..physics.law import Array
from ..recording.loading import FootRecording, as_configured
from .finding import Finding
from .floor import noise_of_readings
from .observations.wrench import WrenchObservation
from .terms import TERMS

MEMORIES = frozenset(term.word for term in TERMS if term.is_loop)


@dataclass(frozen=True, slots=True, eq=False)
class ChamberModel:
    """What a chamber tells of an insole: curves and memories, up to the activations that it reached."""

    document: Mapping[str, Any]  # `insole-calibration/1`
    highest_count: Array  # (T, 12) activations

    @property
    def words(self) -> frozenset[str]:
        """Return the effect words of its memories."""
        return frozenset(effect["effect"] for effect in self.document["effects"])


def read_by(model: ChamberModel, seen: WrenchObservation, foot: FootRecording) -> WrenchObservation:
    """Return `seen` with the activations that a sensor of its own curves without the memories of `model` had read.

    Beyond what the chamber reached, readings change the pressure as by the curves of `seen`. The noise of a reading
    grows as its third differences do.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        write_text(path, json.dumps(dict(model.document)))
        calibration = calibrations.load(path, seen.layout)
    usable = seen.usable & calibration.usable & (seen.calibration.coefficients_pa[..., 1] > 0.0)
    chain = Chain(calibration.effects, seen.layout, calibration, [as_configured(board) for board in foot.boards])
    within = np.minimum(seen.activation_count, model.highest_count)
    count = np.where(usable, calibration.baseline_count - within, 0.0)
    pressure_pa = chain.live()(count, seen.t_s)
    static_pa = Chain((), seen.layout, calibration).live()(count, seen.t_s)
    undone_change = seen.wrench_of(np.where(usable, pressure_pa - static_pa, 0.0)).sum(axis=1)
    pressure_pa += seen.static_pa(seen.activation_count) - seen.static_pa(within)
    activation = np.zeros_like(seen.activation_count)
    activation[:, usable] = CurveInverse(seen.calibration.coefficients_pa[usable])(pressure_pa[:, usable])
    noise_count = seen.noise_count.copy()
    before, after = (noise_of_readings(each[:, usable]) for each in (seen.activation_count, activation))
    noise_count[usable] *= after / before
    return replace(
        seen, activation_count=activation, usable=usable, noise_count=noise_count,
        undone=model.words, undone_change=undone_change,
    )  # fmt: skip


def with_bursts_as_read(findings: Sequence[Finding], as_read: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings of a walk that was read by a model, with the bursts of noise of those of the walk `as_read`.

    How much undoing a memory amplifies the noise of a reading depends on the load before it, which looks like bursts.
    """
    bursts = [finding for finding in as_read if finding.effect == "noise_burst"]
    return (*(finding for finding in findings if finding.effect != "noise_burst"), *bursts)
