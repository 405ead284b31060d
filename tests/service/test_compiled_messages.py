"""The kernel's payloads of a cycle against those of `Foot.values` and `Message.encode`, byte by byte."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from insole_daemon.compiled import kernel
from insole_daemon.config import Config, Contact
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.service import foot as foot_module
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import FootSetup, load_setups
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.foot import Walk
from insole_daemon.skin.cycles import ClosedCycle
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Pressure, Raw, Wrench

START_NS = 1_700_000_000_000_000_000
SETUP = load_setups(Config(contact=Contact(activation_threshold_count=2.0)))[0]
TRIANGLE = SETUP.layout.triangles[11]
TWO = tuple((int(board), int(triangle)) for board, triangle in SETUP.layout.identities[[2, 17]].tolist())
FAULTS = {
    "none": [],
    "loose": [InjectedFault("loose", 1.0, None, TRIANGLE.board, TRIANGLE.triangle, chance=0.5)],
    "silent": [InjectedFault("silent", 1.0, 2.0, TRIANGLE.board)],
    "stuck": [InjectedFault("stuck", 1.0, None, TRIANGLE.board, TRIANGLE.triangle, 3)],
}

pytestmark = pytest.mark.skipif(
    kernel is None, reason="no kernel, see tests/test_compiled.py; 'python hatch_build.py' builds it"
)


def closed(faults: Sequence[InjectedFault], seconds: float = 4.0) -> list[ClosedCycle]:
    """Cycles as the kernel closes them; a second of silence at their end repeats the last."""
    frames = Emulator(Config(), [SETUP.layout], Walk([SETUP.layout], seed=5), seed=5, faults=faults)
    reader = SkinReader([SETUP.layout], 20_000_000, 5_000_000)
    batch = frames.frames(START_NS, seconds)
    (cycles,) = reader.closed_cycles(batch)
    return cycles + reader.cycles_closed_by_time(int(batch.t_mono_ns[-1]) + 1_000_000_000)[0]


def compare(setup: FootSetup, cycles: list[ClosedCycle]) -> Foot:
    """Both ways on one foot each; the one of the kernel."""
    compiled, plain = Foot(setup), Foot(setup)
    changes: list[list[str]] = [[], []]
    for cycle in cycles:
        assert cycle.record is not None
        payloads, load = compiled.payloads(cycle)
        values = plain.values(*cycle.row)
        assert list(payloads) == values.payloads()
        assert (load.t_ns, load.repeated) == (values.load.t_ns, values.load.repeated)
        assert np.array_equal(load.f_z_n, values.load.f_z_n, equal_nan=True)
        assert np.array_equal(load.pressure_pa, values.load.pressure_pa, equal_nan=True)
        assert np.array_equal(load.valid, values.load.valid)
        for foot, texts in zip((compiled, plain), changes, strict=True):
            texts += [event.text for event in foot.fault_events()]
    assert changes[0] == changes[1]
    counters = [(foot.seq, foot.extrapolated, foot.beyond) for foot in (compiled, plain)]
    assert counters[0] == counters[1]
    assert compiled.faults() == plain.faults()
    return compiled


@pytest.fixture(autouse=True)
def still_clock(monkeypatch):
    monkeypatch.setattr(foot_module, "time", SimpleNamespace(time_ns=lambda: START_NS))


@pytest.mark.parametrize("kind", FAULTS)
def test_payloads_of_the_kernel_equal_those_of_numpy(kind):
    cycles = closed(FAULTS[kind])
    assert {cycle.is_repeated for cycle in cycles} == {True, False}
    assert any(cycle.is_late for cycle in cycles)
    foot = compare(SETUP, cycles)
    if kind == "loose":
        assert "triangle_loose" in {fault["kind"] for fault in foot.faults()}


def test_payloads_are_equal_with_an_uncertain_calibration_and_one_that_lists_few_taxels():
    calibration = SETUP.calibration
    usable = calibration.usable.copy()
    usable[3:9, ::2] = False
    n_coefficients = calibration.coefficients_pa.shape[-1]
    covariance_pa2 = np.broadcast_to(np.eye(n_coefficients) * 9.0, (*usable.shape, n_coefficients, n_coefficients))
    uncertain = replace(calibration, usable=usable, covariance_pa2=covariance_pa2.copy())
    compare(replace(SETUP, calibration=uncertain), closed([], 1.0))


EFFECTS: dict[str, tuple[Effect, ...]] = {
    "a shoe": (
        effect("hysteresis", r_pa=[3e3, 1e4, 3e4], w=[0.1, 0.08, 0.06]),
        replace(effect("viscoelasticity", a=0.15, tau_s=0.3), valid_range={"pressure_pa": (0.0, 6e4)}),
        effect("lag", tau_s=0.02),
        effect("delay", delay_s=0.025),
    ),
    "taxels that differ": (
        effect("creep", Where("triangle", TWO), a=[0.03, 0.02], tau_s=[5.0, 60.0]),
        effect("power_creep", a=0.05, exponent=0.2, t0_s=1.0),
        effect("map_transform", x_mm=2.0, y_mm=-1.0, rotation_deg=3.0, scale=1.0),
    ),
    "none that the kernel has": (effect("crosstalk", k=0.1), effect("lag", tau_s=0.04)),
    "triangles that lag": (effect("lag", Where("triangle", TWO[:1]), tau_s=0.04),),
}


@pytest.mark.parametrize("model", ["dynamic", "static"])
@pytest.mark.parametrize("name", EFFECTS)
def test_payloads_of_both_models_are_equal(name, model):
    insole = replace(SETUP.insole, model=model)
    calibration = replace(SETUP.calibration, effects=EFFECTS[name])
    foot = compare(replace(SETUP, insole=insole, calibration=calibration), closed(FAULTS["loose"]))
    assert foot.model == model
    assert (foot.beyond > 0) == (name == "a shoe" and model == "dynamic")


def test_messages_packed_by_the_compiled_kernel_can_be_decoded():
    foot, cycle = Foot(SETUP), closed([], 1.0)[30]
    for kind, payload in foot.payloads(cycle).payloads:
        message = kind.decode(payload)
        assert isinstance(message, Raw | Pressure | Wrench)
        assert (message.seq, message.t_published_ns) == (0, START_NS)
