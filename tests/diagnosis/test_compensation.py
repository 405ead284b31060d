"""A model written by hand, applied causally to a simulated walk with its effects."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.diagnosis.compensation import of_walk
from insole_daemon.physics import effects_document
from insole_daemon.physics.effect import effect
from insole_daemon.physics.effects.lag import LATE_S
from insole_daemon.simulation.conditions import Conditions, InstrumentConditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
EFFECTS = (
    effect("hysteresis", r_pa=[3e3, 1e4, 3e4], w=[0.1, 0.08, 0.06]),
    effect("viscoelasticity", a=0.15, tau_s=0.3),
    effect("lag", tau_s=0.02),
    effect("delay", delay_s=0.025),
)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return twelve seconds of walking; the shoe has the clock of the frames."""
    folder = tmp_path_factory.mktemp("walks") / "walk"
    exact = InstrumentConditions(offset_s=0.0, rate_ppm=0.0, force_noise_n=0.0, force_drift_n=0.0)
    conditions = Conditions(length_s=12.0, reference=exact)
    Trial("t4", Config(), [LAYOUT], effects={"left": EFFECTS}, conditions=conditions, seed=5).write(folder)
    return folder


def model(walk: Path, out: Path, *effects: object) -> Path:
    """Write the true curves with `effects`."""
    said = json.loads(next(walk.glob("*calibration.json")).read_text())
    said["effects"] = effects_document.document(effects, LAYOUT)  # type: ignore[arg-type]
    out.write_text(json.dumps(said))
    return out


def error_n(walk: Path, made: Path) -> float:
    """RMSE of f_z; triangles of a cycle are 10 ms old on average."""
    t_s, f_z_n = of_walk(made, walk)["left"]
    shoe = insole_daemon.load(walk)["left"].reference
    assert shoe is not None
    assert shoe.time_s is not None
    return float(np.sqrt(np.mean((f_z_n - np.interp(t_s - 0.01, shoe.time_s, shoe["fz_n"])) ** 2)))


def test_a_model_with_effects_lowers_the_error_of_a_walk(walk: Path, tmp_path: Path) -> None:
    static = error_n(walk, model(walk, tmp_path / "static.json"))
    dynamic = error_n(walk, model(walk, tmp_path / "dynamic.json", *EFFECTS))
    assert static > 60
    assert dynamic < 0.2 * static


def test_force_equals_that_of_the_daemon_and_delayed_values_have_earlier_stamps(walk: Path, tmp_path: Path) -> None:
    made = model(walk, tmp_path / "model.json", *EFFECTS)
    plain = insole_daemon.load(walk)["left"]
    t_s, _ = of_walk(made, walk)["left"]
    late_s = plain.t_ns * 1e-9 - t_s
    assert late_s == pytest.approx(0.025 + np.sqrt(0.02 * LATE_S), abs=1e-5)
    own = shutil.copytree(walk, tmp_path / "own")
    made.replace(next(own.glob("*calibration.json")))
    found = insole_daemon.load(own)["left"].wrench
    assert found is not None
    np.testing.assert_allclose(found.f_z_n, of_walk(next(own.glob("*calibration.json")), own)["left"][1])


def test_a_foot_without_model_is_left_out(walk: Path, tmp_path: Path) -> None:
    made = model(walk, tmp_path / "model.json")
    made.write_text(made.read_text().replace('"left"', '"right"'))
    assert of_walk(made, walk) == {}
