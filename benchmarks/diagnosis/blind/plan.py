"""Which cases a suite holds. What is concealed in case 17 depends on the seed alone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .effect import SOLVED, UNKNOWN
from .faults import FAULTS

RECORDINGS = ("chamber", "walk")
# Of the suite `all`, by number of cases.
_SHARES = {
    "null": 30,
    "single": 32,
    "faint": 8,
    "local": 8,
    "pair": 12,
    "triple": 6,
    "simulation": 10,
    "unknown": 9,
    "undecidable": 3,
}
SUITES = ("all", "bench", *RECORDINGS, "walking", *_SHARES)
# What a trial cannot tell apart whose load repeats one cycle for ever, or whose temperature only rises.
EQUIVALENT = {
    "sine": ("hysteresis", "creep", "viscoelasticity", "lag", "delay"),
    "ramps": ("hysteresis", "creep", "viscoelasticity"),
    "warm": ("temperature", "drift"),
}
_MOVED = ("swapped_triangles", "map_transform")
# Words that a recording can show. Under a uniform load nothing is anywhere else, and a preload is a baseline.
SHOWN = {
    "chamber": tuple(w for w in SOLVED if w not in (*_MOVED, "crosstalk", "preload")),
    "walk": tuple(w for w in SOLVED if w != "crosstalk"),
}
SHOWN_BY_PAIR = tuple(w for w in SOLVED if w not in ("clock", "lag"))
_NEVER_TOGETHER = (
    {"lag", "delay"},
    {"lag", "clock"},
    {"delay", "clock"},
    {"rezero", "baseline"},
    {"swapped_triangles", "map_transform"},
    *(
        {a, b}
        for a in ("gain", "bit_shift", "preload", "stiffening")
        for b in ("gain", "baseline", "preload")
        if a != b
    ),
    {"bit_shift", "stiffening"},
    {"reference_fault", "drift"},
    {"reference_fault", "clock"},
    {"frame_loss", "delay"},
    {"frame_loss", "clock"},
)
_WALK_UNKNOWN = ("softening", "humidity", "overshoot", "hum", "load_noise", "loose_contact", "rate_magnitude")


@dataclass(frozen=True)
class Spec:
    """One case before anything is drawn. `words` of formats.md, each `k` times the floor."""

    kind: str
    recording: str = "chamber"
    words: tuple[str, ...] = ()
    k: float = 0.0
    variant: str = ""  # the protocol of a null or an undecidable case
    law: str = ""  # of an effect outside the vocabulary
    against: str = "reference"  # or simulation
    local: bool = False


def _deck(rng: np.random.Generator, cards: list[Spec]) -> Iterator[Spec]:
    """The cards in random order, again and again: every one comes equally often."""
    while True:
        for k in rng.permutation(len(cards)):
            yield cards[k]


def _combinations(rng: np.random.Generator, n: int, kind: str) -> Iterator[Spec]:
    decks = {r: _deck(rng, [Spec(w) for w in (*SHOWN[r], *SHOWN[r], *FAULTS) if w != "bit_shift"]) for r in RECORDINGS}
    strengths = _deck(rng, [Spec("", k=k) for k in (3.0, 5.0, 8.0)])
    while True:
        for recording in RECORDINGS:
            chosen: list[str] = []
            while len(chosen) < n:
                word = next(decks[recording]).kind
                if word not in chosen and not any(t <= {word, *chosen} for t in _NEVER_TOGETHER):
                    chosen.append(word)
            yield Spec(kind, recording, tuple(chosen), next(strengths).k)


def _local(words: tuple[str, ...]) -> list[str]:
    return [w for w in words if w not in ("clock", "map_transform", "swapped_triangles", "crosstalk")]


def _decks(rng: np.random.Generator, recordings: tuple[str, ...]) -> dict[str, Iterator[Spec]]:
    def each(make: Callable[[str], list[Spec]]) -> Iterator[Spec]:
        return _deck(rng, [spec for r in recordings for spec in make(r)])

    nulls = [
        Spec("null", r, variant=v)
        for r in recordings
        for v in (("", "", "", "sine", "warm") if r == "chamber" else ("", "", "", ""))
    ]
    nulls += [Spec("null", r, against="simulation") for r in recordings]
    unknown = {"chamber": UNKNOWN, "walk": _WALK_UNKNOWN}
    simulation = [Spec("simulation", "walk", (w,), k, against="simulation") for w in SHOWN_BY_PAIR for k in (3.0, 8.0)]
    simulation += [Spec("simulation", "walk", (w,), 8.0, against="simulation") for w in _MOVED for _ in range(4)]
    simulation += [
        Spec("simulation", "chamber", (w,), 5.0, against="simulation")
        for w in ("hysteresis", "creep", "viscoelasticity", "drift", "gain", "rezero")
    ]
    return {
        "null": _deck(rng, nulls),
        "single": each(
            lambda r: (
                [Spec("single", r, (w,), k) for w in SHOWN[r] for k in (3.0, 10.0)]
                + [Spec("single", r, (w,)) for w in FAULTS]
            )
        ),
        "faint": each(
            lambda r: [Spec("faint", r, (w,), k) for w in SHOWN[r] if w not in _UNSOLVED for k in (0.5, 1.0, 1.0)]
        ),
        "local": each(lambda r: [Spec("local", r, (w,), k, local=True) for w in _local(SHOWN[r]) for k in (3.0, 10.0)]),
        "pair": _combinations(rng, 2, "pair"),
        "triple": _combinations(rng, 3, "triple"),
        "simulation": _deck(rng, [s for s in simulation if s.recording in recordings] or simulation),
        "unknown": each(
            lambda r: [
                Spec("unknown", r, ("unknown",), k, law=u, local=local)
                for u in unknown[r]
                for k, local in ((3.0, False), (8.0, True), (8.0, False), (5.0, True))
            ]
        ),
        "undecidable": _deck(rng, [Spec("undecidable", "chamber", (), 3.0, v) for v in EQUIVALENT]),
    }


_UNSOLVED = ("bit_shift", "swapped_triangles", "rezero")
# A short fixed list, whatever the seed is.
_BENCH = (
    Spec("null"),
    Spec("single", "chamber", ("viscoelasticity",), 5.0),
    Spec("simulation", "walk", ("swapped_triangles",), 5.0, against="simulation"),
    Spec("null", "walk"),
    Spec("single", "chamber", ("hysteresis",), 5.0),
    Spec("single", "walk", ("viscoelasticity",), 5.0),
    Spec("single", "walk", ("dead_taxels",)),
    Spec("unknown", "chamber", ("unknown",), 5.0, law="humidity"),
    Spec("pair", "walk", ("drift", "lag"), 5.0),
)


def cases(seed: int, suite: str, n: int) -> list[Spec]:
    """`n` cases of `suite`, in an order that says nothing."""
    if suite == "bench":
        return [_BENCH[k % len(_BENCH)] for k in range(n)]
    rng = np.random.default_rng([seed, 0])
    suite = {"walking": "walk"}.get(suite, suite)
    recordings = (suite,) if suite in RECORDINGS else RECORDINGS
    decks = _decks(rng, recordings)
    if suite in _SHARES:
        found = [next(decks[suite]) for _ in range(n)]
    else:
        shares = {kind: s for kind, s in _SHARES.items() if kind != "undecidable" or "chamber" in recordings}
        found = _dealt(decks, shares, n, recordings)
    return [found[k] for k in rng.permutation(len(found))]


def _dealt(decks: dict[str, Iterator[Spec]], shares: dict[str, int], n: int, recordings: tuple[str, ...]) -> list[Spec]:
    """`n` cards from the decks, by their shares."""
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: int(x) for kind, x in exact.items()}
    for kind in sorted(exact, key=lambda kind: counts[kind] - exact[kind])[: n - sum(counts.values())]:
        counts[kind] += 1
    found: list[Spec] = []
    for kind, count in counts.items():
        while count:
            spec = next(decks[kind])
            if spec.recording in recordings:
                found.append(spec)
                count -= 1
    return found
