"""The wrench of one foot as a Lab Streaming Layer stream (extra `lsl`): lsl_outlet.py [left|right] [ENDPOINT]."""

import contextlib
import math
import sys
import time

import pylsl

import insole_daemon
from insole_daemon.errors import InsoleError

CHANNELS = {  # label: field of the message, unit
    "f_z": ("f_z_n", "N"),
    "m_x": ("m_x_nm", "N.m"),
    "m_y": ("m_y_nm", "N.m"),
    "cop_x": ("cop_x_m", "m"),
    "cop_y": ("cop_y_m", "m"),
    "valid_fraction": ("valid_fraction", "1"),
}
UNKNOWN = [math.nan] * len(CHANNELS)


def lsl_time(t_ns):
    """LSL's clock is a monotonic one: what carries over is how long ago it was. Anew every time, as `t_ns` may step."""
    return pylsl.local_clock() - (time.time_ns() - t_ns) * 1e-9


def outlet_of(meta):
    """The stream: its source_id lets recorders find it again after a restart."""
    source = f"insole/{meta.rig}/{meta.foot}/wrench"
    info = pylsl.StreamInfo(f"insole_{meta.foot}", "Force", len(CHANNELS), meta.rate_hz, pylsl.cf_float32, source)
    info.set_channel_labels(list(CHANNELS))
    info.set_channel_units([unit for _, unit in CHANNELS.values()])
    info.desc().append_child_value("calibration", meta.calibration)
    return pylsl.StreamOutlet(info)


def main(foot="left", *endpoint):
    """Send one row a cycle, until Ctrl-C."""
    with insole_daemon.connect(*endpoint) as insole:
        meta = insole.meta(foot)
        outlet = outlet_of(meta)
        for wrench in insole.wrenches(foot):
            # A repeat has no newer reading to be dated by, and two rows of one time are no time series.
            now = lsl_time(wrench.t_published_ns if wrench.repeated else wrench.t_ns)
            for cycles in range(wrench.lost, 0, -1):  # recorders that smooth time stamps count the rows
                outlet.push_sample(UNKNOWN, now - cycles / meta.rate_hz)
            row = (getattr(wrench, field) for field, _ in CHANNELS.values())
            outlet.push_sample([math.nan if value is None else value for value in row], now)


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(*sys.argv[1:])
    except InsoleError as error:
        sys.exit(f"lsl_outlet: {error}")
