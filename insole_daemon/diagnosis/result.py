"""Results of a diagnosis: of each recording, and of all together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import __version__
from ..physics.effect import Effect
from .caches import forget_cached
from .export import wrench_model
from .finding import Finding
from .model.blocks import BlockDesign
from .model.design import Design
from .model.refine import Refined
from .model.regression import Timing
from .observations.reading_faults import ReadingFaults
from .observations.wrench import WrenchObservation
from .outcome import Outcome
from .select.wrench_errors import HeldoutErrors


@dataclass(frozen=True, slots=True, eq=False)
class RecordingResult:
    """The result of one recording."""

    faults: ReadingFaults
    design: Design | BlockDesign  # without candidates, which are large
    refined: Refined[Any]
    figures: HeldoutErrors
    findings: tuple[Finding, ...]
    effects: tuple[Effect, ...]
    candidates: tuple[tuple[str, float, float], ...]  # best single sets: words, gain and score in units of the rows
    not_identifiable: tuple[dict[str, str], ...]
    is_unknown: bool
    timing: Timing

    @property
    def seen(self) -> WrenchObservation:
        """The observation that the design was made of."""
        return self.design.load.observation

    def forget_cached(self) -> None:
        """Delete the cached arrays of observations and loads, which are computed again on demand."""
        forget_cached(self.faults.observation, self.refined)
        for design in (self.design, self.refined.design):
            forget_cached(design.load.observation, design.load, design)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Diagnosis(Outcome):
    """The outcome for recordings of one kind, with the results that it is based on."""

    results: tuple[RecordingResult, ...]
    effects: tuple[Effect, ...]

    def static(self) -> dict[str, Any]:
        """Return the static model that was diagnosed, as `insole-calibration/1`."""
        seen = self.results[0].seen.as_handed_in
        nothing = np.zeros(seen.usable.shape, bool)
        return wrench_model.document(seen, (), (), {"made_by": f"insole diagnose {__version__}"}, None, nothing)
