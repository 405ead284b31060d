"""A foot whose calibration has effects: what is published by which model, what is remembered, and the switch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from insole_daemon.config import Config, Contact
from insole_daemon.errors import InsoleError
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.physics.zero import Zero
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_pipeline import FootPipeline
from insole_daemon.service.foot_setup import FootSetup, load_setups
from insole_daemon.service.operations import Step
from insole_daemon.service.switching import model_handler
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.layout import builtin
from insole_daemon.wire.messages import Event, Meta

LAYOUT = builtin("left", (5, 6, 7))
PERIOD_NS = 20_000_000
EFFECTS = (
    effect("viscoelasticity", a=0.3, tau_s=0.5),
    effect("delay", delay_s=0.03),
)
STATIC = load_setups(Config())[0]
SETUP = replace(STATIC, calibration=replace(STATIC.calibration, effects=EFFECTS))
N = 60
LOAD_PA = np.where(np.arange(N) > 10, 120e3, 0.0)[:, None, None] * np.ones((1, len(LAYOUT), 12))


def read(load_pa: np.ndarray, *effects: Effect) -> np.ndarray:
    t_s = 0.02 * np.arange(len(load_pa))
    exact_counts = Chain(effects, LAYOUT, STATIC.calibration).forward()(load_pa, t_s)
    return np.nan_to_num(np.rint(exact_counts), nan=240).astype(np.uint8)


def cycles(counts: np.ndarray, first: int = 0) -> Cycles:
    n = len(counts)
    wide, flags = np.zeros((n, len(LAYOUT)), np.int64), np.zeros(n, bool)
    t_ns = PERIOD_NS * np.arange(first, first + n)
    return Cycles(
        5 + t_ns, 10**18 + t_ns, counts, wide.astype(np.uint16), wide, wide, wide + 2 * np.arange(n)[:, None],
        wide > 0, flags, flags,
    )  # fmt: skip


COUNTS = read(LOAD_PA, EFFECTS[0])


def force_n(foot: Foot, first: int, last: int) -> list[float]:
    closed = cycles(COUNTS)
    return [foot.messages(closed, at)[2].f_z_n or 0.0 for at in range(first, last)]


def test_without_effects_there_is_one_model() -> None:
    foot = Foot(STATIC)
    _, pressure, wrench, models = foot.messages(cycles(COUNTS), 20)
    assert (foot.model, models, pressure.model, wrench.model) == ("static", None, "static", "static")
    assert foot.meta().effects == []
    assert foot.meta().late_ms.tolist() == [0.0] * len(LAYOUT)


def test_the_published_load_has_its_own_time_and_both_models_are_reported() -> None:
    foot, plain = Foot(SETUP), Foot(STATIC)
    closed = cycles(COUNTS)
    for at in range(N):
        raw, pressure, wrench, both = foot.messages(closed, at)
        static = plain.messages(closed, at)[2]
        assert both is not None
        assert (pressure.model, wrench.model, both.model) == ("dynamic",) * 3
        assert wrench.t_ns == pressure.t_ns == both.dynamic_t_ns == raw.t_ns - 30_000_000
        assert (both.seq, both.static_t_ns, both.static_f_z_n) == (wrench.seq, raw.t_ns, static.f_z_n)
        assert (both.dynamic_f_z_n, both.dynamic_m_y_nm) == (wrench.f_z_n, wrench.m_y_nm)
        np.testing.assert_array_equal(both.dynamic_pressure_pa, pressure.pressure_pa)
        if at > 12:
            load_n = 120e3 * 280 * LAYOUT.taxel_area_m2
            assert wrench.f_z_n == pytest.approx(load_n, rel=0.1), "whole counts of 8 kPa"
            assert at > 20 or (static.f_z_n or 0.0) < 0.85 * load_n


def test_memory_state_survives_a_reload_unless_effects_or_zero_changed() -> None:
    kept, again, zeroed = Foot(SETUP), Foot(SETUP), Foot(SETUP)
    before = [force_n(foot, 0, 20) for foot in (kept, again, zeroed)]
    assert before[0] == before[1] == before[2]
    config = replace(SETUP.config, contact=Contact(min_force_n=35))
    kept.replace_pipeline(FootPipeline.of(replace(SETUP, config=config, calibration=replace(SETUP.calibration)), SETUP))
    other = replace(SETUP.calibration, effects=(effect("viscoelasticity", a=0.3, tau_s=0.4), EFFECTS[1]))
    again.replace_pipeline(FootPipeline.of(replace(SETUP, calibration=other), SETUP))
    rest = np.where(SETUP.calibration.usable, SETUP.calibration.baseline_count, np.nan)
    zeroed.replace_pipeline(FootPipeline.of(SETUP.with_zero(Zero("left", 1, rest, 0.0 * rest), "a test"), SETUP))
    whole = force_n(Foot(SETUP), 0, 21)[-1]
    static = force_n(Foot(STATIC), 20, 21)[0]
    assert force_n(kept, 20, 21)[0] == whole
    assert force_n(again, 20, 21)[0] == pytest.approx(static)  # settled at what presses now
    assert force_n(zeroed, 20, 21)[0] == pytest.approx(static)
    assert kept.meta().min_force_n == 35


def test_both_remember_whichever_is_published() -> None:
    foot = Foot(SETUP)
    foot.switch("static")
    first = force_n(foot, 0, 20)
    assert first == force_n(Foot(STATIC), 0, 20)
    foot.switch("dynamic")
    assert force_n(foot, 20, 21) == force_n(Foot(SETUP), 0, 21)[-1:]


def test_the_configuration_chooses_and_changes_the_choice_only_where_it_changes() -> None:
    def with_model(model: Any) -> FootSetup:
        return replace(SETUP, insole=replace(SETUP.insole, model=model))

    foot = Foot(with_model("static"))
    assert foot.model == "static"
    foot.switch("dynamic")
    foot.replace_pipeline(FootPipeline.of(with_model("static"), foot.setup))
    assert foot.model == "dynamic"
    foot.replace_pipeline(FootPipeline.of(with_model("dynamic"), foot.setup))
    foot.replace_pipeline(FootPipeline.of(with_model("static"), foot.setup))
    assert foot.model == "static"


def test_loads_beyond_the_identified_range_are_marked_and_counted() -> None:
    limited = replace(EFFECTS[0], valid_range={"pressure_pa": (0.0, 1e5)})
    foot = Foot(replace(SETUP, calibration=replace(SETUP.calibration, effects=(limited,))))
    closed = cycles(COUNTS)
    shares = [foot.messages(closed, at)[2].beyond_fraction for at in range(N)]
    assert set(shares[:11]) == {0.0}
    assert shares[-1] == 1.0
    assert foot.beyond == sum(share > 0 for share in shares)
    foot.switch("static")
    _, _, wrench, models = foot.messages(cycles(COUNTS[-1:], N), 0)
    assert wrench.beyond_fraction == 0.0
    assert models is not None
    assert models.beyond.any()


class Ear:
    def __init__(self) -> None:
        self.events: list[Event] = []
        self.standing: list[Meta] = []

    def publish(self, message: Event) -> None:
        self.events.append(message)

    def publish_latched(self, what: str, message: Any) -> None:
        assert what == "meta"
        self.standing.append(message)


def asked(foot: Foot, ear: Ear, request: dict[str, Any]) -> dict[str, Any]:
    operation = model_handler(foot, ear)(request)
    next(operation)
    with pytest.raises(StopIteration) as done:
        operation.send(Step(0, [], None, 0))  # type: ignore[arg-type]
    reply: dict[str, Any] = done.value.value
    return reply


def test_the_switch_replies_with_the_models_and_the_one_in_use() -> None:
    foot, ear = Foot(SETUP), Ear()
    reply = asked(foot, ear, {"do": "tell"})
    assert (reply["model"], reply["late_ms"], ear.events) == ("dynamic", 30.0, [])
    assert [entry["effect"] for entry in reply["effects"]] == ["viscoelasticity", "delay"]
    assert asked(foot, ear, {"do": "static"})["model"] == "static"
    assert (foot.model, ear.standing[-1].model, ear.events[-1].kind) == ("static", "static", "model_switched")


@pytest.mark.parametrize("request_map", [{}, {"do": "off"}, {"do": "static", "seconds": 3}])
def test_the_switch_refuses_an_unknown_model(request_map: dict[str, Any]) -> None:
    with pytest.raises(InsoleError, match="one of tell, static, dynamic"):
        asked(Foot(SETUP), Ear(), request_map)


def test_there_is_nothing_to_switch_without_effects() -> None:
    operation = model_handler(Foot(STATIC), Ear())({"do": "dynamic"})
    next(operation)
    with pytest.raises(InsoleError, match="has no effects"):
        operation.send(Step(0, [], None, 0))  # type: ignore[arg-type]
