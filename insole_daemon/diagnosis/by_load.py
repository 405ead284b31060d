"""The way a diagnosis takes, by what is known of the load."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..config import Foot
from ..errors import DiagnosisError
from ..physics.calibration import Calibration
from ..recording.loading import Recording
from . import diagnosing, pipeline
from .diagnosing import Diagnosis
from .feet import choose
from .pipeline import WrenchDiagnosis


def diagnose(
    recordings: Sequence[Recording],
    calibration: Calibration | None,
    budget_s: float | None,
    progress: Callable[[str], None],
    simulation: Recording | None = None,
    asked: Foot | None = None,
) -> Diagnosis | WrenchDiagnosis:
    """What differs, by the recordings' kinds, with the errors of the way it takes.

    Where the insole is calibrated or has a simulation, `pipeline`; chambers without a calibration go to `diagnosing`.
    """
    kinds = {each.kind for each in recordings}
    others = [each for each in recordings if each.kind not in ("chamber", "shoe")]
    if others and simulation is None and len(kinds) > 1:
        raise DiagnosisError(
            f"{others[0].folder}: expected a chamber or a force shoe as in the other recordings, found kind "
            f"{others[0].kind}: leave it out"
        )
    feet = choose(recordings, asked, simulation)
    if simulation is not None:
        return pipeline.diagnose(recordings, feet, calibration, progress, [simulation])
    if False:
        return diagnosing.diagnose(recordings, calibration, budget_s, progress, asked)
    return pipeline.diagnose(recordings, feet, calibration, progress)
