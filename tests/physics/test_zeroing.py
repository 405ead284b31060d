"""A zero is measured on emulated boards, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics import zero as zeros
from insole_daemon.physics.zeroing import MIN_READINGS, Zeroing, ZeroOutcome
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader
from insole_daemon.skin.validity import Validity

CONFIG = Config()
LAYOUTS = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]
LEFT = LAYOUTS[0]
BOARDS = {board.address: board for board in CONFIG.insoles[0].boards}
DEFAULT = calibrations.default(LEFT, CONFIG.insoles[0].boards)


def cycles(load, seconds: float = 3.0, **emulator) -> Cycles:
    reader = SkinReader(LAYOUTS, 20_000_000, 5_000_000)
    frames = Emulator(CONFIG, LAYOUTS, load, **emulator).frames(1_000_000_000, seconds)
    return Cycles.concatenate(reader.feed(frames)[0], len(LEFT))


def take_zero(measured: Cycles, force: bool = False, calibration=DEFAULT) -> ZeroOutcome:
    zeroing = Zeroing(LEFT, calibration, Validity(LEFT, BOARDS, 200_000_000))
    for at in range(0, len(measured), 7):  # as in the loop: a few at a time
        zeroing.add(Cycles(*(getattr(measured, name)[at : at + 7] for name in Cycles.__slots__)))
    return zeroing.outcome(5, force)


class Pressed(Unloaded):
    """A shoe that presses every taxel evenly, after the boards were zeroed without it."""

    def __init__(self, pressure_pa: float, triangles=slice(None)) -> None:
        super().__init__(LAYOUTS)
        self._pa, self._triangles = pressure_pa, triangles

    def pressure_pa(self, foot, t_s):
        pressure = super().pressure_pa(foot, t_s)
        pressure[:, self._triangles] = self._pa
        pressure[..., [6, 10]] = 0
        return pressure


class Stretched(Stand):
    """The same load with another force."""

    def __init__(self, newton: float) -> None:
        super().__init__(LAYOUTS, body_mass_kg=2 * newton / 9.81)


def test_an_unloaded_foot_is_zeroed_to_a_fifth_of_a_count():
    out = take_zero(cycles(Unloaded(LAYOUTS)))
    assert out.refusals == ()
    assert out.zero is not None
    listed = ~np.isnan(out.zero.baseline_count)
    assert listed.sum() == 280
    # what the boards rest at: no_load + (1 − 2^−shift)/2
    assert np.abs(out.zero.baseline_count[listed] - 240.4375).max() < 0.4
    assert abs(out.shift_count) < 0.02
    assert 0.8 < out.noise_count < 1.1


def test_slow_boards_count_their_readings_once():
    measured = cycles(Unloaded(LAYOUTS))
    doubled = Cycles(*(np.repeat(getattr(measured, name), 2, axis=0) for name in Cycles.__slots__))
    once, twice = take_zero(measured), take_zero(doubled)
    np.testing.assert_allclose(once.zero.noise_count, twice.zero.noise_count)


@pytest.mark.parametrize("newton", [200, 309, 490])
def test_standing_is_refused_with_the_taxels(newton):
    out = take_zero(cycles(Stretched(newton)))
    assert out.zero is None
    assert "the foot is loaded at" in out.refusals[0]
    assert {board for board, _, _ in out.loaded} >= {7}, "the heel"
    assert 10 <= len(out.loaded) <= 200
    assert out.noisy == ()


def test_walking_is_refused():
    out = take_zero(cycles(Walk(LAYOUTS)))
    assert out.zero is None
    assert any("moves" in reason for reason in out.refusals)
    assert len(out.noisy) > 50


def test_force_accepts_a_loaded_foot_and_still_reports_it():
    out = take_zero(cycles(Stretched(309)), force=True)
    assert out.zero is not None
    assert out.refusals
    assert out.loaded


@pytest.mark.parametrize("kpa", [10, 20, 40])
def test_an_evenly_strapped_shoe_becomes_part_of_the_zero(kpa):
    out = take_zero(cycles(Pressed(kpa * 1e3)))
    assert out.zero is not None
    assert out.shift_count == pytest.approx(-kpa / 8, rel=0.04, abs=0.1)  # taxels are not alike


def test_one_triangle_is_refused_only_above_the_higher_limit():
    assert take_zero(cycles(Pressed(56e3, [3]))).zero is not None, "7 counts: seen in unloaded public recordings"
    assert take_zero(cycles(Pressed(100e3, [3]))).zero is None
    assert take_zero(cycles(Pressed(56e3, [3, 4]))).zero is None


def test_uniform_pressure_and_saturation_are_refused():
    assert take_zero(cycles(Pressed(100e3))).zero is None
    out = take_zero(cycles(Pressed(2.5e6, [0, 1])))
    assert out.zero is None
    assert {taxel[:2] for taxel in out.loaded} == {(5, 0), (5, 1)}


def test_a_zero_under_load_can_be_replaced_after_lifting():
    standing = take_zero(cycles(Stretched(309)), force=True)
    calibration = zeros.apply(DEFAULT, standing.zero)
    out = take_zero(cycles(Unloaded(LAYOUTS)), calibration=calibration)
    assert out.refusals == ()
    assert out.largest_shift_count > 5


def test_missing_and_loose_triangles_are_left_out_and_named():
    measured = cycles(Unloaded(LAYOUTS), left_out=(6,))
    measured.status[:, 2] = 2  # an open triangle
    out = take_zero(measured)
    assert out.zero is not None
    assert {taxel[:2] for taxel in out.left_out["no data"]} == {(6, t) for t in (4, 5, 6, 7, 15)}
    assert {taxel[:2] for taxel in out.left_out["invalid readings"]} == {(5, 4)}
    assert np.isnan(out.zero.baseline_count[2]).all()


def test_too_few_readings_are_refused():
    out = take_zero(cycles(Unloaded(LAYOUTS), seconds=0.02 * (MIN_READINGS - 3)))
    assert out.zero is None
    assert "insole status" in out.refusals[0]
    assert take_zero(cycles(Unloaded(LAYOUTS), seconds=0.1), force=True).zero is None, "force adds no readings"


def test_no_readings_are_refused():
    none = Cycles.concatenate([], len(LEFT))
    assert take_zero(none).zero is None
