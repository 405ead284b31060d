"""Which cases a suite holds. What is concealed in case 17 depends on the seed alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.effect import SOLVED, UNKNOWN
from benchmarks.blind.faults import FAULTS

SUITES = ("chamber", "bench", "walking", "all")
# Of a hundred cases.
_SHARES = {"null": 16, "single": 32, "faint": 10, "pair": 13, "triple": 9, "outside": 10, "undecidable": 8, "fault": 10}
_WALKING_SHARES = {"null": 20, "single": 32, "together": 20, "patch": 14, "mapping": 14}
_WALKING_SHARE_OF_ALL = 0.25
TOGETHER = ("hysteresis", "viscoelasticity", "lag", "delay")
PATCH = ("hysteresis", "viscoelasticity", "drift")
MAPPING = ("swapped_triangles", "map_transform")
# What a quick check runs whatever the seed is.
_BENCH = (
    ("null", ""),
    ("null", ""),
    ("single", "hysteresis"),
    ("single", "temperature"),
    ("single", "rezero"),
    ("fault", "dead_taxels"),
    ("outside", "humidity"),
    ("undecidable", "warm"),
)
SINGLES = (*SOLVED, "bit_shift")
UNDECIDABLE = ("sine", "ramps", "warm")
_COMPOSABLE = (
    "hysteresis",
    "snap",
    "viscoelasticity",
    "creep",
    "lag",
    "delay",
    "temperature",
    "drift",
    "rezero",
    "clock",
)
_NEVER_TOGETHER = ({"lag", "delay"}, {"lag", "clock"}, {"delay", "clock"})


@dataclass(frozen=True)
class Spec:
    """One case before anything is drawn. `kind` as in `_SHARES`, `words` of the contract, `k` times the floor."""

    kind: str
    words: tuple[str, ...] = ()
    k: float = 0.0
    variant: str = ""  # the law of an outside case, the design of an undecidable one
    suite: str = "chamber"  # or walking


def _deck(rng: np.random.Generator, cards: list[Spec]) -> Iterator[Spec]:
    """The cards in random order, again and again: every one comes equally often."""
    while True:
        for k in rng.permutation(len(cards)):
            yield cards[k]


def _compositions(rng: np.random.Generator, n: int, kind: str) -> Iterator[Spec]:
    words = _deck(rng, [Spec(w) for w in _COMPOSABLE])
    while True:
        chosen: list[str] = []
        while len(chosen) < n:
            word = next(words).kind
            if word not in chosen and not any(t <= {word, *chosen} for t in _NEVER_TOGETHER):
                chosen.append(word)
        yield Spec(kind, tuple(chosen), float(rng.choice([3.0, 5.0])))


def cases(seed: int, suite: str, n: int) -> list[Spec]:
    """`n` cases of `suite`, in an order that says nothing."""
    rng = np.random.default_rng([seed, 0])
    if suite == "bench":
        cards = [Spec(kind, _words(kind, word), 5.0 if kind != "null" else 0.0, word) for kind, word in _BENCH]
        return [cards[k % len(cards)] for k in range(n)]
    n_walking = {"chamber": 0, "walking": n, "all": round(n * _WALKING_SHARE_OF_ALL)}[suite]
    found = _dealt(_chamber_decks(rng), _SHARES, n - n_walking) + _dealt(
        _walking_decks(rng), _WALKING_SHARES, n_walking
    )
    return [found[k] for k in rng.permutation(len(found))]


def _chamber_decks(rng: np.random.Generator) -> dict[str, Iterator[Spec]]:
    return {
        "null": _deck(rng, [Spec("null", variant=v) for v in ("", "", "", "", "sine", "ramps", "warm", "")]),
        "single": _deck(rng, [Spec("single", (w,), k) for w in SINGLES for k in (3.0, 10.0)]),
        "faint": _deck(rng, [Spec("faint", (w,), k) for w in SOLVED for k in (0.5, 1.0)]),
        "pair": _compositions(rng, 2, "pair"),
        "triple": _compositions(rng, 3, "triple"),
        "outside": _deck(rng, [Spec("outside", ("unknown",), k, v) for v in UNKNOWN for k in (3.0, 10.0)]),
        "undecidable": _deck(rng, [Spec("undecidable", (), 3.0, v) for v in UNDECIDABLE]),
        "fault": _deck(rng, [Spec("fault", (w,)) for w in FAULTS]),
    }


def _walking_decks(rng: np.random.Generator) -> dict[str, Iterator[Spec]]:
    patches = [Spec("patch", (w,), variant=p, suite="walking") for w in PATCH for p in ("front", "middle", "rear")]
    return {
        "null": _deck(rng, [Spec("null", suite="walking")]),
        "single": _deck(rng, [Spec("single", (w,), suite="walking") for w in TOGETHER]),
        "together": _deck(rng, [Spec("together", TOGETHER, suite="walking")]),
        "patch": _deck(rng, patches),
        "mapping": _deck(rng, [Spec("mapping", (w,), suite="walking") for w in MAPPING]),
    }


def _dealt(decks: dict[str, Iterator[Spec]], shares: dict[str, int], n: int) -> list[Spec]:
    """`n` cards from the decks, by their shares."""
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: int(x) for kind, x in exact.items()}
    for kind in sorted(exact, key=lambda kind: counts[kind] - exact[kind])[: n - sum(counts.values())]:
        counts[kind] += 1
    return [next(decks[kind]) for kind, count in counts.items() for _ in range(count)]


def _words(kind: str, word: str) -> tuple[str, ...]:
    return {"null": (), "outside": ("unknown",), "undecidable": ()}.get(kind, (word,))
