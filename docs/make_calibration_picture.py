"""Draw docs/calibration.svg: what `insole calibrate` finds on a simulated insole, by the drawings of its report.

python docs/make_calibration_picture.py
"""

import tempfile
from pathlib import Path

import numpy as np

import insole_daemon
from insole_daemon.calibration.calibrating import calibrate, curve_pa
from insole_daemon.config import Config
from insole_daemon.report.insole_map import value_map
from insole_daemon.report.plot import Axis, Plot
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.geometry import N_TAXELS

LEFT = Config(insoles=Config().insoles[:1])
LAYOUT = load_layout(LEFT.insoles[0])
STYLE = """svg { font: 12px sans-serif; fill: #1c2430; } .tick { font-size: 11px; fill: #5b6675; }
.frame { fill: none; stroke: #b6bec9; } .grid { stroke: #d8dde4; fill: none; }"""


def main() -> None:
    """Simulate, calibrate and draw."""
    with tempfile.TemporaryDirectory() as folder:
        names = ("vacuum", "t1", "t2", "t3")
        trials = [Trial(name, LEFT, [LAYOUT], seed=3).write(Path(folder) / name) for name in names]
        found = calibrate([insole_daemon.load(trial) for trial in trials], "left")
    coefficients, highest = found.fit.coefficients_pa, found.highest_count
    curves = Plot(Axis("activation, counts below rest", 0, 90), Axis("pressure, kPa", 0, 600), 560, 300)
    x = np.linspace(0, 90, 181)
    for at in range(len(found.slots)):
        own = np.linspace(0, highest[at], 10)
        curves.line(own, curve_pa(coefficients[at : at + 1], own[:, None])[:, 0] / 1e3, faint=True)
    curves.line(x, curve_pa(found.fit.common_pa[None], x[:, None])[:, 0] / 1e3, 1, "what all taxels have in common")
    powers = x[:, None] ** np.arange(coefficients.shape[1])
    std = np.sqrt(np.einsum("mij,ni,nj->nm", found.fit.covariance_pa2, powers, powers)) / 1e3
    std[x[:, None] > highest] = np.nan
    seen = np.isfinite(std).sum(axis=1) > 20
    low, middle, high = np.nanpercentile(std[seen], (5, 50, 95), axis=1)
    spread = Plot(Axis("activation, counts below rest", 0, 90), Axis("σ, kPa", 0, float(high.max()) * 1.05), 560, 190)
    spread.band(x[seen], low, high, 0, "90 % of the taxels")
    spread.line(x[seen], middle, 1, "median")
    answers = np.full(len(LAYOUT) * N_TAXELS, np.nan)
    pressures = curve_pa(coefficients, np.tile(x[:, None], len(found.slots)))
    answers[found.slots] = x[np.argmax(pressures >= 50e3, axis=0)]
    parts = [
        (curves.svg("curves"), 0, 0, 560, 322),
        (spread.svg("uncertainty"), 0, 330, 560, 212),
        (value_map(LAYOUT, answers, "counts", "answer to 50 kPa"), 580, 0, 300, 542),
    ]
    inside = "".join(
        svg.replace("<svg ", f'<svg x="{u}" y="{v}" width="{w}" height="{h}" ', 1) for svg, u, v, w, h in parts
    )
    whole = (
        f'<svg viewBox="0 0 890 545" xmlns="http://www.w3.org/2000/svg"><style>{STYLE}</style>'
        f'<rect width="890" height="545" fill="#ffffff"/>{inside}</svg>\n'
    )
    (Path(__file__).parent / "calibration.svg").write_text(whole)


if __name__ == "__main__":
    main()
