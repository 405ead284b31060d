"""What boards sent and what a subscriber got of it, side by side: rate, recovery, losses."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import msgpack
import numpy as np

from benchmarks.faults.matrix import numbers
from insole_daemon.skin.layout import Layout
from insole_daemon.wire.messages import Event, Health, Raw

FRESH_NS = 100_000_000  # from the bus to the subscriber; on one slow processor that three processes share
WINDOW_NS = 1_000_000_000  # of full rate, to say that it is back
CYCLES, SHARE = 48, 0.98  # of 50 in that time, and of their readings that are fresh
RHYTHM_NS = 14_000_000, 26_000_000  # between a board's ticks; else the processor stalled the board, and it bursts


@dataclass(frozen=True)
class Foot:
    """One foot: readings (n_cycles, n_triangles) as they were got, and what was on the bus."""

    raws: list[Raw]
    got_ns: np.ndarray  # (n,) monotonic
    number: np.ndarray  # (n, n_triangles, 2) of halves A and B
    sent_ns: dict[tuple[int, int], np.ndarray]  # by (triangle row, half): monotonic, by number; 0 where not sent
    boards: np.ndarray  # (n_triangles,)

    def fresh(self) -> np.ndarray:
        """(n, n_triangles) both halves were sent not long before; by their age where they bear no number."""
        fresh = np.zeros(self.number.shape[:2], np.bool_)
        age_ms = np.array([raw.age_ms for raw in self.raws])
        for row in range(self.number.shape[1]):
            older = np.full(len(self.raws), np.iinfo(np.int64).max)
            for half, bits in enumerate((numbers.A_BITS, numbers.B_BITS)):
                sent = self.sent_ns[row, half]
                number = unwrapped(self.number[:, row, half], sent, self.got_ns, bits)
                older = np.minimum(older, np.where(number >= 0, sent[np.maximum(number, 0)], 0))
            fresh[:, row] = self.got_ns - older < FRESH_NS
            unknown = (self.number[:, row] == numbers.NONE).any(axis=1)
            fresh[unknown, row] = age_ms[unknown, row] < FRESH_NS * 1e-6
        return fresh

    def valid(self) -> np.ndarray:
        """(n,) share of taxels that are valid."""
        return np.array([raw.valid.mean() for raw in self.raws])

    def lost_ns(self) -> np.ndarray:
        """When a board that kept its rhythm sent what was never published, a row a tick of a board, ns."""
        lost = []
        for row, board in enumerate(self.boards.tolist()):
            for half, bits in enumerate((numbers.A_BITS, numbers.B_BITS)):
                sent = self.sent_ns[row, half]
                there = np.flatnonzero(sent)
                if len(there) < 3:
                    continue
                apart = np.diff(sent[there])
                steady = (apart > RHYTHM_NS[0]) & (apart < RHYTHM_NS[1])
                kept = np.concatenate([[False], steady[1:] & steady[:-1], [False]])
                got = unwrapped(self.number[:, row, half], sent, self.got_ns, bits)
                lost += [(board, int(sent[n])) for n in np.setdiff1d(there[kept], got).tolist()]
        ticks = {(board, t_ns // 20_000_000): t_ns for board, t_ns in lost}
        return np.array(sorted(ticks.values()), np.int64)


def unwrapped(low: np.ndarray, sent: np.ndarray, got_ns: np.ndarray, bits: int) -> np.ndarray:
    """The whole numbers of which `low` (n,) are the lowest bits: the newest that was sent before it was got."""
    there = np.flatnonzero(sent)
    if not len(there):
        return np.full(len(low), numbers.NONE)
    newest = there[np.maximum(np.searchsorted(sent[there], got_ns) - 1, 0)]
    number = newest - ((newest - low) & ((1 << bits) - 1))
    return np.where((low < 0) | (number < 0), numbers.NONE, number)


@dataclass(frozen=True)
class Seen:
    """Of one run."""

    feet: dict[str, Foot]
    events: list[tuple[int, Event]]
    healths: list[tuple[int, Health]]


def load(messages: Path, sent: Path, layouts: dict[str, Layout]) -> Seen:
    """Read what subscriber.py and boards.py wrote."""
    kinds = {cls.SCHEMA: cls for cls in (Raw, Event, Health)}
    decoded = [
        (t_ns, kinds[schema].decode(payload))
        for t_ns, schema, payload in msgpack.unpackb(messages.read_bytes(), strict_map_key=False)
    ]
    feet = {}
    with np.load(sent, allow_pickle=False) as archive:
        for foot, layout in layouts.items():
            mine = [(t_ns, m) for t_ns, m in decoded if isinstance(m, Raw) and m.foot == foot]
            raws = [raw for _, raw in mine]
            counts = np.array([raw.counts for raw in raws]).reshape(-1, len(layout), 12)
            number = np.stack([numbers.read(counts[..., :7]), numbers.read(counts[..., 7:])], axis=-1)
            rows = archive[foot]
            sent_ns = {}
            for row, triangle in enumerate(layout.triangles):
                for half in (0, 1):
                    own = rows[(rows[:, 0] & 0xFF == triangle.board << 4 | triangle.triangle) & (rows[:, 1] == half)]
                    by_number = np.zeros(own[:, 2].max() + 1 if len(own) else 1, np.int64)
                    by_number[own[:, 2]] = own[:, 3]
                    sent_ns[row, half] = by_number
            boards = np.array([triangle.board for triangle in layout.triangles])
            feet[foot] = Foot(raws, np.array([t_ns for t_ns, _ in mine]), number, sent_ns, boards)
    return Seen(
        feet,
        [(t_ns, m) for t_ns, m in decoded if isinstance(m, Event)],
        [(t_ns, m) for t_ns, m in decoded if isinstance(m, Health)],
    )


def back_s(foot: Foot, after_ns: int, good: np.ndarray, end_ns: int) -> float | None:
    """Seconds from `after_ns` until a second of full rate begins in which `good` (n,) holds; None: never."""
    for at in np.flatnonzero(foot.got_ns >= after_ns).tolist():
        t_ns = foot.got_ns[at]
        if t_ns + WINDOW_NS > end_ns:
            return None
        until = int(np.searchsorted(foot.got_ns, t_ns + WINDOW_NS))
        if until - at >= CYCLES and good[at:until].mean() >= SHARE and good[at]:
            return float(t_ns - after_ns) * 1e-9
    return None


def kinds(events: list[tuple[int, Event]], from_ns: int, until_ns: int) -> str:
    """What was told in that time, in order, each kind once with how often."""
    counts = Counter(event.kind for t_ns, event in events if from_ns <= t_ns < until_ns and not event.figures)
    return ", ".join(f"`{kind}`" + (f" × {n}" if n > 1 else "") for kind, n in counts.items())
