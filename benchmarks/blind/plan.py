"""Which cases a suite holds. What is concealed in case 17 depends on the seed alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.effect import SOLVED, UNKNOWN
from benchmarks.blind.faults import FAULTS

SUITES = ("chamber", "bench", "all")
# Of a hundred cases.
_SHARES = {"null": 16, "single": 32, "faint": 10, "pair": 13, "triple": 9, "outside": 10, "undecidable": 8, "fault": 10}
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
    decks = {
        "null": _deck(rng, [Spec("null", variant=v) for v in ("", "", "", "", "sine", "ramps", "warm", "")]),
        "single": _deck(rng, [Spec("single", (w,), k) for w in SINGLES for k in (3.0, 10.0)]),
        "faint": _deck(rng, [Spec("faint", (w,), k) for w in SOLVED for k in (0.5, 1.0)]),
        "pair": _compositions(rng, 2, "pair"),
        "triple": _compositions(rng, 3, "triple"),
        "outside": _deck(rng, [Spec("outside", ("unknown",), k, v) for v in UNKNOWN for k in (3.0, 10.0)]),
        "undecidable": _deck(rng, [Spec("undecidable", (), 3.0, v) for v in UNDECIDABLE]),
        "fault": _deck(rng, [Spec("fault", (w,)) for w in FAULTS]),
    }
    total = sum(_SHARES.values())
    exact = {kind: n * share / total for kind, share in _SHARES.items()}
    counts = {kind: int(x) for kind, x in exact.items()}
    for kind in sorted(exact, key=lambda kind: counts[kind] - exact[kind])[: n - sum(counts.values())]:
        counts[kind] += 1
    found = [next(decks[kind]) for kind, count in counts.items() for _ in range(count)]
    return [found[k] for k in rng.permutation(len(found))]


def _words(kind: str, word: str) -> tuple[str, ...]:
    return {"null": (), "outside": ("unknown",), "undecidable": ()}.get(kind, (word,))
