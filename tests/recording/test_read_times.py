"""Read times of boards with any periods, with lost frames and slow converters, in logs and tables."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import insole_daemon
from insole_daemon.recording.loading import FootRecording, Recording
from insole_daemon.recording.read_times import at_cycles, find_repeated_conversions

BOARDS = (5, 6, 7)
TRIANGLES = (12, 5, 11)
LENGTH_S = 10.0
NOISE = 0.7


@dataclasses.dataclass
class _Sent:
    """The frames of a made-up insole; `told_ms` is the period in recording.yaml."""

    period_ms: tuple[float, float, float]
    told_ms: tuple[int, int, int] | None = None
    converter_ms: float = 0.0  # a new conversion no more often
    lost: tuple[tuple[int, float, float], ...] = ()  # board, from, to: its frames are not there
    noise: float = NOISE

    def write(self, folder: Path) -> Recording:
        rng = np.random.default_rng(3)
        lines: list[tuple[float, str]] = []
        for number, (board, n, period_ms) in enumerate(zip(BOARDS, TRIANGLES, self.period_ms, strict=True)):
            sent_s = 0.004 * number + np.arange(0.0, LENGTH_S, period_ms * 1e-3)
            sent_s += rng.normal(0.0, 2e-4, len(sent_s))
            conversion = np.arange(len(sent_s))
            if self.converter_ms:
                conversion = (sent_s // (self.converter_ms * 1e-3)).astype(int)
            _, conversion = np.unique(conversion, return_inverse=True)
            level = 240.0 - 60.0 * np.sin(0.4 * sent_s) ** 2
            noise = rng.normal(0.0, self.noise, (conversion.max() + 1, n, 12))
            first = np.unique(conversion, return_index=True)[1]
            counts = np.rint(level[first][conversion][:, None, None] + noise[conversion]).astype(int)
            lost = [(a, b) for text, a, b in self.lost if text == board]
            for at, t in enumerate(sent_s.tolist()):
                if any(a <= t < b for a, b in lost):
                    continue
                for triangle in range(n):
                    values = counts[at, triangle]
                    for half, payload in enumerate(([0x40, *values[:7]], [0xC0, *values[7:], 0, 0])):
                        when = t + 1e-4 * (2 * triangle + half)
                        data = "".join(f"{int(value):02X}" for value in payload)
                        lines.append((when, f"({1.7e9 + when:.6f}) can0 {0x400 | board << 4 | triangle:03X}#{data}\n"))
        folder.mkdir(parents=True)
        (folder / "can.log").write_text("".join(line for _, line in sorted(lines)))
        triangles = "\n".join(
            f"  - {{board: {board}, triangle: {t}, patch: front, x_mm: {20.0 * t}, y_mm: {30.0 * i}, rotation_deg: 0}}"
            for i, (board, n) in enumerate(zip(BOARDS, TRIANGLES, strict=True))
            for t in range(n)
        )
        (folder / "layout.yaml").write_text(
            f"format: insole-layout/1\nfoot: left\ntaxel_area_mm2: 32.4\ntriangles:\n{triangles}\n"
        )
        stated_ms = self.told_ms or tuple(map(round, self.period_ms))
        boards = "\n".join(
            f"      - {{address: {board}, interface: can0, period_ms: {ms}, shift: 3, no_load: 240, skin_type: 0}}"
            for board, ms in zip(BOARDS, stated_ms, strict=True)
        )
        (folder / "recording.yaml").write_text(
            "format: insole-recording/1\nkind: free\ncan: can.log\ncan_origin: simulated\ninsoles:\n"
            f"  - foot: left\n    layout: layout.yaml\n    boards:\n{boards}\n"
        )
        return insole_daemon.load(folder)

    def foot(self, folder: Path) -> FootRecording:
        return self.write(folder)["left"]


def _of_board(foot: FootRecording, board: int) -> NDArray[np.bool_]:
    is_on_board: NDArray[np.bool_] = foot.layout.identities[:, 0] == board
    return is_on_board


def _new_per_s(foot: FootRecording, board: int) -> float:
    return float(np.median(foot.is_new[:, _of_board(foot, board)].sum(axis=0))) / LENGTH_S


@pytest.mark.parametrize(
    "period_ms",
    [(5, 5, 5), (10, 10, 10), (20, 20, 20), (37, 37, 37), (50, 50, 50), (255, 255, 255), (20, 50, 50), (5, 37, 255)],
)
def test_every_reading_is_new_once_and_none_is_missing(tmp_path: Path, period_ms: tuple[float, float, float]) -> None:
    foot = _Sent(period_ms).foot(tmp_path / "trial")
    assert not foot.missing.any()
    assert not foot.late.any()
    assert float(np.median(np.diff(foot.t_ns))) * 1e-6 == pytest.approx(min(period_ms), rel=0.05)
    for board, ms in zip(BOARDS, period_ms, strict=True):
        assert _new_per_s(foot, board) == pytest.approx(1e3 / ms, rel=0.05)
        behind_ms = foot.behind_ns[10:][foot.is_new[10:, _of_board(foot, board)].any(axis=1)] * 1e-6
        assert behind_ms[:, _of_board(foot, board)].max() < ms + 8.0


@pytest.mark.parametrize("ms", [10, 20, 50, 255])
def test_only_a_lost_reading_is_missing(tmp_path: Path, ms: int) -> None:
    foot = _Sent((20, ms, 20), lost=((6, 4.0, 4.0 + 2.5e-3 * ms), (6, 8.0, 8.0 + 1e-3 * ms))).foot(tmp_path / "trial")
    triangles = _of_board(foot, 6)
    assert not foot.missing[:, ~triangles].any()
    assert foot.missing[:, triangles].sum(axis=0) == pytest.approx(3, abs=1)
    at_s = (foot.t_ns - foot.t_ns[0])[foot.missing[:, triangles].any(axis=1)] * 1e-9
    assert np.all((np.abs(at_s - 4.0) < 4e-3 * ms + 0.03) | (np.abs(at_s - 8.0) < 3e-3 * ms + 0.03))


@pytest.mark.parametrize("period_ms", [(10, 10, 10), (20, 20, 20), (20, 50, 50)])
def test_repeated_conversions_are_not_new_readings(tmp_path: Path, period_ms: tuple[float, float, float]) -> None:
    recording = _Sent(period_ms, converter_ms=37.0).write(tmp_path / "trial")
    foot = recording["left"]
    assert _new_per_s(foot, 5) == pytest.approx(1 / 0.037, rel=0.05)
    assert not foot.missing.any()
    assert any("board 5 sends every" in text and "new readings" in text for text in recording.warnings)


def test_frames_override_a_wrong_configured_period(tmp_path: Path) -> None:
    recording = _Sent((50, 50, 50), told_ms=(20, 50, 50)).write(tmp_path / "trial")
    assert not recording["left"].missing.any()
    assert [text.partition("board ")[2] for text in recording.warnings] == [
        "5 sends every 50 ms, recording.yaml says 20: its frames are believed"
    ]


def test_readings_equal_by_chance_are_new() -> None:
    rng = np.random.default_rng(5)
    quiet = np.rint(200.3 + rng.normal(0.0, 0.15, (4000, 12))).astype(np.uint8)
    assert find_repeated_conversions(quiet).mean() < 0.01
    loud = np.rint(200.0 + rng.normal(0.0, 0.5, (4000, 12))).astype(np.uint8)
    repeated = loud.copy()
    repeated[1::7] = repeated[0::7][: len(repeated[1::7])]
    assert find_repeated_conversions(repeated)[1::7].mean() > 0.99
    assert find_repeated_conversions(repeated).sum() <= find_repeated_conversions(repeated)[1::7].sum() + 4


def test_repeated_readings_are_interpolated_between_new_ones() -> None:
    cycle_s = np.arange(8) * 0.02
    truth = np.array([10, 20, 30, 40, 50, 60, 70, 80], np.uint8)[:, None]
    repeated = truth.copy()
    repeated[[3, 4]] = 30
    is_new = np.ones((8, 1), bool)
    is_new[[3, 4]] = False
    assert np.array_equal(at_cycles(repeated, is_new, cycle_s, np.zeros((8, 1))), truth)
    early = at_cycles(repeated, is_new, cycle_s, np.full((8, 1), 0.01))  # each was read half a cycle before
    assert np.allclose(early[:-1], truth[:-1] + 5.0)
