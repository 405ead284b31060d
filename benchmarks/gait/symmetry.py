"""Coverage of the 95 % interval of the symmetry index, on 4 000 simulated series each with and without a limp.

    python -m benchmarks run gait.symmetry

Takes a minute.

Series are of n pairs of a left and a right step that vary by 3 % from step to step: independently; with a speed that
both feet share (5 %, correlated by 0.8 from step to step); and correlated by 0.3 and 0.5 on each foot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insole_daemon.mechanics.gait.symmetry import symmetry_index

SERIES = 4000
KINDS = {
    "independent": (0.0, 0.0),
    "shared speed": (0.0, 0.05),
    "correlated 0.3": (0.3, 0.0),
    "correlated 0.5": (0.5, 0.0),
}  # by name: correlation of each foot, SD of the shared speed


def correlated(random: np.random.Generator, n: int, correlation: float) -> NDArray[np.float64]:
    """(n,) of mean 0 and SD 1, each correlated with the one before."""
    values = random.standard_normal(n)
    for at in range(1, n):
        values[at] = correlation * values[at - 1] + np.sqrt(1 - correlation**2) * values[at]
    return values


def main() -> None:
    random = np.random.default_rng(23)
    print("| pairs | steps | 0 inside, symmetric | 6 % inside, limp | half width |\n|---|---|---|---|---|")
    for n in (8, 20, 50, 200):
        for name, (correlation, shared) in KINDS.items():
            inside, widths = {0.0: 0, 6.0: 0}, []
            for limp_percent in inside:
                for _ in range(SERIES):
                    speed = 1 + shared * correlated(random, n, 0.8)
                    left, right = (
                        speed * (1 + sign * limp_percent / 200) * (1 + 0.03 * correlated(random, n, correlation))
                        for sign in (1, -1)
                    )
                    index = symmetry_index(left, right)
                    inside[limp_percent] += limp_percent in index
                    widths.append((index.high - index.low) / 2)
            coverages = " | ".join(f"{100 * count / SERIES:.1f} %" for count in inside.values())
            print(f"| {n} | {name} | {coverages} | {np.mean(widths):.2f} % |", flush=True)


if __name__ == "__main__":
    main()
