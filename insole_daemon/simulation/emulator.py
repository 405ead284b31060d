"""The boards of one or both feet on one bus: written to a log, or played in real time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np

from ..bus.frames import FrameBatch
from ..config import Config
from ..physics.sampling import Jitter, Losses
from ..skin.layout import Layout
from .board import EmulatedBoard
from .faults import InjectedFault, check_there
from .generation import GENERATIONS, GenerationName
from .load import Load
from .reception import Reception
from .run import BoardRun, Mounted
from .sensors import Temperature

# Of frames made at once when played: also the time until a command takes effect. Longer is less work, so it is short
# only after a command, when more are to be expected.
_AHEAD_NS, _AHEAD_IN_TALK_NS, _TALK_NS = 100_000_000, 20_000_000, 1_000_000_000
_GROUP_S = 0.002  # frames due within this are sent together
_LATE_NS = 500_000_000  # frames that late were missed by everybody: a real bus does not catch up
_CHUNK_NS = 1_000_000_000  # of frames made at once when written, and at most when played


class Emulator:
    """The boards of one or both feet, all on one bus whatever interface they are configured on."""

    def __init__(
        self,
        config: Config,
        layouts: Sequence[Layout],
        load: Load,
        *,
        seed: int = 0,
        streaming: bool = True,
        left_out: Collection[int] = (),
        generation: GenerationName | Mapping[int, GenerationName] | None = None,
        faults: Sequence[InjectedFault] = (),
        status_bits: bool = True,
        cdc_hz: float | Mapping[int, float] | None = None,
        temperature_c: Temperature | None = None,
        luck: int = 0,
        alike: bool = False,
        shifts: Mapping[int, Mapping[int, int]] | None = None,
        jitter: Mapping[int, Mapping[str, float]] | None = None,
        loss: Mapping[int, Mapping[str, float]] | None = None,
        noise: float = 1.0,
    ) -> None:
        """The boards of those feet of `config` that have a layout, under `load`.

        Same arguments, same frames. `streaming`: the boards come up configured and sending; else they are
        silent until commanded. `left_out`: addresses of boards that are not there.
        `generation`: of all boards, or by address ("mtb4" where none is given). None is an MTB4 without the
        temperature compensation of skin types 0 and 8, on which pad 6's noise shows; with `faults` or
        `temperature_c`, whose fingerprints it makes, it is "mtb4" for all boards.
        `status_bits`: else the status in every half B is 0. `cdc_hz`: rate of the free-running converters, really
        sampling.CDC_HZ, of all boards or by address; None: a reading is as old as its tick. `temperature_c`: of all
        the insoles, seconds since power-up (n,) to °C (n,); None is 25 °C.
        `luck`: another noise on the same sensors. `alike`: each sensor is the nominal line, since `load` is what they
        feel (`sensed.SensedLoad`). `shifts`: by board and triangle, digitisers with another shift than configured.
        `jitter`, `loss`: by address, the values of these effects on a board's frames. `noise`: times that of the
        reference insole.
        """
        check_there(faults, config, layouts)
        self._compensated = generation is not None or bool(faults) or temperature_c is not None
        self._generation = generation
        self._faults = tuple(faults)
        self._status_bits = status_bits
        self._cdc_hz = cdc_hz
        self._temperature_c = temperature_c
        self._luck, self._alike, self._noise = luck, alike, noise
        self._shifts = shifts or {}
        self._jitter, self._loss = jitter or {}, loss or {}
        self._config = config
        self._layouts = {layout.foot: layout for layout in layouts}
        self._load = load
        self._seed = seed
        self._streaming = streaming
        self._left_out = frozenset(left_out)
        self.playing_since_ns: int | None = None  # CLOCK_REALTIME: the load's t = 0 in what is played

    def run(self, t_start_ns: int) -> BoardRun:
        """The boards, powered up at `t_start_ns`; every run begins anew from the seed."""
        return BoardRun(self._boards(), self._load, t_start_ns)

    def frames(self, t_start_ns: int, seconds: float) -> FrameBatch:
        """All frames that begin within `seconds` of `t_start_ns`, stamped with the moment they end."""
        return FrameBatch.concatenate(list(self.batches(t_start_ns, seconds)))

    def batches(self, t_start_ns: int, seconds: float) -> Iterator[FrameBatch]:
        """The same in portions."""
        run, received = self.run(t_start_ns), self._reception()
        t_end_ns = t_start_ns + round(seconds * 1e9)
        while run.now_ns < t_end_ns:
            yield received(run.advance(min(run.now_ns + _CHUNK_NS, t_end_ns)))

    def play(
        self,
        send: Callable[[FrameBatch], None],
        stop: threading.Event,
        seconds: float | None = None,
        receive: Callable[[], FrameBatch] | None = None,
    ) -> int:
        """Send the frames when they are due, until `stop` is set or for `seconds`; how many were sent.

        `receive` hands over what came in since it was last called; commands among it are obeyed.
        """
        self.playing_since_ns = t_start_ns = time.time_ns()
        since_start_ns = time.monotonic_ns() - t_start_ns  # the clock to sleep by must not step
        t_end_ns = None if seconds is None else t_start_ns + round(seconds * 1e9)
        run, received = self.run(t_start_ns), self._reception()
        sent, talks_until_ns = 0, t_start_ns
        while not stop.is_set() and (t_end_ns is None or run.now_ns < t_end_ns):
            if receive is not None and run.obey(receive()):
                talks_until_ns = run.now_ns + _TALK_NS
            # Who is late makes all that was missed at once: in short portions it would fall behind for good.
            from_ns = max(run.now_ns, time.monotonic_ns() - since_start_ns)
            until_ns = from_ns + (_AHEAD_IN_TALK_NS if run.now_ns < talks_until_ns else _AHEAD_NS)
            until_ns = min(until_ns, run.now_ns + _CHUNK_NS, t_end_ns or until_ns)
            batch = received(run.advance(until_ns))
            sent += _send_when_due(batch, run.now_ns, since_start_ns, send, stop)
        return sent

    def _reception(self) -> Reception:
        return Reception(
            {address: Jitter(**values, seed=self._seed, board=address) for address, values in self._jitter.items()},
            {address: Losses(**values, seed=self._seed, board=address) for address, values in self._loss.items()},
        )

    def _name_of_generation(self, address: int) -> GenerationName:
        if self._generation is None:
            return "mtb4"
        return self._generation if isinstance(self._generation, str) else self._generation.get(address, "mtb4")

    def _boards(self) -> list[Mounted]:
        mounted = []
        for insole in self._config.insoles:
            layout = self._layouts.get(insole.foot)
            if layout is None:
                continue
            for board in insole.boards:
                if board.address in self._left_out:
                    continue
                place = {t: row for (address, t), row in layout.rows.items() if address == board.address}
                emulated = EmulatedBoard(
                    board.address,
                    sorted(place),
                    period_ms=board.period_ms,
                    shift=board.shift,
                    no_load=board.no_load,
                    skin_type=board.skin_type,
                    seed=self._seed,
                    streaming=self._streaming,
                    generation=GENERATIONS[self._name_of_generation(board.address)],
                    compensated=self._compensated,
                    faults=self._faults,
                    status_bits=self._status_bits,
                    cdc_hz=self._cdc_hz.get(board.address) if isinstance(self._cdc_hz, Mapping) else self._cdc_hz,
                    temperature_c=self._temperature_c,
                    luck=self._luck,
                    alike=self._alike,
                    digitises_with=self._shifts.get(board.address),
                    noise=self._noise,
                )
                rows = np.array([place[triangle] for triangle in sorted(place)], np.intp)
                mounted.append(Mounted(emulated, insole.foot, rows))
        return mounted


def _send_when_due(
    batch: FrameBatch,
    until_ns: int,
    since_start_ns: int,
    send: Callable[[FrameBatch], None],
    stop: threading.Event,
) -> int:
    """Send the frames of one stretch of time in small groups, and return at its end; how many were sent."""
    at = sent = 0
    while not stop.is_set():
        now_ns = time.monotonic_ns() - since_start_ns
        missed, due = np.searchsorted(batch.t_ns, [now_ns - _LATE_NS, now_ns], side="right").tolist()
        at = max(at, missed)
        if due > at:
            send(batch[at:due])
            sent, at = sent + due - at, due
        if at == len(batch) and now_ns >= until_ns:
            break
        next_ns = int(batch.t_ns[at]) if at < len(batch) else until_ns
        stop.wait(max(_GROUP_S, (next_ns - now_ns) * 1e-9))
    return sent
