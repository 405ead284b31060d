"""Loads with the effects and curves of an insole, for the emulated boards."""

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.errors import SimulationError
from insole_daemon.physics.effect import Where, effect
from insole_daemon.simulation.foot import Walk
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.simulation.sensed import GRID_S, SensedLoad, SimulatedInsole
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
BOARDS = Config().insoles[0].boards
WALK = Walk([LEFT])
PHYSICS = (effect("creep", a=[0.05], tau_s=[0.7]), effect("hysteresis", r_pa=[3000.0], w=[0.1]))


def insole(*effects):
    return SimulatedInsole(LEFT, BOARDS, reference_insole().calibration(LEFT, BOARDS, 0), effects)


def test_without_effects_the_sensed_load_is_the_static_curve():
    t_s = np.arange(0, 300) * GRID_S
    felt = SensedLoad(WALK, [insole()]).pressure_pa("left", t_s)
    activation = felt / reference_insole().pa_per_count
    curve = insole().calibration.coefficients_pa
    back = sum(curve[..., k] * activation**k for k in range(4))
    usable = insole().calibration.usable
    assert back[:, usable] == pytest.approx(WALK.pressure_pa("left", t_s)[:, usable], abs=1e-3)
    assert not felt[:, ~usable].any()


def test_sensed_load_equals_the_chain_on_the_grid_and_is_linear_between():
    t_s = np.arange(0, 300) * GRID_S
    made = insole(*PHYSICS)
    counts = made.chain.forward()(WALK.pressure_pa("left", t_s), t_s)
    expected = np.nan_to_num(made.calibration.baseline_count - counts) * reference_insole().pa_per_count
    sensed = SensedLoad(WALK, [made])
    assert sensed.pressure_pa("left", t_s) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    between = sensed.pressure_pa("left", t_s[:-1] + GRID_S / 2)
    assert between == pytest.approx((expected[:-1] + expected[1:]) / 2, rel=1e-6, abs=1e-3)


def test_results_do_not_depend_on_earlier_requests():
    late, early = np.array([40.0, 2.5, 39.0]), np.array([0.3, 1.7])
    one, other = SensedLoad(WALK, [insole(*PHYSICS)]), SensedLoad(WALK, [insole(*PHYSICS)])
    first = one.pressure_pa("left", late), one.pressure_pa("left", early)
    second = other.pressure_pa("left", early), other.pressure_pa("left", late)
    assert (first[0] == second[1]).all()
    assert (first[1] == second[0]).all()


def test_a_long_request_equals_many_short_ones():
    t_s = np.arange(0, 90.0, 0.5)
    whole = SensedLoad(WALK, [insole(*PHYSICS)]).pressure_pa("left", t_s)
    sensed = SensedLoad(WALK, [insole(*PHYSICS)])
    assert (whole == np.concatenate([sensed.pressure_pa("left", t_s[i : i + 4]) for i in range(0, 180, 4)])).all()
    assert (whole[-1] == sensed.pressure_pa("left", t_s[-1:])[0]).all()


def test_a_wrong_shift_is_passed_to_the_boards():
    made = insole(effect("bit_shift", Where("board", ((6,),)), shift=2), effect("gain", gain=1.1))
    assert set(made.real_shifts()) == {6}
    assert set(made.real_shifts()[6].values()) == {2}
    assert len(made.real_shifts()[6]) == 5
    assert [item.law.word for item in made.chain.effects] == ["gain"]


def test_a_wrong_shift_of_a_taxel_is_refused():
    made = insole(effect("bit_shift", Where("taxel", ((6, 4, 3),)), shift=2))
    with pytest.raises(
        SimulationError, match="bit_shift: where.scope: expected insole, board or triangle, found taxel"
    ):
        made.real_shifts()
