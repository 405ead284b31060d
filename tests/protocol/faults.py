"""The golden log of all that goes wrong: on the right foot, one thing after another."""

from __future__ import annotations

from logs import Frame, emulate, faulty_insole, ticks

from insole_daemon.simulation.foot import Stand

# Frames that carry no half of the right foot's triangles, as candump writes them.
STRANGERS = """
    4C3#40E0E0E0E0E0E0E0 4C3#C0E0E0E0E0E00000 4F0#41E0E0E0E0E0E0E0 400#40E0E0E0E0E0E0E0
    450#40E0E0E0E0E0E0E0 450#C0E0E0E0E0E00000
    482#40E0E0E0E0E0E0E0 482#C0E0E0E0E0E00000 480#41E0E0E0E0E0E0E0 482#00E0E0E0E0E0E0E0 4A0#80E0E0E0E0E00000
    480# 480#40 480#40E0 480#40E0E0 480#40E0E0E0 480#40E0E0E0E0 480#C0E0E0E0E0E0 480#C0E0E0E0E0E000 4C3#4040
    38E#0112001200 380#40E0E0E0E0E0E0 380#01E0E0E0E0E0E0E0 382#40E0E0E0E0E0E0E0 3D1#AABBCCDDEEFF
    583#C0E0E0E0E0E00000 208#4D0014F0 208#0700 280#1C0B010203020001 70F#FF 780#FF0B010203
    785# 785# 7C5# 785#00 786# 100#C0E0E0E0E0E00000 680#40E0E0E0E0E0E0E0
    480#R8 480#R 785#R 00000480#R4 00000480#40E0E0E0E0E0E0E0 00000480#40
    20000004#0004000000000000 20000480#40E0E0E0E0E0E0E0 20000088#0000080000000000
    480##140E0E0E0E0E0E0E0 480##1C0E0E0E0E0E0000000000000 00000480##140E0E0E0E0E0E0E0
"""

OPEN_A, OPEN_B = "40" + "00" * 7, "C00000FF0000"  # an open triangle, skin type 0: all 0 but taxel 9
DEAD_A, DEAD_B = "40" + "FF" * 7, "C0FFFF00FFFF"  # a dead converter: the other way round

# (tick, board, triangle, what byte of a payload it begins at, bytes)
SPOILT = [
    (1, 8, 0, "A", 0, DEAD_A), (1, 8, 0, "B", 0, DEAD_B + "0001"),
    (2, 8, 1, "A", 0, OPEN_A), (2, 8, 1, "B", 0, OPEN_B + "0002"),
    (3, 8, 1, "A", 0, OPEN_A), (3, 8, 1, "B", 0, OPEN_B + "FFF2"),
    (2, 8, 14, "A", 0, OPEN_A), (2, 8, 14, "B", 0, OPEN_B + "0000"),  # nothing but the data say so
    (2, 9, 4, "A", 0, OPEN_A), (2, 9, 4, "B", 0, OPEN_B + "0000"),  # 255 is at rest here
    (3, 8, 4, "B", 6, "8110"),  # out of range: taxels 11, 4 and 0
    (3, 9, 5, "A", 1, "FFF0FEFF80FFFF"), (3, 9, 5, "B", 6, "FFF0"),  # at rest the flag says nothing
    (3, 10, 9, "B", 6, "FFF0"),  # nor at shift 7
    (3, 8, 6, "A", 1, "00FF01FE"),  # saturated, and below the range
    (3, 8, 8, "B", 6, "0004"), (3, 8, 9, "B", 6, "0008"), (4, 8, 9, "B", 6, "0003"),
]  # fmt: skip

# (first tick, last tick, board, triangle, halves) that do not arrive
LOST = [
    (5, 5, 8, 10, "B"),  # one half, once
    (9, 14, 10, 3, "B"),  # given up after three, and back
    (12, 23, 8, 15, "AB"),  # until it is stale
]

DOUBLED = [(7, 8, 11, "A"), (7, 8, 11, "A"), (8, 9, 15, "B"), (17, 10, 14, "B")]

SILENCE = range(25, 37)  # ticks without any board
STEP_TICK, STEP_US = 20, 300_000  # where CLOCK_REALTIME goes back, and how far


def make() -> list[Frame]:
    """Everything above, in 0.8 s."""
    frames = emulate([faulty_insole()], Stand, 0.1, 0.8, seed=5)
    by_board = {board: ticks(frames, board) for board in (8, 9, 10)}
    where = {
        (number, *frame.half): frame
        for board in by_board
        for number, tick in enumerate(by_board[board])
        for frame in tick
    }
    for tick, board, triangle, half, first, text in SPOILT:
        part = bytes.fromhex(text)
        where[tick, board, triangle, half].data[first : first + len(part)] = part
    lost = {
        id(where[tick, board, triangle, half])
        for first, last, board, triangle, halves in LOST
        for tick in range(first, last + 1)
        for half in halves
    }
    lost |= {id(frame) for (tick, *_), frame in where.items() if tick in SILENCE}
    more = []
    for number, (tick, board, triangle, half) in enumerate(DOUBLED):
        original = where[tick, board, triangle, half]
        data = bytearray(original.data)
        data[2] ^= 0x11
        more.append(Frame(original.t_us + 31 + number, original.can_id, data))
    between = [tick[0].t_us - 40 for tick in by_board[9][1:20]]
    for number, text in enumerate(STRANGERS.split()):
        more.append(Frame(between[number % len(between)] + number, 0, bytearray(), text))
    kept = sorted([*(frame for frame in frames if id(frame) not in lost), *more])
    step_us = where[STEP_TICK, 9, 4, "A"].t_us
    for frame in kept:
        if frame.t_us >= step_us:
            frame.t_us -= STEP_US
    return kept
