"""The way a diagnosis takes, by what is known of the load."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..config import Foot
from ..errors import DiagnosisError
from ..physics.calibration import Calibration
from ..recording.loading import Recording
from . import diagnosing, together
from .diagnosing import Diagnosis
from .feet import choose
from .foot import diagnosing as on_foot
from .foot.diagnosing import WalkDiagnosis
from .together import Together


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    simulation: Recording | None = None,
    asked: Foot | None = None,
) -> Diagnosis | WalkDiagnosis | Together:
    """On every taxel (`diagnosing`), in sum (`foot.diagnosing`) or both (`together`), with their errors."""
    kinds = {each.kind for each in recordings}
    if simulation is not None or "shoe" not in kinds:
        return diagnosing.diagnose(recordings, calibration, budget_s, progress, simulation, asked)
    others = [each for each in recordings if each.kind not in ("chamber", "shoe")]
    if others:
        raise DiagnosisError(
            f"{others[0].folder}: expected a chamber or a force shoe as in the other recordings, found kind "
            f"{others[0].kind}: leave it out"
        )
    if "chamber" in kinds:
        return together.diagnose(recordings, calibration, budget_s, progress, asked)
    return on_foot.diagnose(recordings, choose(recordings, asked), calibration, budget_s, progress)
