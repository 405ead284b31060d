"""Lists the cases of a suite. What a case conceals depends on the seed alone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .effect import SOLVED, UNKNOWN
from .faults import FAULTS

RECORDINGS = ("chamber", "walk")
# Relative numbers of the kinds of cases in the suite `all`.
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
# Words that a trial cannot tell apart if its load repeats one cycle, or if its temperature only rises.
EQUIVALENT = {
    "sine": ("hysteresis", "creep", "viscoelasticity", "lag", "delay"),
    "ramps": ("hysteresis", "creep", "viscoelasticity"),
    "warm": ("temperature", "drift"),
}
_MOVED = ("swapped_triangles", "map_transform")
# Words that a recording can show. A uniform load does not depend on position, and a preload under it is a baseline.
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
    """A case before it is drawn: effects and faults by their `words` in formats.md, each `k` times the floor."""

    kind: str
    recording: str = "chamber"
    words: tuple[str, ...] = ()
    k: float = 0.0
    variant: str = ""  # the protocol of a null or an undecidable case
    law: str = ""  # of an effect outside the vocabulary
    against: str = "reference"  # or simulation
    local: bool = False


def _deck(rng: np.random.Generator, cards: list[Spec]) -> Iterator[Spec]:
    """Yield the cards in random order, again and again, so that each comes equally often."""
    while True:
        for k in rng.permutation(len(cards)):
            yield cards[k]


def _combinations(rng: np.random.Generator, n: int, kind: str) -> Iterator[Spec]:
    """Yield cases of `n` words each, for chamber and walk in turn."""
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


def _words_with_place(words: tuple[str, ...]) -> list[str]:
    """The words that can be at one place of the insole alone."""
    return [w for w in words if w not in ("clock", "map_transform", "swapped_triangles", "crosstalk")]


def _decks(rng: np.random.Generator, recordings: tuple[str, ...]) -> dict[str, Iterator[Spec]]:
    """An endless deck of cases for each kind of case."""

    def deck_of(specs_of: Callable[[str], list[Spec]]) -> Iterator[Spec]:
        return _deck(rng, [spec for recording in recordings for spec in specs_of(recording)])

    null_specs = [
        Spec("null", recording, variant=variant)
        for recording in recordings
        for variant in (("", "", "", "sine", "warm") if recording == "chamber" else ("", "", "", ""))
    ]
    null_specs += [Spec("null", recording, against="simulation") for recording in recordings]
    unknown_laws = {"chamber": UNKNOWN, "walk": _WALK_UNKNOWN}
    simulation_specs = [
        Spec("simulation", "walk", (word,), k, against="simulation") for word in SHOWN_BY_PAIR for k in (3.0, 8.0)
    ]
    simulation_specs += [
        Spec("simulation", "walk", (word,), 8.0, against="simulation") for word in _MOVED for _ in range(4)
    ]
    simulation_specs += [
        Spec("simulation", "chamber", (word,), 5.0, against="simulation")
        for word in ("hysteresis", "creep", "viscoelasticity", "drift", "gain", "rezero")
    ]
    return {
        "null": _deck(rng, null_specs),
        "single": deck_of(
            lambda recording: (
                [Spec("single", recording, (word,), k) for word in SHOWN[recording] for k in (3.0, 10.0)]
                + [Spec("single", recording, (word,)) for word in FAULTS]
            )
        ),
        "faint": deck_of(
            lambda recording: [
                Spec("faint", recording, (word,), k)
                for word in SHOWN[recording]
                if word not in _UNSOLVED
                for k in (0.5, 1.0, 1.0)
            ]
        ),
        "local": deck_of(
            lambda recording: [
                Spec("local", recording, (word,), k, local=True)
                for word in _words_with_place(SHOWN[recording])
                for k in (3.0, 10.0)
            ]
        ),
        "pair": _combinations(rng, 2, "pair"),
        "triple": _combinations(rng, 3, "triple"),
        "simulation": _deck(rng, [s for s in simulation_specs if s.recording in recordings] or simulation_specs),
        "unknown": deck_of(
            lambda recording: [
                Spec("unknown", recording, ("unknown",), k, law=law, local=local)
                for law in unknown_laws[recording]
                for k, local in ((3.0, False), (8.0, True), (8.0, False), (5.0, True))
            ]
        ),
        "undecidable": _deck(rng, [Spec("undecidable", "chamber", (), 3.0, variant) for variant in EQUIVALENT]),
    }


_UNSOLVED = ("bit_shift", "swapped_triangles", "rezero")
# A short fixed list that does not depend on the seed.
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
    """`n` cases of `suite`, in an order that shows nothing."""
    if suite == "bench":
        return [_BENCH[k % len(_BENCH)] for k in range(n)]
    rng = np.random.default_rng([seed, 0])
    suite = {"walking": "walk"}.get(suite, suite)
    recordings = (suite,) if suite in RECORDINGS else RECORDINGS
    decks = _decks(rng, recordings)
    if suite in _SHARES:
        specs = [next(decks[suite]) for _ in range(n)]
    else:
        shares = {kind: s for kind, s in _SHARES.items() if kind != "undecidable" or "chamber" in recordings}
        specs = _deal(decks, shares, n, recordings)
    return [specs[k] for k in rng.permutation(len(specs))]


def _deal(decks: dict[str, Iterator[Spec]], shares: dict[str, int], n: int, recordings: tuple[str, ...]) -> list[Spec]:
    """`n` cases from the decks, by their shares."""
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: int(number) for kind, number in exact.items()}
    for kind in sorted(exact, key=lambda kind: counts[kind] - exact[kind])[: n - sum(counts.values())]:
        counts[kind] += 1
    specs: list[Spec] = []
    for kind, count in counts.items():
        while count:
            spec = next(decks[kind])
            if spec.recording in recordings:
                specs.append(spec)
                count -= 1
    return specs
