"""What a service manager is told, wherever its socket is; a manager that went away takes nothing with it."""

from __future__ import annotations

import socket

from insole_daemon.service.notify import notify


def test_a_socket_without_a_file(monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(b"")  # the kernel chooses a name in its abstract namespace
        name = manager.getsockname()
        monkeypatch.setenv("NOTIFY_SOCKET", "@" + name[1:].decode())
        notify("READY=1", "STATUS=reading")
        assert manager.recv(100) == b"READY=1\nSTATUS=reading"


def test_a_manager_that_went_away(monkeypatch, tmp_path):
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("WATCHDOG=1")
