"""The daemon itself, unchanged, with a clock behind its `put`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from benchmarks.lib import measured, traffic
from insole_daemon.bus import link
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.config import Bus, Zenoh
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import CyclePayloads, Foot, PublishedLoad
from insole_daemon.skin.cycles import ClosedCycle
from insole_daemon.wire.messages import Message, Wrench
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_daemon_session


def main() -> None:
    options = measured.options(
        __doc__, lambda parser: parser.add_argument("--buses", type=int, default=1, help="how many, each as --bus")
    )
    opened = [measured.open_bus(options.bus) for _ in range(options.extra["buses"])]
    for sock, _ in opened:
        sock.setblocking(False)
    sources = {f"can{number}": SocketCanSource(sock, f"can{number}") for number, (sock, _) in enumerate(opened)}
    link.open_bus = lambda bus: sources[bus.channel]
    source = RecoveringSource([Bus("opened", name) for name in sources])
    recorder = measured.Recorder(options)
    payloads_of, put = Foot.payloads, FootPublisher.put
    newest: dict[str, PublishedLoad] = {}

    def remembered(self: Foot, cycle: ClosedCycle) -> CyclePayloads:
        made = payloads_of(self, cycle)
        newest[self.name] = made.load
        return made

    def timed(self: FootPublisher, payloads: Sequence[tuple[type[Message], bytes]]) -> None:
        put(self, payloads)
        if payloads[-1][0] is Wrench and not newest[self.foot].repeated:  # a repeat answers to no frame
            recorder.cycle(self.foot, newest[self.foot].t_ns)

    Foot.payloads = remembered  # type: ignore[method-assign]
    FootPublisher.put = timed  # type: ignore[method-assign]
    with open_daemon_session(Zenoh(listen=(options.endpoint,))) as session:
        daemon = Daemon(source, traffic.feet(), session)
        measured.on_end(daemon.stop)
        daemon.run(lambda: measured.ready([feed for _, feed in opened], options.endpoint))
    counters = asdict(source.counters)
    source.close()
    recorder.report(counters["frames"], dropped=counters["overflows"])


if __name__ == "__main__":
    main()
