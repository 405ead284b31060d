"""A published chamber recording through the daemon's live path, with the model that `insole diagnose` found in another.

    python -m benchmarks.published_data.live_path [--folder ../shared/data/belli2023]

The model is fitted to `calibration_dataset`, in each of the two families that it cannot tell apart, and given to a foot
of the daemon as its calibration; its baselines are zeroed on the file's first second, as `insole zero` does. The counts
of the file are sent as CAN frames at the times of its rows through the reader, the watch of faults and the foot, cycle
by cycle. What it publishes is judged as in diagnosis/belli2023.py: mean pressure of the healthy taxels against the
gauge, by the clocks. Beside it the same model offline: the exact inverse of counts that have the published smoothing,
by which they are 0.18 s late, and of counts as they were read, which is what live has.

Takes about 5 minutes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.diagnosis.belli2023 import Array, Found, Judge, Model, rms
from benchmarks.published_data.belli2023 import CALIBRATION, FOLDER, Trial, read, slots
from benchmarks.published_data.calibration import JUDGED, Paired, by_clock, fitted_clock, published
from benchmarks.published_data.healthy_taxels import healthy
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.calibration import follow_up
from insole_daemon.config import Config
from insole_daemon.files import write_text
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.zero import Zero
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import FootSetup
from insole_daemon.skin.geometry import N_TAXELS
from insole_daemon.skin.layout import Layout
from insole_daemon.skin.reader import SkinReader

START_NS = 1_600_000_000_000_000_000
FRAME_NS = 120_000
SMOOTHED_S = (
    0.02 * (1 - follow_up.COUNT_SHARE) / follow_up.COUNT_SHARE
)  # the clocks have that of smoothed counts in them
WORDS = ("creep", "hysteresis")


def frames(layout: Layout, trial: Trial) -> FrameBatch:
    """Every row as the halves of all triangles, status 0."""
    n, rows = len(layout), len(trial.t_s)
    counts = np.full((rows, n * N_TAXELS), 240, np.uint8)
    counts[:, slots(layout)] = trial.counts
    counts = counts.reshape(rows, n, N_TAXELS)
    data = np.zeros((rows, n, 2, 8), np.uint8)
    data[:, :, 0, 0], data[:, :, 1, 0] = 0x40, 0xC0
    data[:, :, 0, 1:], data[:, :, 1, 1:6] = counts[:, :, :7], counts[:, :, 7:]
    board, triangle = layout.identities.astype(np.uint32).T
    can_id = np.repeat(0x400 | board << 4 | triangle, 2)
    t_ns = START_NS + np.rint(trial.t_s * 1e9).astype(np.int64)
    times = (t_ns[:, None] + FRAME_NS * np.arange(2 * n)).ravel()
    return FrameBatch(
        t_ns=times, t_mono_ns=times.copy(), interface=np.zeros(times.size, np.uint8),
        can_id=np.tile(can_id, rows), dlc=np.full(times.size, 8, np.uint8), data=data.reshape(-1, 8),
        flags=np.zeros(times.size, np.uint8),
    )  # fmt: skip


class Live:
    """What a foot of the daemon publishes of a file, by the static and the dynamic model."""

    def __init__(self, document: dict[str, Any], layout: Layout, trial: Trial, moved_count: Array) -> None:
        """`moved_count` (n_triangles · 12,): by how much this file rests elsewhere than the model's."""
        insole = Config().insoles[0]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.json"
            write_text(path, json.dumps(document))
            calibration = calibrations.load(path, layout)
        baseline = calibration.baseline_count + moved_count.reshape(len(layout), N_TAXELS)
        zero = Zero("left", START_NS, baseline, np.ones_like(baseline))
        foot = Foot(FootSetup(Config(), insole, layout, calibration, zero, "first second"))
        (closed,) = SkinReader([layout], period_ns=20_000_000, slack_ns=5_000_000).feed(frames(layout, trial))
        t_s, static, dynamic = [], [], []
        for cycles in closed:
            for at in range(len(cycles)):
                both = foot.messages(cycles, at).models
                foot.fault_events()
                assert both is not None
                t_s.append((int(cycles.t_mono_ns[at]) - START_NS) * 1e-9)
                static.append(np.where(both.static_valid, both.static_pressure_pa, np.nan).ravel())
                dynamic.append(np.where(both.dynamic_valid, both.dynamic_pressure_pa, np.nan).ravel())
        self._t_s, self.static, self.dynamic = np.array(t_s), np.array(static), np.array(dynamic)

    def at(self, of: Array, t_s: Array, columns: NDArray[np.intp]) -> Array:
        """(n, m) of `of` what had been published last when the frames of each row in `t_s` (n,) were in.

        The clocks were fitted to smoothed counts, which are late; what is published live is not.
        """
        row = np.searchsorted(self._t_s, t_s - SMOOTHED_S + 2 * 28 * FRAME_NS * 1e-9, side="right") - 1
        return of[row.clip(0)][:, columns]


def said(name: str, pressure_pa: Array, judge: Judge, paired: Paired) -> str:
    """A row of the table."""
    mean = judge.mean(pressure_pa, paired)
    first = paired.t_s < paired.t_s[0] + 1.0
    error = mean - float(np.nanmean(mean[first])) - paired.load_pa
    return f"| {name} | {rms(error) / 1e5:.4f} | {float(np.nanstd(error)) / 1e5:.4f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="with left_insole and results")
    options = parser.parse_args()
    trials = [read(options.folder / CALIBRATION.parent / name) for name in (CALIBRATION.name, JUDGED[0])]
    chosen = healthy(trials[0])
    published_pa, known = published(options.folder, chosen)
    trained, judged = (by_clock(each, chosen, fitted_clock(each, chosen)) for each in trials)
    columns = slots(trials[0].layout)[chosen.taxels]
    found = Found(options.folder / CALIBRATION)
    judge = Judge(known & np.isin(columns, found.named.group.slots))
    print("| validation_dataset_1, mean pressure | zero of the first second, bar | one constant, bar |\n|---|---|---|")
    shifted = judged.counts - judged.rest_count + trained.rest_count
    print(said("published model", follow_up.estimate_pressure(shifted, published_pa), judge, judged))
    moved = np.zeros(len(found.layout) * N_TAXELS)
    moved[columns] = judged.rest_count - trained.rest_count
    for words in WORDS:
        document = found.document(found.tried[(words,)])
        offline = Model(document, found)
        smoothed = offline(judged, columns, trained.rest_count)
        print(said(f"{words}, offline: exact inverse of counts smoothed over 0.18 s", smoothed, judge, judged))
        as_read = offline(judged, columns, trained.rest_count, 1.0)
        print(said(f"{words}, offline: exact inverse of counts as live has them", as_read, judge, judged))
        live = Live(document, found.layout, trials[1], moved)
        print(said(f"{words}, live: static", live.at(live.static, judged.t_s, columns), judge, judged))
        print(said(f"{words}, live: dynamic", live.at(live.dynamic, judged.t_s, columns), judge, judged), flush=True)


if __name__ == "__main__":
    main()
