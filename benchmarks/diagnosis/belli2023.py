"""What `insole diagnose` finds in the published chamber data, turned round and judged by the mean pressure.

    python -m benchmarks.diagnosis.belli2023 [--folder ../shared/data/belli2023]
                                             [--errors docs/evidence/findings-belli2023-errors.svg]
                                             [--boards docs/evidence/findings-belli2023-boards.svg]

The mean pressure of the healthy taxels (`healthy_taxels.py`) that have a published model, against the gauge, paired
row by row as published and by the clocks. Within a file: the explanation is fitted again without blocks of 8 or 30 s,
and judged on those. Across files: it is fitted to `calibration_dataset` and not changed. All models get the same counts
with the published smoothing, and causally: nothing later than a reading is used for it.

A zero of a file is either the mean of its first second, or one constant for the whole of the file, its mean error; both
are given to all models. What the insole bore before a file is not known either: beside the constant stands the same
with one relaxation that dies away from the first row on, for all models too. The upper bound is ridge regression of the
mean activation, its powers and forty memories of it, with a penalty chosen by blocks held out: more than the named
effects can say, and nothing to name.

Takes about 5 minutes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from benchmarks.published_data.belli2023 import CALIBRATION, FOLDER, Trial, read, slots
from benchmarks.published_data.calibration import JUDGED, Paired, by_clock, by_row, fitted_clock, published
from benchmarks.published_data.healthy_taxels import Healthy, healthy
from benchmarks.published_data.picture import Panel, drawn
from insole_daemon.calibration import follow_up
from insole_daemon.diagnosis import modelling
from insole_daemon.diagnosis.diagnosing import Diagnosis, diagnose
from insole_daemon.diagnosis.finding import Quantity
from insole_daemon.diagnosis.fit import Hypothesis
from insole_daemon.diagnosis.groups import Named
from insole_daemon.diagnosis.modelling import Curves
from insole_daemon.diagnosis.naming import N_FOLDS, Tried
from insole_daemon.diagnosis.operators import low_pass, plays
from insole_daemon.files import write_text
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Where
from insole_daemon.recording.import_matlab import import_matlab
from insole_daemon.skin.geometry import N_TAXELS

Array = NDArray[np.float64]
NAMES = (("creep",), ("hysteresis",), ("hysteresis", "creep"))  # beside what is named first
BLOCKS_S = (8.0, 30.0)
RIDGES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
TAUS_S = (1.0, 3.0, 10.0, 30.0, 100.0)
RADII = np.geomspace(0.01, 0.6, 15)  # of the mean activation's span
COLOURS = {"published": "#c0562b", "creep": "#2a8f4f", "hysteresis": "#1f6fb4"}
LATE_S = 20.0  # in `dynamic_1` the gauge has stepped by then: its errors are said without that too
PAST_S = 10.0  # in which dies away what a load before the file left in the insole
EVERY = 5  # rows that the upper bound is fitted to


@dataclass(frozen=True, slots=True, eq=False)
class File:
    """One of the published files, and what it is judged by."""

    trial: Trial
    row: Paired
    clock: Paired


class Found:
    """What a diagnosis says of its largest group."""

    def __init__(self, path: Path) -> None:
        with tempfile.TemporaryDirectory() as folder:
            recording = insole_daemon.load(import_matlab(path, Path(folder) / path.stem, "left", None))
            self.said: Diagnosis = diagnose([recording], None, None, lambda text: None)
        self.named: Named = max(self.said.located.named, key=lambda each: len(each.group.slots))
        self.layout = recording["left"].layout
        self.tried = {each.words: each for each in self.named.naming.tried}

    def model(self, tried: Tried, rows: NDArray[np.bool_] | None = None) -> Model:
        """One explanation as a model; `rows`: fitted to these blocks alone."""
        return Model(self.document(tried, rows), self)

    def document(self, tried: Tried, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """The same as the contents of a `model.json`."""
        group, theta = self.named.group, tried.fitted.theta
        kept = np.ones(len(group.evidence.y), bool) if rows is None else rows
        if rows is not None:
            theta = Hypothesis(group.evidence, tried.fitted.candidates).fit(theta, rows, 3).theta
        hypothesis = Hypothesis(group.taxels, tried.fitted.candidates)
        fitted = hypothesis.fit(theta, kept, 0)
        loads = np.linspace(float(fitted.effective_pa.min()), float(fitted.effective_pa.max()), modelling.N_LOADS)
        noise = self.said.insole.noise_of(group.slots)[:, None]
        curves = Curves(group.slots, loads, hypothesis.curve(fitted, loads) * noise)
        effects = [
            modelling.as_effect(
                each.word, Where(), {k: Quantity(v, 0.0, "") for k, v in each.parameters(values).items()}
            )
            for each, values in zip(fitted.candidates, fitted.values(), strict=True)
            if each.parameters is not None
        ]
        return modelling.document("left", self.layout, [curves], effects, {})


class Model:
    """A `model.json` that the daemon's chain turns round."""

    def __init__(self, document: dict[str, object], found: Found) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.json"
            write_text(path, json.dumps(document))
            calibration = calibrations.load(path, found.layout)
        self._chain = Chain(calibration.effects, found.layout, calibration)
        self._shape = (len(found.layout), N_TAXELS)

    def __call__(
        self, paired: Paired, columns: NDArray[np.intp], rest_count: Array, share: float = follow_up.COUNT_SHARE
    ) -> Array:
        """(n, m) Pa of the slots `columns` (m,), whose baselines were measured where they rested at `rest_count`.

        Counts are smoothed by `share`, 1: as they were read, and taken where those smoothed as published are as late.
        """
        last = np.maximum.accumulate(np.where(paired.sound, np.arange(len(paired.raw))[:, None], 0), axis=0)
        held = np.take_along_axis(paired.raw, last, axis=0) - paired.rest_count + rest_count
        counts = np.full((len(held), self._shape[0] * self._shape[1]), np.nan)
        counts[:, columns] = follow_up.smooth_causally(held, share)
        t_s = np.interp(np.arange(len(held)), paired.of, paired.t_s)
        pressure_pa = self._chain.inverse()(counts.reshape(len(held), *self._shape), t_s)
        earlier = round(1 / follow_up.COUNT_SHARE - 1 / share)
        return np.asarray(pressure_pa.reshape(len(held), -1)[:, columns][np.maximum(paired.of - earlier, 0)])


class Bound:
    """Ridge regression of many memories of the mean activation."""

    def __init__(self, t_s: Array, activation: Array, pressure_pa: Array) -> None:
        self._span = float(np.ptp(activation))
        made = self._features(t_s, activation)[::EVERY]
        self._scale = made.std(axis=0) + 1e-12
        self._pa, self._at = pressure_pa[::EVERY], made / self._scale
        fold = ((t_s[::EVERY] - t_s[0]) // BLOCKS_S[1]).astype(int) % N_FOLDS
        held = {ridge: self._held_out(ridge, fold) for ridge in RIDGES}
        self.ridge = min(held, key=lambda each: held[each])
        self.held_out_pa = held[self.ridge]
        self._shares = self._fit(self.ridge, np.ones(len(self._pa), bool))

    def __call__(self, t_s: Array, activation: Array) -> Array:
        """(n,) Pa."""
        return np.asarray(self._with_one(self._features(t_s, activation) / self._scale) @ self._shares)

    def _features(self, t_s: Array, activation: Array) -> Array:
        x = activation[:, None] / self._span
        step_s = float(np.median(np.diff(t_s)))
        held = [x - low_pass(x, step_s, tau) for tau in TAUS_S]
        loops = list(plays(x, RADII))
        memories = np.concatenate([*held, *loops], axis=1)
        return np.concatenate([x, x**2, x**3, memories, memories * x], axis=1)

    def _with_one(self, made: Array) -> Array:
        return np.concatenate([np.ones((len(made), 1)), made], axis=1)

    def _fit(self, ridge: float, rows: NDArray[np.bool_]) -> Array:
        x = self._with_one(self._at[rows])
        penalty = ridge * len(x) * np.eye(x.shape[1])
        penalty[0, 0] = 0.0
        return np.linalg.solve(x.T @ x + penalty, x.T @ self._pa[rows])

    def _held_out(self, ridge: float, fold: NDArray[np.intp]) -> float:
        left = [
            self._with_one(self._at[fold == i]) @ self._fit(ridge, fold != i) - self._pa[fold == i]
            for i in range(N_FOLDS)
        ]
        return rms(np.concatenate(left))


def rms(error: Array) -> float:
    """Of what is known."""
    return float(np.sqrt(np.nanmean(error**2)))


class Judge:
    """Mean pressures of the taxels that are asked, against the gauge."""

    def __init__(self, taxels: NDArray[np.bool_]) -> None:
        self._taxels = taxels  # (m,)

    def mean(self, of_taxels: Array, paired: Paired) -> Array:
        """(n,) of what is said of (n, m), NaN where hardly a taxel is valid."""
        there = paired.valid & self._taxels & np.isfinite(of_taxels)
        n = there.sum(axis=1)
        total = np.where(there, of_taxels, 0.0).sum(axis=1)
        return np.asarray(np.where(n > 20, total / np.maximum(n, 1), np.nan))


def said(error_pa: Array, t_s: Array) -> str:
    """Zero of the first second; one constant; the same from LATE_S on; one constant and what is left of a past; bar."""
    late = error_pa[t_s > LATE_S]
    known = np.isfinite(error_pa)
    past = np.stack([np.ones(len(t_s)), np.exp(-t_s / PAST_S)], axis=1)[known]
    beside = error_pa[known] - past @ np.linalg.lstsq(past, error_pa[known], rcond=None)[0]
    each = (rms(error_pa), float(np.nanstd(error_pa)), float(np.nanstd(late)), rms(beside))
    return " | ".join(f"{value / 1e5:.4f}" for value in each)


def within(file: File, found: Found, judge: Judge, columns: NDArray[np.intp], published_pa: Array) -> list[str]:
    """Rows of the table: blocks held out of `file`."""
    paired, t_s = file.clock, found.named.group.evidence.observed[0].t_s
    reference = judge.mean(follow_up.estimate_pressure(paired.counts, published_pa), paired) - paired.pressure_pa
    rows = [f"| {file.trial.name} | published | " + " | ".join([f"{rms(reference) / 1e5:.4f} | "] * len(BLOCKS_S))]
    for words in dict.fromkeys((found.named.naming.best.words, *NAMES)):
        if words not in found.tried:
            continue
        cells = []
        for block_s in BLOCKS_S:
            fold = ((t_s - t_s[0]) // block_s).astype(int) % N_FOLDS
            at = ((paired.t_s - t_s[0]) // block_s).astype(int) % N_FOLDS
            error = np.full(len(at), np.nan)
            for i in range(N_FOLDS):
                model = found.model(found.tried[words], fold != i)
                own = judge.mean(model(paired, columns, paired.rest_count), paired) - paired.pressure_pa
                error[at == i] = own[at == i]
            there = np.isfinite(error)
            cells.append(f"{rms(error) / 1e5:.4f} | {1 - rms(error) / rms(reference[there]):.0%}")
        rows.append(f"| {file.trial.name} | {' + '.join(words) or 'static'} | {' | '.join(cells)} |")
    return rows


def across(
    files: Sequence[File], found: Found, judge: Judge, columns: NDArray[np.intp], published_pa: Array
) -> tuple[list[str], list[Panel]]:
    """Rows of the table, and the errors by clock over time."""
    trained = files[0].clock
    models = {" + ".join(words) or "static": found.model(found.tried[words]) for words in ((), *NAMES)}
    rest_pa, rest_count = trained.rest_pa, trained.rest_count
    activation = judge.mean(trained.activation, trained)
    known = np.isfinite(activation)
    bound = Bound(trained.t_s[known], activation[known], trained.load_pa[known])
    rows, panels = [], []
    for file in files:
        errors: dict[str, dict[str, Array]] = {}
        for how, paired in (("row", file.row), ("clock", file.clock)):
            shifted = paired.counts - paired.rest_count + rest_count
            own = {"published as it is": judge.mean(follow_up.estimate_pressure(paired.counts, published_pa), paired)}
            own["published as it is"] -= paired.rest_pa
            own["published"] = judge.mean(follow_up.estimate_pressure(shifted, published_pa), paired) - rest_pa
            for name, model in models.items():
                own[name] = judge.mean(model(paired, columns, rest_count), paired) - rest_pa
            x = judge.mean(paired.activation, paired)
            there = np.isfinite(x)
            own["upper bound"] = np.full(len(x), np.nan)
            own["upper bound"][there] = bound(paired.t_s[there], x[there])
            errors[how] = {name: each - paired.load_pa for name, each in own.items()}
        for name in errors["row"]:
            cells = [said(errors[how][name], getattr(file, how).t_s) for how in ("row", "clock")]
            rows.append(f"| {file.trial.name} | {name} | {' | '.join(cells)} |")
        shown = errors["clock"]
        curves = [(name, COLOURS[name], np.nan_to_num(shown[name]) / 1e5) for name in COLOURS]
        load = ("load / 10", "#888", file.clock.load_pa / 1e6)
        panels.append(Panel(file.trial.name, file.clock.t_s, [load, *curves]))
    return rows, panels


def boards(files: Sequence[File]) -> list[Panel]:
    """What the typical taxel of each board says."""
    panels = []
    for file in files:
        board = file.trial.layout.identities[:, 0][slots(file.trial.layout) // N_TAXELS]
        curves = [
            (f"board {number}", colour, np.median(file.trial.counts[:, board == number], axis=1))
            for number, colour in zip((5, 6, 7), ("#1f6fb4", "#c0562b", "#2a8f4f"), strict=True)
        ]
        panels.append(Panel(file.trial.name, file.trial.t_s, curves))
    return panels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="with left_insole and results")
    parser.add_argument("--errors", type=Path, help="where the errors are drawn, SVG")
    parser.add_argument("--boards", type=Path, help="where the boards are drawn, SVG")
    options = parser.parse_args()

    trials = [read(options.folder / CALIBRATION.parent / name) for name in (CALIBRATION.name, *JUDGED)]
    chosen: Healthy = healthy(trials[0])
    published_pa, known = published(options.folder, chosen)
    files = [File(each, by_row(each, chosen), by_clock(each, chosen, fitted_clock(each, chosen))) for each in trials]
    columns = slots(trials[0].layout)[chosen.taxels]
    diagnoses = [Found(options.folder / CALIBRATION.parent / f"{each.name}.mat") for each in trials[:2]]
    for each in diagnoses:
        print(f"\n{each.said.insole.recordings[0]}: {each.said.verdict}")
        print("\n".join(f"- {finding.effect}: {finding.sentence}" for finding in each.said.findings))
    print(f"\n| within, blocks held out | model |{' RMSE, bar | less |' * len(BLOCKS_S)}\n|{'---|' * 6}")
    for file, found in zip(files, diagnoses, strict=False):
        judge = Judge(known & np.isin(columns, found.named.group.slots))
        print("\n".join(within(file, found, judge, columns, published_pa)))
    judge = Judge(known & np.isin(columns, diagnoses[0].named.group.slots))
    rows, panels = across(files, diagnoses[0], judge, columns, published_pa)
    head = " | ".join(
        f"{how}: {zero}"
        for how in ("row", "clock")
        for zero in ("first s", "constant", f"> {LATE_S:g} s", "and a past")
    )
    print(f"\n| from calibration_dataset | model | {head} |\n|{'---|' * 10}")
    print("\n".join(rows))
    if options.errors:
        write_text(options.errors, drawn(panels, "mean error, bar", -0.3, 0.3))
    if options.boards:
        write_text(options.boards, drawn(boards(files), "median count", 130.0, 250.0))


if __name__ == "__main__":
    main()
