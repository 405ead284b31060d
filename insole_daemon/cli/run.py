"""`insole run`: run the daemon."""

from __future__ import annotations

import contextlib
import logging
import signal
import sys

from .options import ConfigFile, name_next, on_end


def run(config: ConfigFile = None) -> None:
    """Run the daemon: frames in, pressure and wrench out.

    SIGHUP reloads the configuration: calibrations, zeros, thresholds of contact and stale_after_ms change at once.
    """
    from .. import config as configs
    from ..bus.recovering import RecoveringSource
    from ..service.daemon import Daemon
    from ..service.foot import load_feet
    from ..wire.exposure import REMEDY, exposures
    from ..wire.session import open_daemon_session

    settings = configs.load(config)
    feet = load_feet(settings)
    logging.basicConfig(level=logging.WARNING, format="insole: %(message)s", stream=sys.stderr)
    logging.getLogger("insole_daemon").setLevel(logging.INFO)  # python-can logs every socket at that level
    for exposure in exposures(settings.zenoh):
        print(f"insole: warning: {exposure} ({REMEDY})", file=sys.stderr, flush=True)
    with (
        contextlib.closing(RecoveringSource(settings.buses)) as source,
        open_daemon_session(settings.zenoh) as session,
    ):
        daemon = Daemon(source, feet, session, config)
        on_end(daemon.stop)
        signal.signal(signal.SIGHUP, lambda *_: daemon.reload())
        where = ", ".join(map(str, settings.buses))

        def ready() -> None:
            print(f"insole: reading {where}, rig {settings.rig}", file=sys.stderr, flush=True)
            name_next("insole status, or insole view --open, in another terminal")

        daemon.run(ready)
