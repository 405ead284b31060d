"""Faults that the daemon detects in the published insole recording of Belli et al. 2023, replayed as frames.

    python -m benchmarks.published_data.faults [folder with the data, ../shared/data/belli2023]

Its 16 × 12 words of three boards are sent again as class 4 frames without status bits, 28 triangles at the times of
its rows, and read as a right insole of the built-in layout. Prints which triangles were found loose, when, and how
often a triangle that stands on the rails was valid.

Takes about a minute.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Config
from insole_daemon.physics import calibration as calibrations
from insole_daemon.service.foot import Foot
from insole_daemon.service.foot_setup import FootSetup, load_layout
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Event

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "belli2023"
FILE = Path("right_insole", "experiment_3September_allTaxels_dynamic_pink_2_just4Testing.mat")
START_NS = 1_600_000_000_000_000_000
FRAME_NS = 120_000
CONFIG = Config()
INSOLE = CONFIG.insoles[1]
LAYOUT = load_layout(INSOLE)
ON_RAILS = 10  # words at 0 or 255: what no triangle that is there reads


class Found(NamedTuple):
    """What came of a recording."""

    t_s: NDArray[np.float64]  # (n,) of the cycles
    counts: NDArray[np.uint8]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12)
    f_z_n: NDArray[np.float64]  # (n,)
    events: list[Event]


def frames(folder: Path, n_rows: int | None = None) -> FrameBatch:
    """The first rows of the recording as frames: 28 triangles, halves A and B, status 0."""
    recorded = loadmat(folder / FILE, simplify_cells=True)["experiment"]["C"][:n_rows]
    t_ns = START_NS + np.rint((recorded[:, 1] - recorded[0, 1]) * 1e9).astype(np.int64)
    words = recorded[:, 2:].astype(np.uint8).reshape(len(recorded), 3, 16, 12)
    n = len(LAYOUT)
    data = np.zeros((len(recorded), n, 2, 8), np.uint8)
    data[:, :, 0, 0], data[:, :, 1, 0] = 0x40, 0xC0
    can_id = np.zeros((n, 2), np.uint32)
    for row, triangle in enumerate(LAYOUT.triangles):
        counts = words[:, INSOLE.addresses.index(triangle.board), triangle.triangle]
        data[:, row, 0, 1:] = counts[:, :7]
        data[:, row, 1, 1:6] = counts[:, 7:]
        can_id[row] = 0x400 | triangle.board << 4 | triangle.triangle
    times = (t_ns[:, None] + FRAME_NS * np.arange(2 * n)).ravel()
    return FrameBatch(
        t_ns=times,
        t_mono_ns=times.copy(),
        interface=np.zeros(times.size, np.uint8),
        can_id=np.tile(can_id.ravel(), len(recorded)),
        dlc=np.full(times.size, 8, np.uint8),
        data=data.reshape(-1, 8),
        flags=np.zeros(times.size, np.uint8),
    )


def play(folder: Path, n_rows: int | None = None) -> Found:
    """The recording through reader and foot."""
    foot = Foot(FootSetup(CONFIG, INSOLE, LAYOUT, calibrations.default(LAYOUT, INSOLE.boards), None, "none"))
    (closed,) = SkinReader([LAYOUT], period_ns=20_000_000, slack_ns=5_000_000).feed(frames(folder, n_rows))
    t_s, counts, valid, f_z_n, events = [], [], [], [], []
    for cycles in closed:
        for at in range(len(cycles)):
            raw, _, wrench, _ = foot.messages(cycles, at)
            events += foot.fault_events()
            t_s.append((int(cycles.t_mono_ns[at]) - START_NS) * 1e-9)
            counts.append(raw.counts)
            valid.append(raw.valid.astype(bool))
            f_z_n.append(wrench.f_z_n)
    return Found(np.array(t_s), np.array(counts), np.array(valid), np.array(f_z_n), events)


def on_rails(counts: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n, n_triangles) whether a triangle reads what no load makes it read."""
    return ((counts == 0) | (counts == 255)).sum(axis=2) >= ON_RAILS


def main() -> None:
    played = play(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
    rails = on_rails(played.counts)
    print(f"{played.t_s[-1]:.0f} s, {len(played.t_s)} cycles, {rails.mean() * 100:.1f} % of triangle-rows on the rails")
    for row, triangle in enumerate(LAYOUT.triangles):
        where = (triangle.board, triangle.triangle)
        times = [
            f"{'' if e.kind == 'triangle_loose' else 'until '}{(e.t_ns - START_NS) * 1e-9:.2f} s"
            for e in played.events
            if e.kind.startswith("triangle_loose") and (e.boards[0], e.triangle) == where
        ]
        first = played.t_s[rails[:, row].argmax()] if rails[:, row].any() else None
        print(
            f"board {where[0]} triangle {where[1]:2}: on the rails in {rails[:, row].sum():5} cycles"
            + (f", first {first:.2f} s" if first is not None else "")
            + (f"; loose {', '.join(times[:9])}{' …' if len(times) > 9 else ''}" if times else "")
        )
    entered = (played.valid[..., PRESSURE_TAXELS].any(axis=2) & rails).sum()
    print(f"cycles in which a triangle on the rails had a valid taxel: {entered}")
    others = [e for e in played.events if not e.kind.startswith(("triangle_loose", "board_streaming"))]
    print(f"other events: {len(others)}")
    for event in others[:40]:
        print(f"  {(event.t_ns - START_NS) * 1e-9:.2f} s {event.text}")


if __name__ == "__main__":
    main()
