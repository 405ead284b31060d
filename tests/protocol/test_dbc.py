"""skin.dbc, as cantools reads it, against the package's own reading of every skin frame of the golden logs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cantools
import numpy as np
import oracle
import pytest
from pipeline import GOLDEN, NAMES, log_of

from insole_daemon.bus.candump import read
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.skin.assembler import CycleAssembler
from insole_daemon.skin.identifiers import CLASS_LEGACY_SKIN, CLASS_SECOND_HALF, CLASS_SKIN, TAG_A, TAG_B, skin_id
from insole_daemon.skin.layout import load
from insole_daemon.skin.streams import Streams

DBC = oracle.PROTOCOL / "skin.dbc"
MS = 1_000_000


def skin_frames(name: str) -> FrameBatch:
    """The frames of a golden log that carry a half, by the package's own account."""
    frames = read(log_of(name)).frames
    slots = Streams([load(GOLDEN / f"{foot}.yaml") for foot in ("left", "right")]).slots(frames)
    return frames[slots >= 0]


def cycles_of_pairs(data_a: np.ndarray, data_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """counts (n, 12) and status (n,) of n pairs of halves, by the package: one triangle, a pair a cycle."""
    n = len(data_a)
    data = np.stack([data_a, data_b], axis=1).reshape(2 * n, 8)
    t_ns = np.repeat(np.arange(n), 2) * 20 * MS + np.tile([0, MS], n)
    assembler = CycleAssembler(np.array([5], np.uint8), 20 * MS, 5 * MS)
    closed = assembler.feed(np.tile(np.array([0, 1], np.int16), n), data, t_ns, t_ns)
    counts = np.concatenate([cycles.counts[:, 0] for cycles in closed])
    status = np.concatenate([cycles.status[:, 0] for cycles in closed])
    assert len(counts) == n
    return counts, status


@pytest.mark.parametrize("name", NAMES)
def test_every_skin_frame_reads_the_same(name: str) -> None:
    frames = skin_frames(name)
    assert len(frames) > 400
    data_a, data_b = (frames.data[frames.data[:, 0] == tag] for tag in (TAG_A, TAG_B))
    n = max(len(data_a), len(data_b))
    counts, status = cycles_of_pairs(np.resize(data_a, (n, 8)), np.resize(data_b, (n, 8)))
    for data, of_half in zip(data_a, counts[: len(data_a), :7].tolist(), strict=True):
        signals = oracle.decode(data.tobytes())
        assert signals.pop("Half") == TAG_A
        assert signals == {f"Taxel{taxel}": count for taxel, count in enumerate(of_half)}
    for data, of_half, word in zip(data_b, counts[: len(data_b), 7:].tolist(), status.tolist(), strict=False):
        signals = oracle.decode(data.tobytes())
        assert signals["Half"] == TAG_B
        assert [signals[f"Taxel{taxel}"] for taxel in range(7, 12)] == of_half
        assert oracle.status_word(signals) == word


def test_the_mask_finds_every_board_and_triangle_of_class_4_and_nothing_else() -> None:
    database = cantools.database.load_file(DBC, frame_id_mask=0x700)
    for board in range(1, 15):
        for triangle in range(16):
            assert database.get_message_by_frame_id(skin_id(board, triangle)).name == "SkinTriangle"
            for cls in (CLASS_LEGACY_SKIN, CLASS_SECOND_HALF):
                with pytest.raises(KeyError):
                    database.get_message_by_frame_id(skin_id(board, triangle, cls))
    assert database.messages[0].frame_id == CLASS_SKIN << 8
    assert database.messages[0].length == 8


def test_every_signal_is_explained_and_counts_have_their_unit() -> None:
    (message,) = cantools.database.load_file(DBC, frame_id_mask=0x700).messages
    for signal in message.signals:
        assert signal.comment, signal.name
        assert signal.unit == ("count" if signal.name.startswith("Taxel") else None), signal.name
    assert message.comment


def test_cantools_on_the_command_line(tmp_path: Path) -> None:
    """What the README says to type."""
    lines = log_of("walk").read_text().splitlines(keepends=True)[:20]
    decoded = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "-s", "-m", "0x700", str(DBC)],
        input="".join(lines), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert decoded.stdout.count("SkinTriangle(Half: ") == 20
    assert "Taxel0: " in decoded.stdout
