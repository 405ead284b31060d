"""The emulator's defaults give the same bytes on every machine."""

import hashlib

import pytest

from insole_daemon import config
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin import layout

ADDRESSES = {"left": (5, 6, 7), "right": (8, 9, 10)}
LAYOUTS = [layout.builtin(foot, addresses) for foot, addresses in ADDRESSES.items()]
START_NS = 1_700_000_000_000_000_000


def settings(**board):
    return config.Config(
        insoles=tuple(
            config.Insole(
                foot=foot,
                boards=tuple(config.Board(address=a, interface="can0", **board) for a in addresses),
            )
            for foot, addresses in ADDRESSES.items()
        )
    )


# With the constants of insole-reference.yaml: who changes one changes these.
@pytest.mark.parametrize(
    ("emulator", "digest"),
    [
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS)), "edb6f80e0153bc5f17c1b6369dce5aff"),
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS), seed=3), "69c1cc1cfa02ca989505b89778cf61a5"),
        (Emulator(settings(period_ms=8), LAYOUTS, Unloaded(LAYOUTS)), "fc70fe5c3a869538759611a9f28372d8"),
        (
            Emulator(settings(skin_type=7), LAYOUTS[:1], Stand(LAYOUTS), left_out=[6]),
            "cffc2506812f00aa66c2d29b59eda63c",
        ),
    ],
    ids=["walk", "seed", "busy", "raw"],
)
def test_default_frames_have_not_changed(emulator, digest):
    batch = emulator.frames(START_NS, 2)
    sha256 = hashlib.sha256()
    for name in FrameBatch.__slots__:
        sha256.update(getattr(batch, name).tobytes())
    assert sha256.hexdigest()[:32] == digest
