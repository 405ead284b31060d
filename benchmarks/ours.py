"""The daemon itself, unchanged, with a clock behind its `put`."""

from __future__ import annotations

from dataclasses import asdict

import measured
import traffic

from insole_daemon.bus.several import SeveralSources
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.service.daemon import Daemon
from insole_daemon.wire.messages import Message, Wrench
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session


def main() -> None:
    options = measured.options(
        __doc__, lambda parser: parser.add_argument("--buses", type=int, default=1, help="how many, each as --bus")
    )
    opened = [measured.open_bus(options.bus) for _ in range(options.extra["buses"])]
    for sock, _ in opened:
        sock.setblocking(False)
    sources = [SocketCanSource(sock, f"can{number}") for number, (sock, _) in enumerate(opened)]
    source = sources[0] if len(sources) == 1 else SeveralSources(sources)
    recorder = measured.Recorder(options)
    publish = FootPublisher.publish

    def timed(self: FootPublisher, message: Message) -> None:
        publish(self, message)
        if type(message) is Wrench and not message.repeated:  # a repeat answers to no frame
            recorder.cycle(message.foot, message.t_ns)

    FootPublisher.publish = timed  # type: ignore[method-assign]
    with open_session("peer", [options.endpoint]) as session:
        daemon = Daemon(source, traffic.feet(), session)
        measured.on_end(daemon.stop)
        daemon.run(lambda: measured.ready([feed for _, feed in opened], options.endpoint))
    source.close()
    counters = asdict(source.counters)
    recorder.report(counters["frames"], dropped=counters["overflows"])


if __name__ == "__main__":
    main()
