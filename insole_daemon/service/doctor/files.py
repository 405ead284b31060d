"""Checks of files: the configuration with all its errors; layout, calibration and zero of every foot."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ... import config as configs
from ...config import Config, Insole
from ...errors import DocumentError, InsoleError, Problem
from ...physics import calibration as calibrations
from ...physics import zero as zeros
from ...skin.layout import Layout
from ...wire.messages import CalibrationInUse, Meta
from ..foot_setup import load_layout
from ..state import zero_path
from .finding import CheckResult, ok, problem, warning

# Between sessions the public recordings of this insole moved by up to 5 counts, some 40 kPa (see physics.zeroing).
_OLD_ZERO_S = 86_400
RESTART = "sudo systemctl restart insole-daemon   # or end 'insole run' and start it again"


def check_configuration(path: Path | None) -> tuple[Config | None, list[CheckResult]]:
    """Return the configuration, None if it is refused, and the results."""
    if path is None:
        return Config(), [warning("config", "none named: the built-in one is looked at", "insole doctor --config FILE")]
    try:
        return configs.load(path), [ok("config", f"{path} is right")]
    except DocumentError as error:
        return None, _refused("config", error)


def check_foot(insole: Insole, rig: str, in_use: tuple[Meta, CalibrationInUse] | None) -> Iterator[CheckResult]:
    """Check the files of one foot; `in_use`: setup and calibration of the running daemon, None if there is none."""
    name = f"{insole.foot} layout"
    try:
        layout = load_layout(insole)
    except InsoleError as error:
        yield from _refused(name, error)
        return
    if layout.builtin:
        yield warning(
            name,
            "built-in: an approximation that knows nothing of this insole",
            f"insole map --out . --foot {insole.foot}   # then in config.yaml: layout: {insole.foot}-layout.yaml",
        )
    else:
        yield ok(name, f"{insole.layout}, {len(layout)} triangles")
    yield from _calibration(insole, layout, in_use)
    yield from _zero(insole, rig, layout, in_use)


def _calibration(insole: Insole, layout: Layout, in_use: tuple[Meta, CalibrationInUse] | None) -> Iterator[CheckResult]:
    name = f"{insole.foot} calibration"
    try:
        if insole.calibration is None:
            calibration = calibrations.default(layout, insole.boards)
        else:
            calibration = calibrations.load(insole.calibration, layout)
    except InsoleError as error:
        yield from _refused(name, error)
        return
    if in_use is not None and not np.array_equal(
        in_use[1].coefficients_pa, calibration.coefficients_pa, equal_nan=True
    ):
        yield warning(name, f"the daemon that runs applies another one: {in_use[1].source}", RESTART)
    if insole.calibration is None:
        yield warning(
            name,
            "built-in: 8 kPa a count for every taxel, good for a first look only",
            f"config.yaml, at the {insole.foot} foot: calibration: FILE",
        )
    else:
        age = _age(time.time() - insole.calibration.stat().st_mtime)
        yield ok(name, f"{insole.calibration}, {int(calibration.usable.sum())} taxels, written {age}")


def _zero(
    insole: Insole, rig: str, layout: Layout, in_use: tuple[Meta, CalibrationInUse] | None
) -> Iterator[CheckResult]:
    name, take = f"{insole.foot} zero", f"insole zero --foot {insole.foot}"
    if in_use is not None:  # the daemon may be another user's, whose files this user may not read
        meta = in_use[0]
        source, t_ns = meta.zero_source, meta.zero["t_ns"] if meta.zero is not None else None
    else:
        path = insole.zero if insole.zero is not None else zero_path(rig, insole.foot)
        source, t_ns = str(path), None
        if insole.zero is not None or path.exists():
            try:
                t_ns = zeros.load(path, layout).t_ns
            except InsoleError as error:
                yield from _refused(name, error)
                return
    if t_ns is None:
        yield warning(name, "none was taken: the calibration's baselines are in use", take)
        return
    age_s = time.time() - t_ns * 1e-9
    if age_s < 0:
        yield warning(name, f"{source}: taken in the future: the clock was wrong then, or is now", take)
    elif age_s > _OLD_ZERO_S:
        yield warning(name, f"{source}: taken {_age(age_s)}: readings drift by some counts from day to day", take)
    else:
        yield ok(name, f"{source}, taken {_age(age_s)}")


def _refused(subject: str, error: InsoleError) -> list[CheckResult]:
    """Return a result for each problem of a file."""
    if not isinstance(error, DocumentError):
        return [problem(subject, str(error), "correct the configuration")]
    return [problem(subject, defect.message, _edit(error.path, defect)) for defect in error.problems]


def _edit(path: str, wrong: Problem) -> str:
    if not wrong.key:
        return f"correct {path}, or name another file"
    return f"edit {path}" + (f", line {wrong.line}" if wrong.line else "") + f": {wrong.key}"


def _age(age_s: float) -> str:
    for unit, length_s in (("days", 86_400), ("hours", 3600), ("minutes", 60)):
        if age_s >= 2 * length_s:
            return f"{age_s / length_s:.0f} {unit} ago"
    return "just now" if age_s < 60 else "a minute ago"
