"""`insole run`: the daemon."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from .options import ConfigFile, on_end

if TYPE_CHECKING:
    from ..bus.gate import Gate


def run(config: ConfigFile = None) -> None:
    """Run the daemon: frames in, pressure and wrench out."""
    from .. import config as configs
    from ..bus.opening import open_gates, open_source
    from ..service.daemon import Daemon
    from ..service.foot import load_feet
    from ..wire.exposure import REMEDY, exposures
    from ..wire.session import open_session

    settings = configs.load(config)
    feet = load_feet(settings)
    for exposure in exposures(settings.zenoh):
        print(f"insole: warning: {exposure} ({REMEDY})", file=sys.stderr, flush=True)
    source = open_source(settings.buses)
    gates: dict[str, Gate] = {}
    try:
        gates = open_gates(settings.buses, source, settings.boards.configure)
        zenoh = settings.zenoh
        with open_session(zenoh.mode, zenoh.listen, zenoh.connect, zenoh.config_file) as session:
            daemon = Daemon(source, feet, session, gates)
            on_end(daemon.stop)
            where = ", ".join(map(str, settings.buses))
            daemon.run(lambda: print(f"insole: reading {where}, rig {settings.rig}", file=sys.stderr, flush=True))
    finally:
        for gate in gates.values():
            gate.close()
        source.close()
