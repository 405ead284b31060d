"""Draw docs/simulator.svg: a stride of T4 and chamber cycles at two speeds, as the simulator has them.

python docs/make_simulator_picture.py
"""

from pathlib import Path

import numpy as np

from insole_daemon.config import Config
from insole_daemon.physics.effect import effect
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.simulation.scenarios.chamber import Chamber, programme
from insole_daemon.simulation.sensed import SensedLoad, SimulatedInsole
from insole_daemon.simulation.trial import Trial

WIDTH, HEIGHT, MARGIN = 300, 190, 40
LEFT = Config(insoles=Config().insoles[:1])
LAYOUT = load_layout(LEFT.insoles[0])


def panel(at, title, x_label, y_label, curves):
    """One panel, its left edge at `at`; `curves` are (x, y, colour, name)."""
    x_all, y_all = (np.concatenate([curve[i] for curve in curves]) for i in (0, 1))
    x_low, x_high, y_high = x_all.min(), x_all.max(), y_all.max()

    def place(x, y):
        return (
            at + MARGIN + (x - x_low) / (x_high - x_low) * (WIDTH - MARGIN - 20),
            HEIGHT - MARGIN - y / y_high * (HEIGHT - MARGIN - 30),
        )

    parts = [f'<text x="{at + MARGIN}" y="16" font-weight="bold">{title}</text>']
    left, bottom = place(x_low, 0)
    right, top = place(x_high, y_high)
    parts.append(f'<path d="M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}" fill="none" stroke="#888"/>')
    for value in (x_low, x_high):
        parts.append(f'<text x="{place(value, 0)[0]:.0f}" y="{bottom + 14}" text-anchor="middle">{value:.3g}</text>')
    parts.append(f'<text x="{left - 4:.0f}" y="{top + 4:.0f}" text-anchor="end">{y_high:.0f}</text>')
    parts.append(f'<text x="{(left + right) / 2:.0f}" y="{bottom + 28}" text-anchor="middle">{x_label}</text>')
    parts.append(f'<text x="{left + 4:.0f}" y="{top - 4:.0f}">{y_label}</text>')
    for row, (x, y, colour, name) in enumerate(curves):
        points = " ".join("{:.1f},{:.1f}".format(*place(a, b)) for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.4"/>')
        x_text, y_text = left + 0.75 * (right - left), bottom - 8 - 13 * row
        parts.append(f'<text x="{x_text:.0f}" y="{y_text:.0f}" fill="{colour}" text-anchor="middle">{name}</text>')
    return parts


def stride():
    """Force and centre of pressure of one step."""
    trial = Trial("t4", LEFT, [LAYOUT])
    t_s = np.arange(7.2, 7.95, 0.01)
    reference = trial.load.reference("left", t_s)
    f_z = reference["fz_n"]
    cop_mm = np.where(f_z > 20, -1e3 * reference["my_nm"] / np.maximum(f_z, 20), np.nan)
    there = ~np.isnan(cop_mm)
    return [(t_s, f_z, "#1f6fb4", "f_z, N"), (t_s[there], cop_mm[there], "#c0562b", "CoP forward, mm")]


def loops():
    """One cycle at each of two speeds, without noise or digitiser."""
    made = reference_insole()
    effects = [effect("viscoelasticity", a=0.25, tau_s=1.0), effect("hysteresis", r_pa=[6000.0], w=[0.15])]
    boards = LEFT.insoles[0].boards
    curves = []
    for speed, colour in ((3e3, "#1f6fb4"), (45e3, "#c0562b")):
        load = Chamber([LAYOUT], programme(90e3, (speed,), ChamberCycles(cycles=1)))
        sensed = SensedLoad(load, [SimulatedInsole(LAYOUT, boards, made.calibration(LAYOUT, boards, 0), effects)])
        t_s = np.linspace(5, 5 + 2 * 90e3 / speed, 120)
        activation = sensed.pressure_pa("left", t_s)[:, 0, 3] / made.pa_per_count
        curves.append((load.level_pa(t_s) / 1e3, activation, colour, f"{speed / 1e3:.0f} kPa/s"))
    return curves


parts = [
    f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * WIDTH} {HEIGHT}" font-size="10">',
    "<style>text {font-family: sans-serif}</style>",
    f'<rect width="{2 * WIDTH}" height="{HEIGHT}" fill="white"/>',
    *panel(0, "T4: a stride of the left foot", "s", "", stride()),
    *panel(WIDTH, "Chamber: a taxel with memory, two speeds", "kPa", "counts", loops()),
    "</svg>",
]
(Path(__file__).parent / "simulator.svg").write_text("\n".join(parts) + "\n")
