"""`insole view`: serve the live web page."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, ZenohFile, name_next

DEFAULT_PORT = 8080


def view(
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = DEFAULT_PORT,
    open_: Annotated[bool, typer.Option("--open", help="Open it in this computer's browser.")] = False,
    listen: Annotated[
        str, typer.Option(help="Address to serve on; on any but 127.0.0.1, access needs the printed token.")
    ] = "127.0.0.1",
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="left=KEY or right=KEY: where a reference publishes JSON objects with fz_n, mx_nm and my_nm. "
            "Without it, reference/left and reference/right."
        ),
    ] = None,
    beside: Annotated[
        str, typer.Option(help="Rig to draw in addition: a simulation, or a daemon with another model.")
    ] = "simulation",
    recordings: Annotated[Path, typer.Option(help="Folder for the page's recordings.")] = Path("recordings"),
    rig: RigName = "*",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
) -> None:
    """Serve a page that shows a running daemon live, in any browser."""
    import asyncio
    import webbrowser

    from ..errors import WireError
    from ..view.other_sources import OtherSources
    from ..view.safety import Safety
    from ..view.server import application, serve
    from ..wire.client import Client

    references = {foot: f"reference/{foot}" for foot in ("left", "right")}
    for option in reference or ():
        foot, equals, key = option.partition("=")
        if foot not in references or not equals or not key:
            raise typer.BadParameter(f"--reference {option}: expected left=KEY or right=KEY")
        references[foot] = key

    async def run(insole: Client) -> None:
        safety = Safety.of(listen, port)
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        app = application(insole, insole.rig, OtherSources(beside, references), safety, recordings)
        host = f"[{listen}]" if ":" in listen else listen
        address = f"http://{host}:{port}/" + (f"?token={safety.token}" if safety.token else "")

        def ready() -> None:
            print(f"insole: the page is on {address} ; Ctrl-C ends", file=sys.stderr, flush=True)
            name_next("Record on the page, then: insole report")
            if open_:
                webbrowser.open(address)

        await serve(app, listen, port, ready, stop)

    with Client(connect, rig, zenoh_config) as insole:
        rigs = sorted({name for name, _ in insole.feet()})
        if not rigs:
            suffix = "" if rig == "*" else f" of rig {rig}"
            raise WireError(f"a Zenoh node answers on {connect}, but no insole daemon{suffix} is behind it")
        if len(rigs) > 1:
            raise WireError(f"{' and '.join(rigs)} publish behind {connect}: choose one with --rig")
        insole.rig = rigs[0]
        asyncio.run(run(insole))
