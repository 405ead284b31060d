"""The kernel's inverse of a cycle against the dynamic model, to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.compiled import kernel
from insole_daemon.config import Config
from insole_daemon.errors import EffectError
from insole_daemon.physics import cycle_inverse
from insole_daemon.physics.calibration import default
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.cycle_inverse import CycleInverse
from insole_daemon.physics.dynamic import DynamicModel
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

LAYOUT = builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards
N = 150
RNG = np.random.default_rng(3)
SOME = Where("triangle", tuple((int(board), int(triangle)) for board, triangle in LAYOUT.identities[:9].tolist()))
TAXELS = Where(
    "taxel",
    tuple((int(b), int(t), k) for b, t in LAYOUT.identities.tolist() for k in np.flatnonzero(PRESSURE_TAXELS).tolist()),
)
VISCOELASTICITY = effect("viscoelasticity", a=0.15, tau_s=0.3)
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "a shoe": (
        effect("hysteresis", r_pa=[3e3, 1e4, 3e4], w=[0.1, 0.08, 0.06]), VISCOELASTICITY, effect("lag", tau_s=0.02),
        effect("delay", delay_s=0.025),
    ),
    "a range": (replace(VISCOELASTICITY, valid_range={"pressure_pa": (0.0, 1e5)}),),
    "nine terms": (effect("creep", a=[0.03, *[0.01] * 8], tau_s=[5.0, 60.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0, 8.0]),),
    "a power law": (effect("power_creep", a=0.05, exponent=0.2, t0_s=1.0),),
    "some triangles": (effect("hysteresis", SOME, r_pa=[3e3, 1e4], w=[0.1, 0.08]), effect("lag", SOME, tau_s=0.05)),
    "every taxel its own": (
        effect("viscoelasticity", TAXELS, a=RNG.uniform(0.05, 0.2, 280), tau_s=RNG.uniform(0.1, 1.0, 280)),
        effect("lag", TAXELS, tau_s=RNG.uniform(0.01, 0.1, 280)),
        effect("hysteresis", TAXELS, r_pa=RNG.uniform(1e3, 1e4, (2, 280)), w=RNG.uniform(0.01, 0.1, (2, 280))),
    ),
}  # fmt: skip

pytestmark = pytest.mark.skipif(
    kernel is None, reason="no kernel, see tests/test_compiled.py; 'python hatch_build.py' builds it"
)


def inverse(effects: tuple[Effect, ...], threshold_count: float = 0.0) -> CycleInverse:
    calibration = replace(default(LAYOUT, BOARDS), effects=effects)
    model = DynamicModel(LAYOUT, calibration, BOARDS, 0, zeroed=False)
    model.mask(threshold_count)
    return CycleInverse(model)


def walk(effects: tuple[Effect, ...]) -> np.ndarray:
    """Return (N, 28, 12) counts of steps of 1.1 s, with a count of noise."""
    rng = np.random.default_rng(0)
    t_s = 0.02 * np.arange(N)
    phase = t_s[:, None, None] / 1.1 + 0.3 * rng.random((28, 12))
    load_pa = np.maximum(np.sin(2 * np.pi * phase), 0.0) * rng.uniform(5e4, 3e5, (28, 12))
    counts = Chain(effects, LAYOUT, default(LAYOUT, BOARDS)).forward()(load_pa, t_s) + rng.normal(size=load_pa.shape)
    return np.clip(np.rint(np.nan_to_num(counts, nan=240.0)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("threshold_count", [0.0, 3.0])
@pytest.mark.parametrize("name", EFFECTS)
def test_the_kernel_inverts_to_the_same_bits(name, threshold_count, monkeypatch):
    compiled = inverse(EFFECTS[name], threshold_count)
    monkeypatch.setattr(cycle_inverse, "kernel", None)
    plain = inverse(EFFECTS[name], threshold_count)
    assert (compiled.is_compiled, plain.is_compiled) == (True, False)
    curve = StaticCurve(default(LAYOUT, BOARDS), threshold_count)
    rng = np.random.default_rng(5)
    times_s = np.cumsum(rng.choice([0.02, 0.0201, 0.0, 10.0], N, p=[0.5, 0.4, 0.05, 0.05]))
    monkeypatch.undo()
    for counts, t_s in zip(walk(EFFECTS[name]), times_s.tolist(), strict=True):
        valid = np.tile(PRESSURE_TAXELS, (len(LAYOUT), 1)) & (rng.random((28, 12)) > 0.05)
        one, other = (
            implementation(curve.pressure_pa(counts), counts, valid, t_s) for implementation in (compiled, plain)
        )
        assert one.pressure_pa.tobytes() == other.pressure_pa.tobytes()
        assert np.array_equal(one.beyond, other.beyond)
        assert one.beyond.any() <= (name == "a range")


@pytest.mark.parametrize(
    "effects",
    [
        (effect("gain", gain=1.1), VISCOELASTICITY),
        (effect("crosstalk", k=0.1),),
        (effect("drift", t_s=[0.0, 60.0], shift_count=[0.0, 2.0]), VISCOELASTICITY),
    ],
)
def test_effects_that_the_kernel_has_not_are_inverted_by_the_model(effects):
    assert not inverse(effects).is_compiled


def test_time_that_goes_back_is_refused():
    invert = inverse((VISCOELASTICITY,))
    arguments = np.zeros((28, 12)), np.zeros((28, 12), np.uint8), np.ones((28, 12), np.bool_)
    invert(*arguments, 2.0)
    with pytest.raises(EffectError, match="time goes back at t_s 1"):
        invert(*arguments, 1.0)
