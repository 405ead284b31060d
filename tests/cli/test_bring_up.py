"""`insole bring-up` against emulated boards and a person who does as asked, on a clock of their own."""

from __future__ import annotations

import dataclasses
import re

import pytest
import typer

from insole_daemon.bus import recovering
from insole_daemon.cli import bring_up as verb
from insole_daemon.cli import map as mapping
from insole_daemon.config import Config
from insole_daemon.recording import recorder  # before the source is replaced: it asks for the type of the real one
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.skin import layout as layouts

from .test_map import TEMPLATES, Finger, Source

CONFIG = Config()
RECORDED_S = 4.0  # instead of a minute
GENERATIONS = pytest.mark.parametrize("generation", ["mtb3", "mtb4"])
STAND_PA = 75e3  # on every taxel of one foot: some 700 N


class Person(Finger):
    """Presses one triangle after the other, and stands on the foot that is asked for."""

    def __init__(self, truth) -> None:
        super().__init__(truth)
        self.stands_on = ""

    def pressure_pa(self, foot, t_s):
        pressure = super().pressure_pa(foot, t_s)
        if foot == self.stands_on:
            pressure = pressure + STAND_PA
            pressure[..., [6, 10]] = 0
        return pressure


@pytest.fixture
def set_up(monkeypatch, tmp_path):
    """Call it with the layouts as the insoles are really wired, and how the boards are; runs bring-up to its end.

    `steps` are words of the questions that the person says yes to.
    """
    monkeypatch.chdir(tmp_path)

    def run(
        truth=TEMPLATES, played=CONFIG, generation="mtb4", config=None, steps="press|zero|stand", **boards
    ) -> tuple[int, str]:
        person = Person(truth)
        source = Source(Emulator(played, truth, person, generation=generation, **boards).run(0))

        def listen(text: str) -> None:
            person.obey(text, source.clock_ns() * 1e-9)

        def asked(question: str) -> bool:
            stands = re.search(r"stand on the (\w+) foot", question)
            person.stands_on = stands[1] if stands else ""
            return re.search(steps, question) is not None

        monkeypatch.setattr(mapping, "_print_line", listen)
        monkeypatch.setattr(verb, "_confirm_step", asked)
        monkeypatch.setattr(verb, "_check_interfaces", lambda settings: [])  # no kernel has the interface of this bus
        monkeypatch.setattr(verb, "on_end", lambda stop: None)
        monkeypatch.setattr("time.sleep", source.wait)
        monkeypatch.setattr("time.monotonic", lambda: source.clock_ns() * 1e-9)
        monkeypatch.setattr("time.monotonic_ns", source.clock_ns)
        assert recorder.RecoveringSource
        monkeypatch.setattr(recovering, "RecoveringSource", lambda buses: source)
        monkeypatch.setattr(run, "took_s", lambda: source.clock_ns() * 1e-9, raising=False)
        status = 0
        try:
            verb.bring_up(config, verb.Which.both, tmp_path / "out", 70.0, RECORDED_S)
        except typer.Exit as end:
            status = end.exit_code
        return status, (tmp_path / "out" / "report.md").read_text()

    return run


@pytest.fixture
def few_triangles(tmp_path):
    """A configuration whose layouts have three triangles of every patch: a person presses those alone."""
    lines = ["format: insole-config/1", "buses: [socketcan:can0]", "insoles:"]
    for insole, layout in zip(CONFIG.insoles, TEMPLATES, strict=True):
        of_patch = {t.patch: [each for each in layout.triangles if each.patch == t.patch] for t in layout.triangles}
        few = tuple(t for own in of_patch.values() for t in own[:3])
        layouts.write(tmp_path / f"few-{insole.foot}.yaml", dataclasses.replace(layout, triangles=few), "")
        lines += [f"  - foot: {insole.foot}", f"    layout: few-{insole.foot}.yaml", "    boards:"]
        lines += [f"      - {{address: {board.address}, interface: can0}}" for board in insole.boards]
    (tmp_path / "config.yaml").write_text("\n".join(lines) + "\n")
    return tmp_path / "config.yaml"


def rewired(foot_boards: dict[str, dict[int, int]]) -> list[layouts.Layout]:
    """The built-in layouts with other boards at their patches."""
    return [
        layouts.assigned(
            layout,
            tuple(
                dataclasses.replace(t, board=foot_boards[layout.foot].get(t.board, t.board)) for t in layout.triangles
            ),
        )
        for layout in TEMPLATES
    ]  # fmt: skip


def test_a_right_set_up_passes_every_step_within_5_minutes_and_leaves_a_report(set_up, tmp_path):
    status, report = set_up()
    assert status == 0, report
    assert set_up.took_s() + 60 - RECORDED_S < 300, "with a person who presses 0.3 s after being asked, for 0.8 s"
    assert "**0 problems.**" in report
    for step in ("Boards", "Mapping", "Zero", "Recording", "Force"):
        section = report.partition(f"## {step}\n")[2].partition("\n## ")[0]
        assert "- ok" in section or "- warning" in section, f"{step}: {section}"
        assert "Not done" not in section
    assert re.search(r"left recording: good: \d+ of \d+ cycles", report)
    assert "the body weighs 687 N" in report
    assert "thermal pads at" in report
    assert (tmp_path / "out" / "recording" / "recording.yaml").exists()
    assert (tmp_path / "out" / "left-layout.yaml").exists()


@GENERATIONS
def test_swapped_patches_are_named(generation, set_up, few_triangles):
    wired = rewired({"left": {5: 7, 7: 5}, "right": {}})
    status, report = set_up(wired, generation=generation, config=few_triangles, steps="press")
    assert status == 1
    assert re.search(r"problem: left foot: patches are swapped: at the \w+ patch board \d answers", report)
    assert "layout: left-layout.yaml" in report


@GENERATIONS
def test_left_and_right_exchanged_are_named(generation, set_up, few_triangles):
    exchanged = {"left": {5: 8, 6: 9, 7: 10}, "right": {8: 5, 9: 6, 10: 7}}
    left, right = CONFIG.insoles
    wired = (dataclasses.replace(left, boards=right.boards), dataclasses.replace(right, boards=left.boards))
    played = dataclasses.replace(CONFIG, insoles=wired)
    status, report = set_up(rewired(exchanged), played, generation, few_triangles, steps="press")
    assert status == 1
    assert "swapped: board 8 lies in the left foot, the configuration gives it to the right foot" in report
    assert "plug the insoles the other way round" in report


@GENERATIONS
def test_boards_that_do_not_start_end_the_session_after_the_first_step(generation, set_up):
    status, report = set_up(generation=generation, streaming=False)
    assert status == 1
    assert "no frame and no error frame received" in report
    assert "Not done: no board sends." in report


def test_without_a_terminal_bring_up_asks_nothing():
    assert not verb._confirm_step("stand on one leg")
