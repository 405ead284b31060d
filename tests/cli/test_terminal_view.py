"""What the terminal view draws, without a terminal."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
from rich.console import Console, RenderableType

from insole_daemon.cli.terminal_view import _INVALID, _SCALE, FootView, screen
from insole_daemon.config import Config
from insole_daemon.service.foot import load_feet
from insole_daemon.skin.geometry import THERMAL_PADS
from insole_daemon.wire.messages import Pressure, Wrench

LEFT, RIGHT = (foot.meta() for foot in load_feet(Config()))
N = LEFT.n_triangles
AGE = np.full(N, 12, np.float32)
MARK = np.ones((N, 12), np.uint8)
WRENCH = Wrench(
    "left", 1, 1, 1, 1, N, 321.4, 1.25, -2.5, 0.0, 0.0, None, None, None, 0.0123, 0.98, MARK, AGE,
    np.zeros(N, np.uint8), False, "static", 0.0, lost=3,
)  # fmt: skip


def drawn(what: RenderableType) -> tuple[str, str]:
    """As text, and as it goes to a terminal that knows every colour."""
    texts = []
    for system in (None, "truecolor"):
        console = Console(file=io.StringIO(), width=100, force_terminal=system is not None, color_system=system)
        console.print(what)
        texts.append(console.file.getvalue())
    return texts[0], texts[1]


def colour(name: str) -> str:
    return ";".join(str(int(name[at : at + 2], 16)) for at in (1, 3, 5))


def pressure(pa: float) -> Pressure:
    valid = MARK.copy()
    valid[:, THERMAL_PADS] = 0
    return Pressure(
        "left", 1, 1, 1, 1, N, np.full((N, 12), pa, np.float32), valid, AGE, np.zeros(N, np.uint8), False,
        "static", 0 * MARK,
    )  # fmt: skip


def test_panel_has_the_numbers_and_the_map():
    view = FootView(LEFT, 40)
    x, y = LEFT.xy_m[0, 0].tolist()
    view.take(replace(WRENCH, cop_x_m=x, cop_y_m=y))
    view.take(pressure(250e3))
    text, coloured = drawn(view.panel())
    for number in ("321 N", "123 cm²", "1.2 N·m", "-2.5 N·m", f"{x * 1e3:.0f} mm", "98%", "age  12 ms", "lost 3"):
        assert number in text, number
    assert text.count("┼") == 1, "the centre of pressure"
    assert colour(_SCALE[-1]) in coloured, "full scale"
    assert colour(_INVALID) not in coloured
    assert len({len(line) for line in text.splitlines()}) == 1, "a frame that is straight"
    view.take(pressure(0))
    assert colour(_SCALE[0]) in drawn(view.panel())[1]


def test_an_unknown_force_is_shown_as_a_dash():
    view = FootView(LEFT)
    view.take(replace(WRENCH, f_z_n=None, cop_x_m=None, cop_y_m=None, age_ms=np.full(N, np.nan, np.float32)))
    text, coloured = drawn(view.panel())
    assert "f_z      – N" in text
    assert "┼" not in text
    assert colour(_INVALID) in coloured, "no pressure yet"
    assert "f_z – N" in view.line()


def test_a_force_that_rounds_to_nothing_has_no_sign():
    view = FootView(LEFT)
    view.take(replace(WRENCH, f_z_n=-0.4, m_x_nm=-0.04))
    assert "f_z 0 N  m_x 0.0 N·m" in view.line()


def test_both_feet_stand_side_by_side_in_80_columns():
    console = Console(file=io.StringIO(), width=80)
    console.print(screen({"left": FootView(LEFT, 24), "right": FootView(RIGHT, 24)}, "a title"))
    _, frames, *others = console.file.getvalue().splitlines()
    assert "left" in frames
    assert "right" in frames
    assert len(others) <= 24


def test_screen_has_the_left_foot_on_the_left():
    text, _ = drawn(screen({"right": FootView(RIGHT, 40), "left": FootView(LEFT, 40)}, "a title"))
    title, frames, *_, scale = text.splitlines()
    assert title == "a title"
    assert 0 < frames.index("left") < frames.index("right")
    assert "250 kPa" in scale
    assert FootView(LEFT).line() == "left   waiting for the first cycle"
