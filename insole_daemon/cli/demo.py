"""`insole demo`: run boards, daemon and view without hardware; `--hide` is in demo_hide."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Seconds, name_next, on_end
from .view import DEFAULT_PORT

if TYPE_CHECKING:
    from ..config import Config
    from ..wire.client import Client, Messages

_CHANNEL = "demo"
_DRAWN_S = 0.1
_LINE_S = 1.0
_IF_TAKEN = ", or give this one another endpoint: insole demo --listen tcp/127.0.0.1:7448"


class HiddenIn(StrEnum):
    """The kinds of trial in simulation/concealed, which takes too long to load for a help text."""

    chamber = "chamber"
    walk = "walk"


def demo(
    seconds: Seconds = None,
    view: Annotated[bool, typer.Option("--view", help="Show it in the browser as well: see 'insole view'.")] = False,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help=f"With --view: where the page is served, else {DEFAULT_PORT}.")
    ] = None,
    listen: Annotated[str, typer.Option(help="Zenoh endpoint on which the demo publishes.")] = DEFAULT_ENDPOINT,
    hide: Annotated[
        str | None,
        typer.Option(
            "--hide",
            metavar="EFFECT",
            help="Instead: simulate a trial with this effect concealed, or with 'nothing', and diagnose it.",
        ),
    ] = None,
    trial: Annotated[
        HiddenIn | None,
        typer.Option(
            "--in", help="With --hide: kind of trial; without it a chamber if that can show the effect, else a walk."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="With --hide: seed of place and strength; drawn by default.")
    ] = None,
) -> None:
    """Run without hardware: a simulated walk, live; or a test of the diagnosis.

    Live: emulated boards of both feet on an in-process bus, the real daemon, Zenoh, and a view in the terminal. With
    --hide: a simulated trial with a concealed effect is diagnosed, and the last lines have the daemon's error on
    another trial, with the calibration and with the new model. Exit status then: 0 if the diagnosis names the
    concealed effect first, else 1.
    """
    if hide is not None:
        if seconds is not None or view or port is not None or listen != DEFAULT_ENDPOINT:
            raise typer.BadParameter("--seconds, --view, --port and --listen belong to the live demo, not to --hide")
        from .demo_hide import demonstrate_diagnosis

        raise typer.Exit(0 if demonstrate_diagnosis(hide, seed, None if trial is None else trial.value) else 1)
    if seed is not None or trial is not None:
        raise typer.BadParameter("--seed and --in need --hide EFFECT")
    if port is not None and not view:
        raise typer.BadParameter("--port needs --view")
    _run_live(seconds, view, port or DEFAULT_PORT, listen)


def _run_live(seconds: float | None, view: bool, port: int, listen: str) -> None:
    from ..bus.opening import open_sink
    from ..bus.recovering import RecoveringSource
    from ..config import Bus, Config, Zenoh
    from ..service.daemon import Daemon
    from ..service.foot import load_feet
    from ..simulation.emulator import Emulator
    from ..simulation.foot import Walk
    from ..wire.client import Client
    from ..wire.keys import key
    from ..wire.session import full_endpoint, open_session

    bus = Bus("virtual", _CHANNEL)
    config = Config(rig="demo", buses=(bus,), zenoh=Zenoh(listen=(full_endpoint(listen),)))
    config = replace(
        config,
        insoles=tuple(
            replace(insole, boards=tuple(replace(board, interface=_CHANNEL) for board in insole.boards))
            for insole in config.insoles
        ),
    )
    feet = load_feet(config)
    layouts = [foot.layout for foot in feet]
    stop = threading.Event()
    with (
        contextlib.closing(RecoveringSource([bus])) as source,
        open_sink(bus) as sink,
        open_session(config.zenoh.mode, config.zenoh.listen, if_taken=_IF_TAKEN) as session,
        Client(config.zenoh.listen[0], config.rig) as insole,
    ):
        daemon = Daemon(source, feet, session)
        person = Walk(layouts)
        emulator = Emulator(config, layouts, person)
        messages = insole.messages(key(config.rig, "*", "*"))
        on_end(messages.close)  # before the page is served: a person may end the demo as soon as it is there

        ready = threading.Event()

        def end() -> None:
            stop.set()
            daemon.stop()

        def failed() -> None:
            messages.close()
            ready.set()

        tasks: dict[str, Callable[[], Any]] = {
            "boards": lambda: emulator.play(sink.send, stop),
            "daemon": lambda: daemon.run(ready.set),
        }
        page: contextlib.AbstractContextManager[str] = contextlib.nullcontext("'insole view' shows it in a browser")
        if view:
            from .demo_page import open_page, tell_truth

            tasks["truth"] = lambda: tell_truth(session, emulator, person, layouts, stop)
            page = open_page(config.zenoh.listen[0], config.rig, port)
        with _run_in_threads(tasks, end, failed):
            ready.wait()  # before, nobody answers for meta
            with page as where:
                _draw(insole, messages, config, seconds, where)


@contextlib.contextmanager
def _run_in_threads(
    tasks: dict[str, Callable[[], Any]], end: Callable[[], None], failed: Callable[[], None]
) -> Iterator[None]:
    """Run each task in a thread until the block ends; call `failed` when one dies, and raise its error at the end."""
    from ..errors import InsoleError

    errors: dict[str, Exception] = {}

    def run(name: str, task: Callable[[], Any]) -> None:
        try:
            task()
        except Exception as error:
            errors[name] = error
            failed()  # otherwise the view would wait for ever for the next message

    threads = [threading.Thread(target=run, args=item, name=item[0]) for item in tasks.items()]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        end()
        for thread in threads:
            thread.join()
        for name, error in errors.items():  # before the error of the block, which is only its consequence
            raise InsoleError(
                f"the demo's {name} stopped: {error or type(error).__name__}. Start it again; where it stops again, "
                "'insole doctor' tells whether this computer is the reason"
            ) from error


def _draw(insole: Client, messages: Messages, config: Config, seconds: float | None, where: str) -> None:
    """Draw until the time is over or the person ends it."""
    from rich.console import Console
    from rich.live import Live

    from .terminal_view import FootView, screen

    if seconds is not None:
        end = threading.Timer(seconds, messages.close)
        end.daemon = True
        end.start()
    title = (
        f"insole demo: simulated boards, the real daemon; subscribe to insole/{config.rig}/** on "
        f"{config.zenoh.listen[0]}; {where}; Ctrl-C ends"
    )
    console = Console()
    views = {
        str(insole_config.foot): FootView(insole.meta(insole_config.foot), console.height)
        for insole_config in config.insoles
    }
    drawn = time.monotonic()
    if console.is_terminal:
        with Live(screen(views, title), console=console, auto_refresh=False, screen=True) as live:
            for message in messages:
                views[message.foot].take(message)
                if time.monotonic() - drawn >= _DRAWN_S:
                    drawn = time.monotonic()
                    live.update(screen(views, title), refresh=True)
    else:
        print(title, flush=True)
        for message in messages:
            views[message.foot].take(message)
            if time.monotonic() - drawn >= _LINE_S:
                drawn = time.monotonic()
                for view in views.values():
                    print(view.line(), flush=True)
    for view in views.values():
        print(f"{view.meta.foot}: {view.received} cycles seen, {view.lost} lost", file=sys.stderr)
    name_next("insole demo again, and in another terminal: insole record walk-1 --remote --seconds 20")
