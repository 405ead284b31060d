"""Calibrations of the published chamber data compared: the published model, its retraining, a plain cubic, ours.

    python benchmarks/calibration_belli2023.py [--folder ../shared/data/belli2023] [--judge FILE.mat ...]
                                               [--out calibration.json] [--picture docs/calibration-belli2023.svg]

Trained on `calibration_dataset` alone, hyper-parameters included, and judged on other files of the left insole. Every
model gets the same smoothed counts, the same taxels and the same samples (`belli2023_healthy.py`), once paired with the
pressure row by row, as published, and once by an offset and a rate of the clocks that are fitted per file. Zeroed means
that baselines, and the gauge's, are those of the file's first second.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from belli2023_data import CALIBRATION, FOLDER, Trial, read, slots
from belli2023_healthy import Healthy, healthy, valid
from numpy.typing import NDArray
from scipy.io import loadmat

from insole_daemon.calibration import clock as clocks
from insole_daemon.calibration import follow_up, memory
from insole_daemon.calibration.clock import Clock
from insole_daemon.calibration.memory import Memories
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect
from insole_daemon.recording.copies import write_calibration
from insole_daemon.skin.geometry import N_TAXELS

Array = NDArray[np.float64]

JUDGED = ("validation_dataset_1.mat", "experiment_Inf_15September_dynamic_1.mat")
PUBLISHED = Path("results", "model_20221108.mat")
REST_ROWS = 50  # unloaded, at the beginning of every file
FITTED_EVERY = 25  # rows: half a second
FOLDS = 6  # of 87 s each
WITHIN_PA, OFTEN = 15_000.0, 0.9
# One ramp up and one down cannot tell plays from slow creep, so both kinds are given, and how far the fit may go in
# making differences between them, the stiffness, is the one thing that is chosen.
MEMORIES = Memories(r_pa=(20e3, 80e3), tau_s=(3.0, 10.0, 30.0, 100.0))
STIFFNESSES = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
WORTH = 1.05  # the stiffest is taken that costs no more than this


@dataclass(frozen=True, slots=True, eq=False)
class Paired:
    """Rows of a trial with the pressure they are believed to have been read at; m taxels are judged."""

    t_s: Array  # (n,)
    counts: Array  # (n, m) smoothed
    rest_count: Array  # (m,)
    pressure_pa: Array  # (n,) smoothed, as the gauge shows it
    rest_pa: float
    valid: NDArray[np.bool_]  # (n, m)

    @property
    def activation(self) -> Array:
        """(n, m) counts below the baseline."""
        return self.rest_count - self.counts

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
    rows = follow_up.kept_rows(trial.pressure_pa[: len(trial.counts)])
    shown_pa = follow_up.smoothed(trial.pressure_pa[rows], follow_up.PRESSURE_SHARE)
    return _paired(trial, found, rows, follow_up.smoothed(trial.counts[rows], follow_up.COUNT_SHARE), shown_pa)


def by_clock(trial: Trial, found: Healthy, clock: Clock) -> Paired:
    """Rows of counts with the pressure that the gauge showed at their time."""
    reference_s, shown_pa = _gauge(trial)
    wanted_s = clock.reference_s(trial.t_s)
    rows = np.flatnonzero((wanted_s >= reference_s[0]) & (wanted_s <= reference_s[-1]))
    counts = follow_up.smoothed(trial.counts, follow_up.COUNT_SHARE)[rows]
    shown_pa = follow_up.smoothed(shown_pa, follow_up.PRESSURE_SHARE)
    return _paired(trial, found, rows, counts, np.interp(wanted_s[rows], reference_s, shown_pa))


def fitted_clock(trial: Trial, found: Healthy) -> Clock:
    """Against pairing by row, from the mean of the taxels; the delay of the smoothing is in it."""
    sound = found.taxels[valid(trial.counts[:, found.taxels], found.most_step_count).all(axis=0)]
    mean = follow_up.smoothed(trial.counts[:, sound].mean(axis=1), follow_up.COUNT_SHARE)
    activation = mean[:REST_ROWS].mean() - mean
    return clocks.fit(trial.t_s, activation[:, None] ** np.arange(1, 4), *_gauge(trial))


def _gauge(trial: Trial) -> tuple[Array, Array]:
    """Times, as if its rows were the cycles', and pressures of the rows without spikes."""
    kept = follow_up.kept_rows(trial.pressure_pa)
    return clocks.row_times_s(trial.t_s, len(trial.pressure_pa))[kept], trial.pressure_pa[kept]


def _paired(trial: Trial, found: Healthy, rows: NDArray[np.intp], counts: Array, shown_pa: Array) -> Paired:
    return Paired(
        t_s=trial.t_s[rows],
        counts=counts[:, found.taxels],
        rest_count=trial.counts[:REST_ROWS, found.taxels].mean(axis=0),
        pressure_pa=shown_pa,
        rest_pa=float(np.median(trial.pressure_pa[:REST_ROWS])),
        valid=valid(trial.counts[:, found.taxels], found.most_step_count)[rows],
    )


class Ours:
    """The cubic with what each taxel remembers; applied as the chain applies it, causally."""

    def __init__(self, trained: Paired, trial: Trial, found: Healthy, stiffness: float) -> None:
        rows = slice(REST_ROWS, None, FITTED_EVERY)
        held = memory.states(trained.t_s, trained.load_pa, MEMORIES, trial.layout)
        self.curves = memory.fit(trained.activation[rows], trained.load_pa[rows], held[rows], MEMORIES, stiffness)
        self.layout, self._slots = trial.layout, slots(trial.layout)[found.taxels]
        self.calibration, self.effects = self._model(trained.rest_count)

    def __call__(self, judged: Paired) -> Array:
        """(n, m) Pa above the beginning of the file."""
        calibration, effects = self._model(judged.rest_count)
        counts = np.full((len(judged.t_s), len(self.layout) * N_TAXELS), np.nan)
        counts[:, self._slots] = judged.counts
        chain = Chain(effects, self.layout, calibration)
        whole = chain.inverse()(counts.reshape(len(counts), len(self.layout), N_TAXELS), judged.t_s)
        return whole.reshape(len(counts), -1)[:, self._slots]

    def _model(self, rest_count: Array) -> tuple[Calibration, tuple[Effect, ...]]:
        said = {"source": "Belli et al. 2023, calibration_dataset", "counts": "smoothed exponentially, share 0.1"}
        return memory.calibration(self.curves, self._slots, rest_count, self.layout, said)


def chosen(trained: Paired, trial: Trial) -> float:
    """The stiffness, by the median taxel's error in parts of the calibration data that were not fitted."""
    rows = slice(REST_ROWS, None, FITTED_EVERY)
    t_s = trained.t_s[rows]
    fold = np.minimum((t_s - t_s[0]) / np.ptp(t_s) * FOLDS, FOLDS - 1).astype(np.intp)
    held = memory.states(trained.t_s, trained.load_pa, MEMORIES, trial.layout)[rows]
    left = [
        np.median(memory.held_out(trained.activation[rows], trained.load_pa[rows], held, MEMORIES, stiffness, fold))
        for stiffness in STIFFNESSES
    ]
    return max(stiffness for stiffness, each in zip(STIFFNESSES, left, strict=True) if each <= WORTH * min(left))


def models(
    trained: Paired, trial: Trial, found: Healthy, stiffness: float, published_pa: Array
) -> dict[str, tuple[Callable[[Paired], Array], bool]]:
    """What each model says of rows (n, m), and whether that is above the file's beginning.

    `published_pa` (m, 164), zero where there is no published model of a taxel.
    """
    retrained_pa = follow_up.train(trained.counts, trained.pressure_pa)
    cubic_pa = [np.polyfit(x, trained.load_pa, 3) for x in trained.activation.T]

    def shifted(judged: Paired) -> Array:
        return judged.counts - judged.rest_count + trained.rest_count

    return {
        "published": (lambda judged: follow_up.estimate(judged.counts, published_pa), False),
        "published, zeroed": (lambda judged: follow_up.estimate(shifted(judged), published_pa) - trained.rest_pa, True),
        "retrained": (lambda judged: follow_up.estimate(judged.counts, retrained_pa), False),
        "retrained, zeroed": (lambda judged: follow_up.estimate(shifted(judged), retrained_pa) - trained.rest_pa, True),
        "plain cubic, zeroed": (
            lambda judged: np.stack(
                [np.polyval(own, x) for own, x in zip(cubic_pa, judged.activation.T, strict=True)], axis=1
            ),
            True,
        ),
        "ours, zeroed": (Ours(trained, trial, found, stiffness), True),
    }


def scored(said_pa: Array, judged: Paired, zeroed: bool) -> Score:
    """A taxel that may not be judged in most of a file is not within anything, and has no RMSE."""
    error = said_pa - (judged.load_pa if zeroed else judged.pressure_pa)[:, None]
    n = judged.valid.sum(axis=0)
    enough = n > 0.5 * len(error)
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
    options = parser.parse_args()

    trial = read(options.folder / CALIBRATION)
    found = healthy(trial)
    published_pa, known = published(options.folder, found)
    clock = fitted_clock(trial, found)
    trained = {"row": by_row(trial, found), "clock": by_clock(trial, found, clock)}
    stiffness = chosen(trained["clock"], trial)
    print(f"{len(found.taxels)} taxels, {known.sum()} of them with a published model; stiffness {stiffness:g}\n")
    print(_said(trial, clock))
    made = {how: models(pairs, trial, found, stiffness, published_pa) for how, pairs in trained.items()}
    ours = made["clock"]["ours, zeroed"][0]
    assert isinstance(ours, Ours)
    if options.out:
        write_calibration(options.out, ours.calibration, trial.layout)
    rows = []
    for name in options.judge:
        judged = read(options.folder / CALIBRATION.parent / name)
        clock = fitted_clock(judged, found)
        print(_said(judged, clock))
        pairs = {"row": by_row(judged, found), "clock": by_clock(judged, found, clock)}
        for model in made["row"]:
            cells = []
            for how in ("row", "clock"):
                estimate, zeroed = made[how][model]
                score = scored(estimate(pairs[how]), pairs[how], zeroed)
                median = float(np.nanmedian(score.rmse_pa[known])) / 1e5
                cells.append(f"{median:.3f} | {score.within.sum()} | {score.within[known].sum()}")
            rows.append(f"| {judged.name} | {model} | {' | '.join(cells)} |")
    head = "median RMSE, bar | within 0.15 bar | … of the published"
    print(f"\n| file | model | by row: {head} | by clock: {head} |\n|{'---|' * 8}")
    print("\n".join(rows))


def _said(trial: Trial, clock: Clock) -> str:
    return (
        f"{trial.name}: offset {clock.offset_s:+.3f} ± {clock.offset_std_s:.3f} s, rate {1e2 * clock.rate:+.3f} ± "
        f"{1e2 * clock.rate_std:.3f} % against pairing by row, {trial.t_s[-1]:.0f} s"
    )


if __name__ == "__main__":
    main()
