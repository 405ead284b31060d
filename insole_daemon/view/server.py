"""The web server: the page's files, and a WebSocket to each browser that has it open."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from aiohttp.typedefs import Handler

from .. import __version__
from ..errors import WireError
from ..wire.client import Client
from .actions import Actions
from .hub import Hub
from .other_sources import OtherSources
from .recording import PageRecorder
from .safety import COOKIE_DAYS, Safety, headers
from .viewer import Viewer

PAGE = Path(__file__).parent / "page"
GOT = "got"  # the page's answer to every message
_MESSAGE_BYTES = 4096
_HEARTBEAT_S = 10.0

_HUB = web.AppKey("hub", Hub)
_ACTIONS = web.AppKey("actions", Actions)
_LISTENING: web.AppKey[asyncio.Task[None]] = web.AppKey("listening", asyncio.Task)


def application(
    client: Client, rig: str, other_sources: OtherSources, safety: Safety, recordings: Path
) -> web.Application:
    """Return the server for `rig` of an open `client`; recordings go into the folder `recordings`."""

    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not safety.allows(request):
            raise web.HTTPForbidden(
                text="This page needs the token that 'insole view' printed when it was started: open that address.\n",
                headers=headers(request),
            )
        if safety.token is not None and "token" in request.query:  # the cookie replaces it in the address
            answer = web.HTTPFound("/", headers=headers(request))
            answer.set_cookie(
                safety.cookie, safety.token, max_age=COOKIE_DAYS * 86400, httponly=True, samesite="Strict", path="/"
            )
            raise answer
        return await handler(request)

    async def index(request: web.Request) -> web.StreamResponse:
        return web.FileResponse(PAGE / "index.html")

    async def follow(request: web.Request) -> web.StreamResponse:
        if not safety.same_origin(request):
            raise web.HTTPForbidden(text="Only this server's own page may listen.\n", headers=headers(request))
        return await _follow(request)

    async def with_headers(request: web.Request, response: web.StreamResponse) -> None:
        response.headers.update(headers(request))

    async def running(app: web.Application) -> AsyncIterator[None]:
        hub = Hub(client, rig, other_sources)
        loop = asyncio.get_running_loop()

        def report_recording(text: str) -> None:  # from the recording's thread
            with contextlib.suppress(RuntimeError):  # the server has ended
                loop.call_soon_threadsafe(actions.publish_recording_state, text)

        recording = PageRecorder(client, recordings, report_recording)
        actions = Actions(client, hub, recording)
        app[_HUB], app[_ACTIONS] = hub, actions
        hub.publish_latched("hello", {"version": __version__, "rig": rig})
        actions.publish_recording_state("")
        app[_LISTENING] = listening = asyncio.create_task(hub.run())
        yield
        if recording.running:
            await asyncio.to_thread(recording.stop)
        listening.cancel()
        await asyncio.wait({listening})

    app = web.Application(middlewares=[guard])
    app.cleanup_ctx.append(running)
    app.on_response_prepare.append(with_headers)
    app.router.add_get("/", index)
    app.router.add_get("/live", follow)
    app.router.add_static("/", PAGE)
    return app


async def _follow(request: web.Request) -> web.StreamResponse:
    """Send messages until the browser disconnects, and perform its actions."""
    hub, actions = request.app[_HUB], request.app[_ACTIONS]
    socket = web.WebSocketResponse(heartbeat=_HEARTBEAT_S, max_msg_size=_MESSAGE_BYTES, compress=False)
    await socket.prepare(request)
    viewer = Viewer()
    hub.join(viewer)

    async def send() -> None:
        with contextlib.suppress(ConnectionError):
            while not socket.closed:
                message = await viewer.next()
                await (socket.send_str(message) if isinstance(message, str) else socket.send_bytes(message))

    async def act(text: str) -> None:
        try:
            reply = await actions.reply(text)
        except ValueError as error:
            await socket.close(code=1008, message=str(error).encode()[:120])
            return
        viewer.queue_text(json.dumps({"kind": "reply", **reply}, ensure_ascii=False))

    tasks = {asyncio.create_task(send())}
    try:
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                break
            if message.data == GOT:
                viewer.answered()
            else:
                acting = asyncio.create_task(act(message.data))
                tasks.add(acting)
                acting.add_done_callback(tasks.discard)
    finally:
        hub.leave(viewer)
        for task in list(tasks):
            task.cancel()
    return socket


async def serve(app: web.Application, host: str, port: int, ready: Callable[[], None], stop: asyncio.Event) -> None:
    """Serve until `stop` is set; call `ready` once the page is available. WireError if the port is taken.

    An error of the subscription to the daemon also ends the server, so that the page does not silently stop updating.
    """
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        site = web.TCPSite(runner, host, port)
        try:
            await site.start()
        except OSError as error:
            remedy = "name an address of this computer with --listen"
            if error.errno == errno.EADDRINUSE:
                remedy = f"take another port, such as --port {port + 1 if port < 65535 else 8080}"
            raise WireError(
                f"cannot serve the page on {host} port {port}: {error.strerror or error}; {remedy}"
            ) from error
        ready()
        stopped = asyncio.create_task(stop.wait())
        either: set[asyncio.Task[Any]] = {stopped, app[_LISTENING]}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        if not stop.is_set():
            app[_LISTENING].result()
    finally:
        await runner.cleanup()
