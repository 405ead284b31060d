"""`insole-trial/1`: the conditions of a trial, their effects, and problems."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import DocumentError, SimulationError
from insole_daemon.physics.effect import effect
from insole_daemon.simulation.conditions import ChamberCycles, Conditions, InstrumentConditions, TemperatureCourse, load
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.generation import MTB3
from insole_daemon.simulation.scenarios import SCENARIOS
from insole_daemon.simulation.trial import START_NS, Trial
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
ONE_FOOT = Config(insoles=Config().insoles[:1])
DOCS = Path(__file__).parents[2] / "docs" / "simulator.md"


def trial(name, **conditions):
    return Trial(name, ONE_FOOT, [LEFT], conditions=Conditions(**conditions))


def recorded(tmp_path, name, seconds=None, **conditions):
    path = trial(name, **conditions).write(tmp_path / f"{name}-{len(list(tmp_path.iterdir()))}", seconds)
    return insole_daemon.load(path)["left"]


def of(tmp_path, text):
    path = tmp_path / "trial.yaml"
    path.write_text("format: insole-trial/1\n" + text)
    return load(path)


# ---- what is chosen is what happens


def test_without_conditions_the_scenarios_values_apply(tmp_path):
    assert of(tmp_path, "") == Conditions()
    assert (tmp_path / "trial.yaml").exists()
    plain, chosen = Trial("t4", ONE_FOOT, [LEFT]), trial("t4")
    assert plain.emulator.frames(0, 0.5).data.tobytes() == chosen.emulator.frames(0, 0.5).data.tobytes()


def test_the_chamber_follows_the_chosen_cycles():
    asked = ChamberCycles(max_pressure_pa=50e3, speeds_pa_s=(5e3, 25e3), cycles=1, hold_s=12.0, minor=(0.8, 0.5, 0.8))
    one = trial("vacuum", chamber=asked)
    # 5 s of rest; 20 s and 4 s of cycles; up, hold, down, hold; 1.6 + 0.6 + 0.6 + 1.6 s of minor loops; 5 s of rest
    assert one.length_s() == pytest.approx(5 + 20 + 4 + 2 + 12 + 2 + 12 + 4.4 + 5)
    level = one.load.level_pa(np.arange(0, one.length_s(), 0.1))
    assert level.max() == pytest.approx(50e3)
    assert one.load.level_pa(np.array([15.0, 27.0, 35.0, 50.0])) == pytest.approx([50e3, 50e3, 50e3, 0.0])


def test_without_minor_loops_and_holds_there_are_none():
    one = trial("plenum", chamber=ChamberCycles(speeds_pa_s=(35e3,), cycles=2, hold_s=0.0, minor=()))
    assert one.length_s() == pytest.approx(5 + 3 * 20 + 5)


def test_mass_cadence_and_length_of_a_walk_are_applied():
    one = trial("t4", mass_kg=90.0, cadence_per_min=60.0, length_s=300.0)
    t_s = np.arange(100.0, 120.0, 0.01)
    f_z = one.load.reference("left", t_s)["fz_n"]
    assert f_z.max() == pytest.approx(1.12 * 90 * 9.81, rel=0.06)
    assert (np.diff((f_z > 0).astype(int)) == 1).sum() == 10, "strides of 2 s"
    assert one.length_s() == 300.0
    with pytest.raises(SimulationError, match="t4: seconds: expected at most 300 s.*found 301 s"):
        one.length_s(301.0)


def test_the_chosen_temperature_is_applied(tmp_path):
    course = TemperatureCourse(t_s=(0.0, 4.0, 8.0), temperature_c=(20.0, 40.0, 40.0))
    foot = recorded(tmp_path, "vacuum", 8.0, temperature=course)
    assert np.interp(2.0, foot.reference.time_s - foot.reference.time_s[0], foot.reference["temperature_c"]) == (
        pytest.approx(30.0, abs=0.1)
    )
    pads = foot.counts[:, :, 6].astype(float).mean(axis=1)
    assert pads[0] - pads[-1] == pytest.approx(50.0, abs=5.0), "2.5 counts a kelvin"


def test_the_chosen_instrument_clock_and_noise_are_applied(tmp_path):
    chosen = InstrumentConditions(rate_hz=200.0, offset_s=-1.5, rate_ppm=400.0, force_noise_n=0.0, force_drift_n=0.0)
    foot = recorded(tmp_path, "t1", 10.0, reference=chosen)
    time_s = foot.reference.time_s - START_NS * 1e-9
    assert time_s[0] == pytest.approx(-1.5, abs=1e-5)
    assert np.diff(time_s).mean() == pytest.approx(1.0004 / 200, rel=1e-5)
    exact = trial("t1").load.reference("left", np.arange(2000) / 200)["fz_n"]
    assert foot.reference["fz_n"] == pytest.approx(exact, abs=6e-4)


def test_the_chosen_generation_and_faults_are_applied():
    broken = (InjectedFault("silent", 2.0, 4.0, 6),)
    one = trial("walk", generation="mtb3", faults=broken)
    assert all(mounted.board.generation is MTB3 for mounted in one.emulator.run(0)._mounted)
    frames = one.emulator.frames(0, 6.0)
    of_board = frames.t_ns[frames.can_id >> 4 & 0xF == 6] * 1e-9
    assert not ((of_board > 2.1) & (of_board < 3.9)).any()
    assert (of_board > 4.1).any()


def test_another_take_has_other_noise_on_the_same_insole(tmp_path):
    one, again, other = (recorded(tmp_path, "t1", 1.0, take=take) for take in (0, 0, 1))
    assert (one.counts == again.counts).all()
    assert (one.counts != other.counts).any()
    assert np.array_equal(one.calibration.coefficients_pa, other.calibration.coefficients_pa, equal_nan=True)
    assert not np.array_equal(one.reference["fz_n"], other.reference["fz_n"])


# ---- the file


def test_the_documented_example_names_every_key(tmp_path):
    text = re.search(r"```yaml\n(format: insole-trial/1\n.*?)```", DOCS.read_text(), re.DOTALL).group(1)
    path = tmp_path / "trial.yaml"
    path.write_text(text)
    shown = load(path)
    keys = yaml.safe_load(text)
    for struct, documented in (
        (Conditions, keys),
        (ChamberCycles, keys["chamber"]),
        (InstrumentConditions, keys["reference"]),
    ):
        assert {field_of_struct.name for field_of_struct in fields(struct)} - {"extensions"} == set(documented) - {
            "format"
        }
    assert shown.faults[0].kind in DOCS.read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mass_kg: 5", r"mass_kg: expected a finite number from 20 to 200, found 5"),
        ("mass: 70", r'mass: unknown key: did you mean "mass_kg"'),
        ("length_s: 5", r"length_s: expected a finite number from 10 to 36000, found 5"),
        ("cadence_per_min: fast", r"cadence_per_min: expected a finite number from 40 to 160, found the text"),
        ("chamber: {max_pressure_pa: 90}", r"max_pressure_pa: expected a finite number from 1000 to 1e\+06, found 90"),
        ("chamber: {speeds_pa_s: []}", r"speeds_pa_s: expected a list of at least 1, found a list of 0"),
        ("chamber: {speeds_pa_s: [1]}", r"speeds_pa_s\[0\]: expected a finite number from 100 to 1e\+06, found 1"),
        ("chamber: {cycles: 2.5}", r"chamber.cycles: expected a whole number from 0 to 1000, found 2.5"),
        ("chamber: {minor: [1.5]}", r"minor\[0\]: expected a finite number from 0 to 1, found 1.5"),
        ("temperature: {t_s: [0, 1], temperature_c: [25]}", r"temperature: expected as many t_s as .* 2 and 1"),
        ("temperature: {t_s: [1, 0], temperature_c: [25, 26]}", r"temperature: expected t_s in rising order"),
        ("temperature: {t_s: [0], temperature_c: [300]}", r"temperature_c\[0\]: .*from -20 to 60, found 300"),
        ("reference: {rate_hz: 0}", r"reference.rate_hz: expected a finite number from 1 to 10000, found 0"),
        ("generation: mtb5", r"generation: expected one of mtb3, mtb4"),
        ("faults: [{kind: melted, t_s: 0, until_s: null, board: 5}]", r"faults\[0\].kind: expected one of loose,"),
        ("faults: [{kind: silent, t_s: 2, until_s: 1, board: 5}]", r"faults\[0\]: .*expected until_s after t_s"),
    ],
)
def test_invalid_conditions_in_a_file_are_refused(tmp_path, text, message):
    with pytest.raises(DocumentError, match=message):
        of(tmp_path, text + "\n")


def test_a_file_of_another_format_is_refused(tmp_path):
    path = tmp_path / "trial.yaml"
    path.write_text("format: insole-effects/1\neffects: []\n")
    with pytest.raises(DocumentError, match="expected insole-trial/1, found insole-effects/1"):
        load(path)


# ---- conditions that were made by hand, and those that a scenario has no use for


@pytest.mark.parametrize(
    ("name", "conditions", "message"),
    [
        ("t4", {"mass_kg": 5.0}, "conditions: mass_kg: expected a finite number from 20 to 200, found 5"),
        ("vacuum", {"chamber": ChamberCycles(minor=(2.0,))}, r"chamber.minor\[0\]: expected .* from 0 to 1, found 2"),
        ("t1", {"generation": "mtb5"}, "generation: expected one of mtb3, mtb4, found"),
        ("vacuum", {"mass_kg": 63.0}, "vacuum: mass_kg: not used, only chamber"),
        ("t1", {"cadence_per_min": 100.0}, "t1: cadence_per_min: not used"),
        ("t1", {"chamber": ChamberCycles()}, "t1: chamber: not used, only length_s, mass_kg"),
        ("walk", {"length_s": 60.0}, "walk: length_s: not used"),
        (
            "t1",
            {"reference": InstrumentConditions(pressure_noise_pa=1.0)},
            "reference.pressure_noise_pa: a shoe does not",
        ),
        (
            "plenum",
            {"reference": InstrumentConditions(force_noise_n=1.0)},
            "reference.force_noise_n: a chamber does not",
        ),
        (
            "vacuum",
            {"chamber": ChamberCycles(max_pressure_pa=2e5)},
            "max_pressure_pa: .* from 1000 to 100000 Pa in a vacuum",
        ),
        (
            "t1",
            {"faults": (InjectedFault("silent", 0.0, None, 11),)},
            r"faults\[0\].board: .* boards \[5, 6, 7\], found 11",
        ),
        ("t1", {"faults": (InjectedFault("loose", 0.0, None, 6, 2),)}, r"faults\[0\].triangle: .*of board 6.*found 2"),
    ],
)
def test_conditions_that_a_scenario_does_not_use_are_refused(name, conditions, message):
    with pytest.raises(SimulationError, match=message):
        trial(name, **conditions)


def test_a_clock_and_a_clock_effect_together_are_refused():
    effects = {"left": [effect("clock", offset_s=0.1, rate=0.0)]}
    chosen = Conditions(reference=InstrumentConditions(offset_s=0.2))
    with pytest.raises(SimulationError, match="either these or the effect clock, found both"):
        Trial("t1", ONE_FOOT, [LEFT], effects=effects, conditions=chosen)


def test_every_scenario_accepts_its_listed_conditions():
    given = {"length_s": 30.0, "mass_kg": 80.0, "cadence_per_min": 90.0, "chamber": ChamberCycles(cycles=1)}
    for name, one in SCENARIOS.items():
        Trial(name, ONE_FOOT, [LEFT], conditions=Conditions(**{key: given[key] for key in one.uses}))
