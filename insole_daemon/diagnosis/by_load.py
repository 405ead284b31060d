"""The way a diagnosis takes, by what is known of the load."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..config import Foot
from ..errors import DiagnosisError
from ..physics.calibration import Calibration
from ..recording.loading import Recording
from . import diagnosing
from .diagnosing import Diagnosis
from .feet import choose
from .foot import diagnosing as on_foot
from .foot.diagnosing import WalkDiagnosis


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    simulation: Recording | None = None,
    asked: Foot | None = None,
) -> Diagnosis | WalkDiagnosis:
    """On every taxel (`diagnosing`), or in sum (`foot.diagnosing`): arguments and errors are those of both."""
    kinds = {each.kind for each in recordings}
    if simulation is not None or "shoe" not in kinds:
        return diagnosing.diagnose(recordings, calibration, budget_s, progress, simulation, asked)
    others = [each for each in recordings if each.kind != "shoe"]
    if others:
        raise DiagnosisError(
            f"{others[0].folder}: expected force shoes as in the other recordings, found kind {others[0].kind}: "
            "diagnose the chamber first, and the walks against the static curves of its model"
        )
    return on_foot.diagnose(recordings, choose(recordings, asked), calibration, budget_s, progress)
