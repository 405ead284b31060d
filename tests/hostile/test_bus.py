"""Whatever is on the bus: every frame is used or refused, and what is published is what every client takes."""

from __future__ import annotations

from dataclasses import asdict
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.config import Config
from insole_daemon.service.foot import load_feet
from insole_daemon.service.steps import StepEvents
from insole_daemon.skin.identifiers import CLASS_LEGACY_SKIN, CLASS_SECOND_HALF, CLASS_SKIN, TAG_A, TAG_B, skin_id
from insole_daemon.skin.reader import SkinReader

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000


def traffic(random, triangles):
    """Frames of some hundred ms: (id, payload, flags, pause before it in ns), whole cycles and anything else."""
    counts = random.choice([(240,), (0, 240, 255), range(256), range(60, 250)])
    for _ in range(40):
        if random.random() < 0.6:  # a cycle, of which halves may be missing or in another order
            halves = [(triangle, tag) for triangle in triangles for tag in (TAG_A, TAG_B) if random.random() < 0.995]
            if random.random() < 0.2:
                random.shuffle(halves)
            yield 0, b"", ERROR, random.choice([1, 5, 9, 9, 9, 9, 30, 400]) * MS
            for triangle, tag in halves:
                yield skin_id(triangle.board, triangle.triangle), bytes([tag, *random.choices(counts, k=7)]), 0, 111_000
        else:
            cls = random.choice([CLASS_SKIN, CLASS_LEGACY_SKIN, CLASS_SECOND_HALF, random.randrange(8)])
            payload = bytes([random.choice([TAG_A, TAG_B, random.randrange(256)]), *random.choices(counts, k=7)])
            flags = random.choice([0, 0, 0, EXTENDED, REMOTE, FD, ERROR])
            for _ in range(random.choice([1, 1, 5, 200])):
                can_id = cls << 8 | random.randrange(256)
                yield (
                    can_id,
                    payload[: random.choice([8, 8, 8, random.randrange(9)])],
                    flags,
                    random.choice([0, 111_000]),
                )


def batch_of(frames, began_ns, step_ns):
    """As the kernel hands them over; `step_ns`: by how much the wall clock is off."""
    t_mono_ns = began_ns + np.cumsum([pause_ns for *_, pause_ns in frames])
    data = np.frombuffer(b"".join(payload.ljust(8, b"\0") for _, payload, *_ in frames), np.uint8).reshape(-1, 8)
    return FrameBatch(
        START_NS + step_ns + t_mono_ns, t_mono_ns, np.zeros(len(frames), np.uint8),
        np.array([can_id for can_id, *_ in frames], np.uint32),
        np.array([len(payload) for _, payload, *_ in frames], np.uint8),
        data.copy(), np.array([flags for *_, flags, _ in frames], np.uint8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def layouts():
    return [foot.layout for foot in load_feet(Config())]


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32))
def test_every_frame_on_the_bus_is_counted_and_every_message_is_accepted(layouts, seed):
    random, feet = Random(seed), load_feet(Config())
    skin, steps = SkinReader(layouts, 20 * MS, 5 * MS), StepEvents(feet)
    frames = list(traffic(random, [triangle for layout in layouts for triangle in layout.triangles]))
    at, now_ns, step_ns = 0, 0, 0
    while at < len(frames):
        some = frames[at : at + random.choice([1, 30, 112, 500])]
        step_ns += random.choice([0] * 20 + [3_600_000 * MS, -3_600_000 * MS])
        batch = batch_of(some, now_ns, step_ns)
        at, now_ns = at + len(some), int(batch.t_mono_ns[-1])
        for closed in (skin.feed(batch), skin.advance(now_ns)):
            for foot, of_foot in zip(feet, closed, strict=True):
                published = [message for cycles in of_foot for message in everything(foot, steps, cycles)]
                for message in published:
                    assert type(message).decode(message.encode()).encode() == message.encode()
    for foot, assembler in zip(feet, skin.assemblers, strict=True):
        assert foot.seq > 10, "cycles were published"
        foot.survey(assembler, now_ns, foot.stale_after_ns)
    refused = asdict(skin.streams.refused)
    n_refused = sum(sum(count.values()) if isinstance(count, dict) else count for count in refused.values())
    assert sum(int(assembler.arrivals.sum()) for assembler in skin.assemblers) + n_refused == len(frames)


def everything(foot, steps, cycles):
    """All that the daemon publishes of these cycles."""
    for row in range(len(cycles)):
        values = foot.values(cycles, row)
        yield from values.messages().published()
        step = steps.take(foot, int(cycles.t_mono_ns[row]), values.load)
        yield from [] if step is None else [step]
        yield from foot.fault_events()
