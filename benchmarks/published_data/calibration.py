"""Errors of four calibrations on published chamber data: the published model, the same refitted, a cubic, ours.

    python -m benchmarks.published_data.calibration [--folder ../shared/data/belli2023] [--judge FILE.mat ...]
        [--out calibration.json] [--picture docs/evidence/calibration-belli2023.svg]

Trained on `calibration_dataset` alone, hyper-parameters included, and judged on other files of the left insole. Every
model gets the same smoothed counts, the same taxels and the same samples (`healthy_taxels.py`), once paired with the
pressure row by row, as published, and once by an offset and a rate of the clocks that are fitted per file. Zeroed means
that baselines, and the gauge's, are those of the file's first second.

Takes about a minute.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from benchmarks.published_data.belli2023 import CALIBRATION, FOLDER, Trial, read, slots
from benchmarks.published_data.healthy_taxels import Healthy, healthy
from benchmarks.published_data.picture import Panel, drawn
from insole_daemon.calibration import clock as clocks
from insole_daemon.calibration import follow_up, memory
from insole_daemon.calibration.baseline_drift import baseline_rise_count
from insole_daemon.calibration.clock import Clock
from insole_daemon.calibration.memory import Memories
from insole_daemon.files import write_text
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.chain import Chain
from insole_daemon.recording.copies import write_calibration
from insole_daemon.skin.geometry import N_TAXELS

Array = NDArray[np.float64]

JUDGED = ("validation_dataset_1.mat", "experiment_Inf_15September_dynamic_1.mat")
PUBLISHED = Path("results", "model_20221108.mat")
REST_ROWS = 50  # unloaded, at the beginning of every file
FITTED_EVERY = 25  # rows: half a second
FOLDS = 6  # of 87 s each
JUDGED_SHARE = 0.25  # of a file, that a taxel has to be judged in
WITHIN_PA, OFTEN = 15_000.0, 0.9
# One ramp up and one down cannot tell plays from slow creep, so both kinds are given, and how far the fit may go in
# making differences between them, the stiffness, is chosen, with how far ours smooths the counts.
MEMORIES = Memories(r_pa=(20e3, 80e3), tau_s=(3.0, 10.0, 30.0, 100.0))
STIFFNESSES = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2)
SHARES = (0.1, 0.07, 0.05, 0.03, 0.02)  # of a new count in the smoothed one
COLOURS = {"published, zeroed": "#c0562b", "plain cubic, zeroed": "#2a8f4f", "ours, zeroed": "#1f6fb4"}
FLOOR = "ours, fitted to the file itself"  # what this kind of model reaches if nothing had changed since calibration
WORTH = 1.05  # what costs no more than this is worth the same


@dataclass(frozen=True, slots=True, eq=False)
class Paired:
    """Rows of a trial with the pressure they are believed to have been read at; m taxels are judged."""

    t_s: Array  # (n,)
    raw: Array  # (k, m) counts of consecutive rows
    sound: NDArray[np.bool_]  # (k, m) not masked
    of: NDArray[np.intp]  # (n,) which of these the paired rows are
    rest_count: Array  # (m,)
    board: NDArray[np.intp]  # (m,)
    pressure_pa: Array  # (n,) smoothed, as the gauge shows it
    rest_pa: float

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, m)."""
        return self.sound[self.of]

    @property
    def counts(self) -> Array:
        """(n, m) smoothed as published."""
        return follow_up.smooth_causally(self.raw, follow_up.COUNT_SHARE)[self.of]

    @property
    def activation(self) -> Array:
        """(n, m) counts below the baseline."""
        return self.rest_count - self.counts

    def steady(self, share: float) -> Array:
        """(n, m) counts as ours is given them: the last valid ones, less what boards rose by themselves, smoothed."""
        last = np.maximum.accumulate(np.where(self.sound, np.arange(len(self.raw))[:, None], 0), axis=0)
        held = np.take_along_axis(self.raw, last, axis=0)
        return follow_up.smooth_causally(held - baseline_rise_count(held, self.rest_count, self.board), share)[self.of]

    @property
    def load_pa(self) -> Array:
        """(n,) pressure above that of the file's beginning."""
        return self.pressure_pa - self.rest_pa


@dataclass(frozen=True, slots=True)
class Score:
    """Of one model on one file, paired in one way."""

    rmse_pa: Array  # (m,)
    within: NDArray[np.bool_]  # (m,) ≤ 0.15 bar on ≥ 90 % of the samples


def by_row(trial: Trial, found: Healthy) -> Paired:
    """As published: a row of counts belongs to the row of pressures of its number."""
    rows = follow_up.select_rows(trial.pressure_pa[: len(trial.counts)])
    shown_pa = follow_up.smooth_causally(trial.pressure_pa[rows], follow_up.PRESSURE_SHARE)
    return _paired(trial, found, rows, rows, shown_pa)


def by_clock(trial: Trial, found: Healthy, clock: Clock) -> Paired:
    """Rows of counts with the pressure that the gauge showed at their time."""
    reference_s, shown_pa = _gauge(trial)
    wanted_s = clock.reference_s(trial.t_s)
    rows = np.flatnonzero((wanted_s >= reference_s[0]) & (wanted_s <= reference_s[-1]))
    shown_pa = follow_up.smooth_causally(shown_pa, follow_up.PRESSURE_SHARE)
    every = np.arange(len(trial.t_s))
    return _paired(trial, found, every, rows, np.interp(wanted_s[rows], reference_s, shown_pa))


def fitted_clock(trial: Trial, found: Healthy) -> Clock:
    """Against pairing by row, from the mean of the taxels; the delay of the smoothing is in it."""
    sound = found.taxels[found.valid(trial).all(axis=0)]
    mean = follow_up.smooth_causally(trial.counts[:, sound].mean(axis=1), follow_up.COUNT_SHARE)
    activation = mean[:REST_ROWS].mean() - mean
    return clocks.fit_clock(trial.t_s, activation[:, None] ** np.arange(1, 4), *_gauge(trial))


def _gauge(trial: Trial) -> tuple[Array, Array]:
    """Times, as if its rows were the cycles', and pressures of the rows without spikes."""
    kept = follow_up.select_rows(trial.pressure_pa)
    return clocks.row_times_s(trial.t_s, len(trial.pressure_pa))[kept], trial.pressure_pa[kept]


def _paired(
    trial: Trial, found: Healthy, smoothed: NDArray[np.intp], rows: NDArray[np.intp], shown_pa: Array
) -> Paired:
    """`rows`, all among those that are smoothed, with what the gauge showed then."""
    counts = trial.counts[:, found.taxels]
    rest_count = counts[:REST_ROWS].mean(axis=0)
    triangle = slots(trial.layout)[found.taxels] // N_TAXELS
    return Paired(
        t_s=trial.t_s[rows],
        raw=counts[smoothed],
        sound=found.valid(trial)[smoothed],
        of=np.searchsorted(smoothed, rows),
        rest_count=rest_count,
        board=trial.layout.identities[triangle, 0].astype(np.intp),
        pressure_pa=shown_pa,
        rest_pa=float(np.median(trial.pressure_pa[:REST_ROWS])),
    )


class Ours:
    """The cubic with what each taxel remembers; applied as the chain applies it, causally."""

    def __init__(self, trained: Paired, trial: Trial, found: Healthy, share: float, stiffness: float) -> None:
        rows = slice(REST_ROWS, None, FITTED_EVERY)
        held = memory.memory_states(trained.t_s, trained.load_pa, MEMORIES, trial.layout)
        self._share = share
        activation = np.where(trained.valid, trained.rest_count - trained.steady(share), np.nan)
        judged = trained.valid.mean(axis=0) > JUDGED_SHARE
        activation[:, ~judged] = activation[:, judged][:, :1]  # those are not judged: any curve will do
        self.curves = memory.fit_memory(activation[rows], trained.load_pa[rows], held[rows], MEMORIES, stiffness)
        self.layout, self._slots = trial.layout, slots(trial.layout)[found.taxels]
        self.calibration = self._model(trained.rest_count)

    def __call__(self, judged: Paired) -> Array:
        """(n, m) Pa above the beginning of the file."""
        calibration = self._model(judged.rest_count)
        counts = np.full((len(judged.t_s), len(self.layout) * N_TAXELS), np.nan)
        counts[:, self._slots] = judged.steady(self._share)
        chain = Chain(calibration.effects, self.layout, calibration)
        whole = chain.inverse()(counts.reshape(len(counts), len(self.layout), N_TAXELS), judged.t_s)
        return np.maximum(whole.reshape(len(counts), -1)[:, self._slots], 0.0)

    def _model(self, rest_count: Array) -> Calibration:
        said = {
            "source": "Belli et al. 2023, calibration_dataset",
            "counts": f"smoothed exponentially, {self._share:g} of each new one",
        }
        return memory.memory_calibration(self.curves, self._slots, rest_count, self.layout, said)


def chosen(trained: Paired, trial: Trial) -> tuple[float, float]:
    """The share of a new count and the stiffness, by the median taxel's error in parts that were not fitted.

    Of what is worth about the same, the quickest and then the stiffest.
    """
    rows = slice(REST_ROWS, None, FITTED_EVERY)
    t_s = trained.t_s[rows]
    fold = np.minimum((t_s - t_s[0]) / np.ptp(t_s) * FOLDS, FOLDS - 1).astype(np.intp)
    held = memory.memory_states(trained.t_s, trained.load_pa, MEMORIES, trial.layout)[rows]
    left = {}
    for share in SHARES:
        activation, load_pa = (trained.rest_count - trained.steady(share))[rows], trained.load_pa[rows]
        for stiffness in STIFFNESSES:
            rmse = memory.cv_rmse_pa(activation, load_pa, held, MEMORIES, stiffness, fold)
            left[share, stiffness] = float(np.median(rmse))
    return max(pair for pair, each in left.items() if each <= WORTH * min(left.values()))


def models(
    trained: Paired, trial: Trial, found: Healthy, share: float, stiffness: float, published_pa: Array
) -> dict[str, tuple[Callable[[Paired], Array], bool]]:
    """What each model says of rows (n, m), and whether that is above the file's beginning.

    `published_pa` (m, 164), zero where there is no published model of a taxel.
    """
    retrained_pa = follow_up.train(trained.counts, trained.pressure_pa)
    cubic_pa = [np.polyfit(x, trained.load_pa, 3) for x in trained.activation.T]

    def shifted(judged: Paired) -> Array:
        return judged.counts - judged.rest_count + trained.rest_count

    return {
        "published": (lambda judged: follow_up.estimate_pressure(judged.counts, published_pa), False),
        "published, zeroed": (
            lambda judged: follow_up.estimate_pressure(shifted(judged), published_pa) - trained.rest_pa,
            True,
        ),
        "retrained": (lambda judged: follow_up.estimate_pressure(judged.counts, retrained_pa), False),
        "retrained, zeroed": (
            lambda judged: follow_up.estimate_pressure(shifted(judged), retrained_pa) - trained.rest_pa,
            True,
        ),
        "plain cubic, zeroed": (
            lambda judged: np.stack(
                [np.polyval(own, x) for own, x in zip(cubic_pa, judged.activation.T, strict=True)], axis=1
            ),
            True,
        ),
        "ours, zeroed": (Ours(trained, trial, found, share, stiffness), True),
    }


def scored(said_pa: Array, judged: Paired, zeroed: bool) -> Score:
    """A taxel that may not be judged in a quarter of a file is not within anything, and has no RMSE."""
    error = said_pa - (judged.load_pa if zeroed else judged.pressure_pa)[:, None]
    n = judged.valid.sum(axis=0)
    enough = n > JUDGED_SHARE * len(error)
    rmse = np.sqrt(np.where(judged.valid, error, 0.0).__pow__(2).sum(axis=0) / np.maximum(n, 1))
    often = ((np.abs(error) <= WITHIN_PA) & judged.valid).sum(axis=0) >= OFTEN * n
    return Score(np.where(enough, rmse, np.nan), often & enough)


def published(folder: Path, found: Healthy) -> tuple[Array, NDArray[np.bool_]]:
    """(m, 164) coefficients in Pa, and (m,) which of the taxels have any."""
    file = loadmat(folder / PUBLISHED, simplify_cells=True)
    coefficients = 1e5 * file["coefficients_all_taxels"].reshape(280, -1)[found.taxels]
    return coefficients, (coefficients != 0).any(axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="with left_insole and results")
    parser.add_argument("--judge", nargs="*", default=JUDGED, help="names of files in left_insole")
    parser.add_argument("--out", type=Path, help="where ours is written, insole-calibration/1")
    parser.add_argument("--picture", type=Path, help="where the median taxel's error is drawn, SVG")
    options = parser.parse_args()

    trial = read(options.folder / CALIBRATION)
    found = healthy(trial)
    published_pa, known = published(options.folder, found)
    clock = fitted_clock(trial, found)
    trained = {"row": by_row(trial, found), "clock": by_clock(trial, found, clock)}
    share, stiffness = chosen(trained["clock"], trial)
    print(f"{len(found.taxels)} taxels, {known.sum()} of them with a published model")
    print(f"ours: share {share:g}, stiffness {stiffness:g}\n")
    print(_said(trial, clock))
    made = {how: models(pairs, trial, found, share, stiffness, published_pa) for how, pairs in trained.items()}
    ours = made["clock"]["ours, zeroed"][0]
    assert isinstance(ours, Ours)
    if options.out:
        write_calibration(options.out, ours.calibration, trial.layout)
    rows, panels = [], []
    for name in options.judge:
        judged = read(options.folder / CALIBRATION.parent / name)
        clock = fitted_clock(judged, found)
        print(_said(judged, clock))
        pairs = {"row": by_row(judged, found), "clock": by_clock(judged, found, clock)}
        floor = {how: Ours(pairs[how], judged, found, share, stiffness) for how in pairs}
        for model in (*made["row"], FLOOR):
            cells = []
            for how in ("row", "clock"):
                estimate, zeroed = (floor[how], True) if model == FLOOR else made[how][model]
                score = scored(estimate(pairs[how]), pairs[how], zeroed)
                median = float(np.nanmedian(score.rmse_pa[known])) / 1e5
                cells.append(f"{median:.3f} | {score.within.sum()} | {score.within[known].sum()}")
            rows.append(f"| {judged.name} | {model} | {' | '.join(cells)} |")
        panels.append(_panel(judged.name, pairs["clock"], {name: made["clock"][name][0] for name in COLOURS}, known))
    if options.picture:
        write_text(options.picture, drawn(panels, "median error, bar", -0.3, 0.3))
    head = "median RMSE, bar | within 0.15 bar | … of the published"
    print(f"\n| file | model | by row: {head} | by clock: {head} |\n|{'---|' * 8}")
    print("\n".join(rows))


def _panel(title: str, judged: Paired, shown: dict[str, Callable[[Paired], Array]], known: NDArray[np.bool_]) -> Panel:
    """The median error of the taxels that are judged at a moment, by the models `shown`."""
    curves = []
    for name, estimate in shown.items():
        error = np.where(judged.valid, estimate(judged) - judged.load_pa[:, None], np.nan)[:, known] / 1e5
        error[np.isnan(error).all(axis=1)] = 0.0  # in the first second nothing is judged
        curves.append((name.removesuffix(", zeroed"), COLOURS[name], np.nanmedian(error, axis=1)))
    return Panel(title, judged.t_s, [("load / 10", "#888", judged.load_pa / 1e6), *curves])


def _said(trial: Trial, clock: Clock) -> str:
    return (
        f"{trial.name}: offset {clock.offset_s:+.3f} ± {clock.offset_std_s:.3f} s, rate {1e2 * clock.rate:+.3f} ± "
        f"{1e2 * clock.rate_std:.3f} % against pairing by row, {trial.t_s[-1]:.0f} s"
    )


if __name__ == "__main__":
    main()
