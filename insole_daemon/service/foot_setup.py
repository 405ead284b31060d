"""Layout, calibration, zero and settings of a foot, as one object that a reload replaces as a whole."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from ..config import Config, Insole
from ..errors import DocumentError, DocumentsError, InsoleError
from ..physics import calibration as calibrations
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from ..physics.dynamic import DynamicModel
from ..physics.effects_document import document
from ..physics.zero import Zero
from ..skin import layout as layouts
from ..skin.layout import Layout
from .state import zero_path


@dataclass(frozen=True, eq=False)
class FootSetup:
    """The setup of one foot, compared by identity."""

    config: Config
    insole: Insole
    layout: Layout
    calibration: Calibration  # as its file says
    zero: Zero | None
    zero_source: str  # the file, or why there is none

    @property
    def zeroed_calibration(self) -> Calibration:
        """Return the calibration, with the baselines of the zero if there is one."""
        return self.calibration if self.zero is None else zeros.apply(self.calibration, self.zero)

    def with_zero(self, zero: Zero, source: str) -> FootSetup:
        """Return the setup with another zero, read from the file `source`."""
        return replace(self, zero=zero, zero_source=source)


_READ_WITH = (
    ("calibration", ("baseline_count", "coefficients_pa", "covariance_pa2", "usable")),
    ("zero", ("baseline_count", "noise_count")),
    ("layout", ("xy_m", "taxel_area_m2")),
)


def differences(old: FootSetup, new: FootSetup) -> list[str]:
    """Return which of calibration, zero and layout differ between two setups."""
    if old is new:
        return []
    changed = []
    for what, arrays in _READ_WITH:
        before, after = getattr(old, what), getattr(new, what)
        same = all(_same(getattr(before, name, None), getattr(after, name, None)) for name in arrays)
        if same and what == "calibration":
            same = document(before.effects, old.layout) == document(after.effects, new.layout)
        if not same:
            changed.append(what)
    return changed


def _same(a: object, b: object) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=np.asarray(a).dtype.kind == "f")


def load_setups(config: Config) -> list[FootSetup]:
    """Load the setups of all feet of `config`; raises DocumentsError with the problems of all files."""
    setups: list[FootSetup] = []
    refused: list[InsoleError] = []
    for insole in config.insoles:
        try:
            setups.append(_load_setup(config, insole))
        except InsoleError as error:
            refused.append(error)
    if refused:
        raise DocumentsError(refused)
    return setups


def _load_setup(config: Config, insole: Insole) -> FootSetup:
    """Load the setup of one foot; the layout first, because calibration and zero are checked against it."""
    layout = load_layout(insole)
    refused: list[InsoleError] = []
    calibration = calibrations.default(layout, insole.boards)
    zero, source = None, ""
    try:
        if insole.calibration is not None:
            calibration = calibrations.load(insole.calibration, layout)
            # Raises if the effects contradict each other.
            DynamicModel(layout, calibration, insole.boards, 0, zeroed=False)
    except InsoleError as error:
        refused.append(error)
    try:
        zero, source = _load_zero(config, insole, layout)
    except InsoleError as error:
        refused.append(error)
    if refused:
        raise DocumentsError(refused)
    return FootSetup(config, insole, layout, calibration, zero, source)


def _load_zero(config: Config, insole: Insole, layout: Layout) -> tuple[Zero | None, str]:
    """Return the zero that the configuration names, or else the stored one, and its source."""
    named, stored = insole.zero, zero_path(config.rig, insole.foot)
    if named is not None:
        return zeros.load(named, layout), str(named)
    if not os.path.exists(stored):
        return None, "none: the calibration's baselines are in use"
    try:
        return zeros.load(stored, layout), str(stored)
    except DocumentError as error:
        # Ours, not a person's: a new layout makes it useless, and a daemon that runs can take a new one.
        why = "; ".join(str(problem) for problem in error.problems[:3])
        return None, f"none: {stored} was refused ({why}). Take a new one with 'insole zero'"


def load_layout(insole: Insole) -> Layout:
    """Return the layout that `insole` names, or the built-in approximation for its three boards."""
    if insole.layout is None:
        front, middle, rear = insole.addresses
        return layouts.builtin(insole.foot, (front, middle, rear))
    return layouts.load(insole.layout, insole.foot, insole.addresses)
