"""`insole map` against emulated boards, on a clock of their own: no time is waited for."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
import typer

from insole_daemon.bus import recovering
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.link import InterfaceChange
from insole_daemon.bus.source import BusCounters
from insole_daemon.cli import map as verb
from insole_daemon.config import Config
from insole_daemon.errors import BusError
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin import layout as layouts

TEMPLATES = [layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))]


class Finger(Unloaded):
    """Presses the triangle (foot, row) from a moment on for a second."""

    def __init__(self, truth) -> None:
        super().__init__(truth)
        self.press = ("left", 0, -10.0)
        self._rows = {}
        for layout in truth:
            for row, t in enumerate(layout.triangles):
                number = 1 + sum(other.patch == t.patch for other in layout.triangles[:row])
                self._rows[layout.foot, t.patch, number] = row

    def obey(self, line: str, now_s: float) -> None:
        """Press the position that a printed line asks for, if it asks for one."""
        match = re.search(r"press the middle of (\w+) foot, (\w+) patch, position (\d+)", line)
        if match:
            self.press = (match[1], self._rows[match[1], match[2], int(match[3])], now_s + 0.3)

    def pressure_pa(self, foot, t_s):
        pressure = super().pressure_pa(foot, t_s)
        own, row, begin = self.press
        if own == foot:
            pressure[(t_s > begin) & (t_s < begin + 0.8), row] = 100e3
        pressure[..., [6, 10]] = 0
        return pressure


class Source:
    """The frames of `run`, whose clock goes on when it is waited for."""

    interfaces = ("can0",)
    exhausted = False
    counters = BusCounters()

    def __init__(self, run) -> None:
        self._run, self._held = run, FrameBatch.empty()
        self.closed = False

    def receive(self) -> int:
        return len(self._held)

    def drain(self) -> FrameBatch:
        held, self._held = self._held, FrameBatch.empty()
        return held

    def wait(self, timeout_s: float) -> None:
        self._held = FrameBatch.concatenate(
            [self._held, self._run.advance(self._run.now_ns + max(1, round(timeout_s * 1e9)))]
        )

    def clock_ns(self) -> int:
        return self._run.now_ns

    def changes(self) -> list[InterfaceChange]:
        return []

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def person(monkeypatch, capsys):
    """Boards with a random assignment within each foot, and somebody who does as told; (truth, source)."""
    draw = np.random.default_rng(3)
    truth = []
    for template in TEMPLATES:
        slots = draw.permutation(len(template))
        own = [template.triangles[slot] for slot in slots]
        truth.append(
            layouts.assigned(
                template,
                tuple(
                    dataclasses.replace(t, board=other.board, triangle=other.triangle)
                    for t, other in zip(template.triangles, own, strict=True)
                ),
            )
        )
    finger = Finger(truth)
    source = Source(Emulator(Config(), truth, finger).run(0))

    def listen(text: str) -> None:
        finger.obey(text, source.clock_ns() * 1e-9)
        print(text)

    monkeypatch.setattr(verb, "_print_line", listen)
    monkeypatch.setattr("time.sleep", source.wait)
    monkeypatch.setattr(verb, "on_end", lambda stop: None)
    monkeypatch.setattr(recovering, "RecoveringSource", lambda buses: source)
    return truth, source


def test_both_feet_in_one_pass(person, tmp_path, capsys):
    truth, source = person
    verb.map_(tmp_path, verb.Which.both, None, None, 15.0)
    stdout = capsys.readouterr().out
    assert stdout.count("press the middle of") == 56
    assert "[56/56]" in stdout
    assert "28 of 28 positions" in stdout
    assert "nothing missing, doubled or swapped" in stdout
    assert "[●]" in stdout
    for layout in truth:
        back = layouts.load(tmp_path / f"{layout.foot}-layout.yaml", layout.foot)
        np.testing.assert_array_equal(back.identities, layout.identities)
    assert source.closed


def test_one_foot_with_the_layout_of_a_file_as_template(person, tmp_path):
    assert person
    given = tmp_path / "template.yaml"
    layouts.write(given, TEMPLATES[1])
    verb.map_(tmp_path / "out", verb.Which.right, None, given, 15.0)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["right-layout.yaml"]


def test_a_silent_bus_is_reported_and_nothing_is_written(monkeypatch, tmp_path):
    run = Emulator(Config(), TEMPLATES, Unloaded(TEMPLATES), streaming=False).run(0)
    source = Source(run)
    monkeypatch.setattr("time.sleep", source.wait)
    monkeypatch.setattr(verb, "on_end", lambda stop: None)
    monkeypatch.setattr(recovering, "RecoveringSource", lambda buses: source)
    with pytest.raises(BusError, match="no board sends"):
        verb.map_(tmp_path / "out", verb.Which.left, None, None, 15.0)
    assert not (tmp_path / "out").exists()


def test_without_a_press_the_command_reports_it_and_writes_no_file(person, monkeypatch, tmp_path):
    monkeypatch.setattr(verb, "_print_line", lambda text: None)
    with pytest.raises(typer.Exit) as end:
        verb.map_(tmp_path / "out", verb.Which.left, None, None, 1.0)
    assert end.value.exit_code == 1
    assert not (tmp_path / "out").exists()
