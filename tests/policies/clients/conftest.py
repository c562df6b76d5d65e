"""Fixtures for tests of model servers."""

import pytest


@pytest.fixture
def no_pause(monkeypatch):
    """No pauses between attempts to connect."""
    from vlafuzz.policies.clients import wire

    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))


@pytest.fixture
def opened(monkeypatch):
    """All connections that a test opens, which it must close."""
    from websockets.sync import client as sockets

    from tests.policies.clients.served import still_open

    connections, connect = [], sockets.connect
    monkeypatch.setattr(sockets, "connect", lambda *a, **k: connections.append(connect(*a, **k)) or connections[-1])
    yield connections
    assert still_open(connections) == 0
