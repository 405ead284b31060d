"""Taking a zero on the loop: what the reply says, what is stored, and what the next cycle reads."""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass, replace

import numpy as np
import pytest

from insole_daemon.config import Config, Contact
from insole_daemon.errors import InsoleError
from insole_daemon.physics import zero as zeros
from insole_daemon.service.foot import load_feet
from insole_daemon.service.foot_pipeline import FootPipeline
from insole_daemon.service.state import state_folder, zero_path
from insole_daemon.service.zeroing import zero, zero_handler
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader


@dataclass
class Step:
    now_mono_ns: int
    closed: list[Cycles]
    frames: object = None


class Ear:
    """Hears what a publisher would put."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self.standing: dict[str, object] = {}

    def publish(self, message) -> None:
        self.events.append(message.kind)

    def publish_latched(self, what, message) -> None:
        self.standing[what] = message


class Preloaded(Unloaded):
    def pressure_pa(self, foot, t_s):
        return super().pressure_pa(foot, t_s) + 16e3  # 2 counts


@pytest.fixture(autouse=True)
def state(monkeypatch, tmp_path):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    return tmp_path / "state"


def steps(feet, load, seconds=4.0):
    """The left foot's turns of the loop, as `Step`s."""
    layouts = [foot.layout for foot in feet]
    reader = SkinReader(layouts, 20_000_000, 5_000_000)
    run = Emulator(feet[0].config, layouts, load).run(0)
    while run.now_ns < seconds * 1e9:
        closed = reader.feed(run.advance(run.now_ns + 10_000_000))
        yield Step(run.now_ns, closed[0])


def done(operation, turns):
    next(operation)
    for step in turns:
        try:
            operation.send(step)
        except StopIteration as end:
            return end.value, step.now_mono_ns
        for thread in threading.enumerate():
            if thread.name == "zero":
                thread.join()  # it is stored while time passes, which here it does not
    raise AssertionError("it did not end")


def test_the_next_cycle_reads_with_it_and_a_restart_finds_it(state):
    feet = load_feet(Config())
    foot, ear = feet[0], Ear()
    turns = list(steps(feet, Preloaded([f.layout for f in feet])))
    last = turns[-1].closed or turns[-2].closed
    before = foot.messages(last[-1], 0)[2].f_z_n
    reply, ended_ns = done(zero(foot, ear, 3.0), turns)
    assert reply["ok"]
    assert reply["n_taxels"] == 280
    assert reply["shift_count"] == pytest.approx(-2, abs=0.1)
    assert reply["stored"] == str(state / "insole1-left-zero.json")
    assert 3.0e9 <= ended_ns < 3.3e9
    after = foot.messages(last[-1], 0)[2].f_z_n
    assert before > 100
    assert abs(after) < 20
    assert ear.events == ["zeroed"]
    assert ear.standing["meta"].zero["format"] == zeros.FORMAT
    assert len(ear.standing["meta"].zero["taxels"]) == 280
    assert ear.standing["meta"].decode(ear.standing["meta"].encode()).zero == ear.standing["meta"].zero
    np.testing.assert_array_equal(ear.standing["calibration"].baseline_count, foot.calibration.baseline_count)

    again = load_feet(Config())
    assert again[0].zero_source == str(state / "insole1-left-zero.json")
    np.testing.assert_allclose(again[0].calibration.baseline_count, foot.calibration.baseline_count, atol=1e-4)
    assert again[1].zero is None


def test_a_reload_that_comes_in_while_it_is_stored_is_not_undone(monkeypatch):
    feet = load_feet(Config())
    foot = feet[0]
    save, saved = zeros.save, []

    def save_and_reload(path, zero, layout):
        save(path, zero, layout)
        saved.append(path)
        if len(saved) == 1:
            contact = Contact(min_force_n=35)
            foot.replace_pipeline(
                FootPipeline.of(replace(foot.setup, config=replace(foot.config, contact=contact)), foot.setup)
            )

    monkeypatch.setattr(zeros, "save", save_and_reload)
    reply, _ = done(zero(foot, Ear(), 1.0), steps(feet, Preloaded([f.layout for f in feet])))
    assert reply["ok"]
    assert len(saved) == 2
    assert foot.zero is not None
    assert foot.meta().min_force_n == 35


def test_a_failure_to_store_a_zero_changes_nothing_and_is_reported(monkeypatch, state):
    feet = load_feet(Config())
    monkeypatch.setattr(FootPipeline, "of", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):  # the desk makes a reply of it
        done(zero(feet[0], Ear(), 1.0), steps(feet, Unloaded([f.layout for f in feet])))
    assert feet[0].zero is None
    assert not state.exists()


def test_a_zero_under_load_is_refused_and_changes_nothing(state):
    feet = load_feet(Config())
    foot, ear = feet[0], Ear()
    reply, _ = done(zero(foot, ear, 1.0), steps(feet, Stand([f.layout for f in feet])))
    assert not reply["ok"]
    assert reply["loaded"]
    assert "lift it" in reply["refusals"][0]
    assert ear.events == ["zero_refused"]
    assert ear.standing == {}
    assert foot.zero is None
    assert not state.exists()


def test_a_full_disk_is_a_refusal(state):
    state.write_text("in the way")
    feet = load_feet(Config())
    foot, ear = feet[0], Ear()
    reply, _ = done(zero(foot, ear, 1.0), steps(feet, Unloaded([f.layout for f in feet])))
    assert not reply["ok"]
    assert "cannot be written" in reply["refusals"][-1]
    assert foot.zero is None
    assert ear.events == ["zero_refused"]


def test_the_configured_zero_has_precedence_and_the_reply_states_it(tmp_path):
    feet = load_feet(Config())
    baseline = np.where(feet[0].calibration.usable, 230.0, np.nan)
    named = tmp_path / "named.json"
    zeros.save(named, zeros.Zero("left", 1, baseline, np.where(np.isnan(baseline), np.nan, 1.0)), feet[0].layout)
    config = Config()
    config = replace(config, insoles=(replace(config.insoles[0], zero=named), config.insoles[1]))
    feet = load_feet(config)
    assert feet[0].zero_source == str(named)
    assert np.nanmax(feet[0].calibration.baseline_count) == 230.0
    reply, _ = done(zero(feet[0], Ear(), 1.0), steps(feet, Unloaded([f.layout for f in feet])))
    assert reply["ok"]
    assert str(named) in reply["note"]
    assert load_feet(config)[0].zero_source == str(named)


def test_a_stored_zero_that_no_longer_fits_does_not_stop_the_daemon():
    path = zero_path("insole1", "left")
    path.parent.mkdir()
    path.write_text('{"format": "insole-zero/1", "foot": "right", "t_ns": 1, "taxels": []}')
    foot = load_feet(Config())[0]
    assert foot.zero is None
    assert "refused" in foot.zero_source
    assert "insole zero" in foot.zero_source


@pytest.mark.parametrize("request_", [{"seconds": 0.1}, {"seconds": "3"}, {"seconds": True}, {"force": 1}, {"x": 1}])
def test_a_request_that_makes_no_sense_is_refused(request_):
    with pytest.raises(InsoleError, match="zero: "):
        zero_handler(load_feet(Config())[0], Ear())(request_)


def test_where_state_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/insole:/var/lib/other")
    assert str(state_folder()) == "/var/lib/insole"
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_folder() == tmp_path / "insole"
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert state_folder() == tmp_path / "home" / ".local" / "state" / "insole"


def test_ten_minutes_of_standing_do_not_decay():
    """No baseline follows the load: what a person weighs after ten minutes is what they weighed at first."""
    feet = load_feet(Config())
    layouts = [foot.layout for foot in feet]
    config = Config(
        insoles=tuple(
            dataclasses.replace(insole, boards=tuple(replace(board, period_ms=100) for board in insole.boards))
            for insole in Config().insoles
        )
    )
    load = Stand(layouts)
    reader = SkinReader(layouts, 100_000_000, 5_000_000)
    run = Emulator(config, layouts, load).run(0)
    force_n: list[float] = []
    truth_n: list[float] = []
    while run.now_ns < 600e9:
        batch = run.advance(run.now_ns + 5_000_000_000)
        closed = Cycles.concatenate(reader.feed(batch)[0], len(layouts[0]))
        for at in range(0, len(closed), 5):  # two a second are enough
            force_n.append(feet[0].messages(closed, at)[2].f_z_n)
            truth_n.append(float(load.force_n("left", np.array([closed.t_ns[at] * 1e-9]))[0]))
    error_n = np.array(force_n) - truth_n
    first, last = error_n[:120], error_n[-120:]
    noise_n = np.hypot(first.std(), last.std()) / np.sqrt(120)
    print(
        f"error of f_z: {first.mean():.2f} N in the first minute, {last.mean():.2f} N in the tenth, ± {noise_n:.2f} N"
    )
    assert np.mean(force_n[-120:]) > 290
    assert abs(last.mean() - first.mean()) < 4 * noise_n + 0.1
