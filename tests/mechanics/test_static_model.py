"""The compiled kernel against numpy: the same bits, whatever is read."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.compiled import kernel
from insole_daemon.config import Board, Config
from insole_daemon.mechanics.static_model import StaticModel
from insole_daemon.mechanics.wrench import WrenchEstimator
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import Layout, assigned
from insole_daemon.skin.validity import Validity

LAYOUT = load_layout(Config().insoles[0])
STALE_NS = 250_000_000


def model_of(
    rng: np.random.Generator, layout: Layout, k: int, threshold: float, extras: bool
) -> tuple[StaticModel, Calibration]:
    """A model with a calibration drawn at random; `extras`: with covariances, limits and boards of each kind."""
    shape = (len(layout), 12)
    usable = np.tile(PRESSURE_TAXELS, (len(layout), 1)) & (rng.random(shape) < 0.9)
    coefficients = rng.normal(0, 1, (*shape, k)) * 10.0 ** np.arange(4, 4 - k, -1)
    coefficients[~usable] = np.nan
    factor = rng.normal(0, 1, (*shape, k, k))
    calibration = Calibration(
        foot="left",
        baseline_count=np.where(usable, rng.uniform(225, 255, shape), np.nan),
        coefficients_pa=coefficients,
        covariance_pa2=factor @ factor.swapaxes(-1, -2) if extras else None,
        usable=usable,
        provenance={},
        highest_count=np.where(rng.random(shape) < 0.5, np.inf, rng.uniform(20, 250, shape)) if extras else None,
    )
    boards = {
        address: Board(
            address=address, interface="can0",
            shift=int(rng.choice([3, 7])) if extras else 3, no_load=int(rng.choice([240, 255])) if extras else 240,
        )
        for address in set(layout.identities[:, 0].tolist())
    }  # fmt: skip
    validity = Validity(layout, boards, STALE_NS)
    return StaticModel(
        calibration, validity, StaticCurve(calibration, threshold), WrenchEstimator(layout, 20.0, 5000.0)
    ), calibration


@pytest.mark.skipif(kernel is None, reason="this installation has no compiled kernel: tests/test_compiled.py says why")
@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, 2**32), st.integers(1, 28), st.sampled_from([1, 2, 4, 6]), st.sampled_from([0.0, 5.0]), st.booleans()
)
def test_the_kernel_gives_what_numpy_gives_to_the_bit(seed, n_triangles, k, threshold, extras):
    rng = np.random.default_rng(seed)
    layout = assigned(LAYOUT, LAYOUT.triangles[:n_triangles])
    model, _ = model_of(rng, layout, k, threshold, extras)
    n = len(layout)
    for healthy in (True, False):
        counts = rng.integers(120, 250, (n, 12)).astype(np.uint8)
        status, age_ns = np.zeros(n, np.uint16), rng.integers(0, 20_000_000, n)
        masked = np.zeros((n, 12), np.bool_)
        if not healthy:
            counts[rng.random((n, 12)) < 0.1] = rng.choice([0, 1, 254, 255])
            status[:] = rng.choice([0, 0, 1, 2, 0x0010, 0xFFF0], n)
            age_ns = rng.choice([-1, 0, STALE_NS, STALE_NS + 1, 2**60], n)
            masked[:] = rng.random((n, 12)) < 0.05
        compiled, numpy = model(counts, status, age_ns, masked), model._by_numpy(counts, status, age_ns, masked)
        for name in numpy._fields:
            a, b = getattr(compiled, name), getattr(numpy, name)
            if isinstance(b, np.ndarray):
                assert a.dtype == b.dtype, name
                assert a.tobytes() == b.tobytes(), name
            elif name == "wrench":
                assert [float(getattr(a, field)).hex() for field in b._fields] == [
                    float(getattr(b, field)).hex() for field in b._fields
                ]
            else:
                assert (a is None) == (b is None), name
                assert a == b, name
