"""The objects that turn the cycles of a foot into messages; making them takes longer than a cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanics.static_model import StaticModel
from ..mechanics.wrench import WrenchEstimator
from ..physics.calibration import Calibration
from ..physics.static_curve import StaticCurve
from ..skin.faults import DeferredFaultWatch, FaultWatch
from ..skin.validity import Validity
from .dynamic_foot import DynamicFoot
from .foot_setup import FootSetup, differences


@dataclass(frozen=True, slots=True, eq=False)
class FootPipeline:
    """The pipeline of one foot for `setup`, to replace that of `before`; made in a thread if the foot is running."""

    setup: FootSetup
    before: FootSetup  # the same one where nothing ran before
    differences: tuple[str, ...]  # which of calibration, zero and layout say something else than before
    calibration: Calibration  # with the baselines of the zero, if there is one
    validity: Validity
    curve: StaticCurve
    wrench: WrenchEstimator
    static: StaticModel
    dynamic: DynamicFoot | None  # without a memory; None: the calibration has no effects
    watch: DeferredFaultWatch  # the same
    moved: bool  # whether taxels lie elsewhere than before

    @classmethod
    def of(cls, setup: FootSetup, before: FootSetup | None = None) -> FootPipeline:
        """Make the pipeline; `before` is the setup in use. EffectError if the calibration's effects contradict."""
        before = before or setup
        config, layout, calibration = setup.config, setup.layout, setup.zeroed_calibration
        contact = config.contact
        boards = {board.address: board for board in setup.insole.boards}
        dynamic = None
        if calibration.effects:
            dynamic = DynamicFoot(config, layout, calibration, setup.insole.boards, setup.zero is not None)
        validity = Validity(layout, boards, round(config.publish.stale_after_ms * 1e6))
        curve = StaticCurve(calibration, contact.activation_threshold_count)
        wrench = WrenchEstimator(layout, contact.min_force_n, contact.min_pressure_pa)
        return cls(
            setup=setup,
            before=before,
            differences=tuple(differences(before, setup)),
            calibration=calibration,
            validity=validity,
            curve=curve,
            wrench=wrench,
            static=StaticModel(calibration, validity, curve, wrench),
            dynamic=dynamic,
            watch=DeferredFaultWatch(FaultWatch(layout, boards)),
            moved=not np.array_equal(layout.xy_m, before.layout.xy_m),
        )
