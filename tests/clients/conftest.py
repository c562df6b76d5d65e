"""What tests of model servers share."""

import pytest


@pytest.fixture
def no_pause(monkeypatch):
    """No waiting between attempts to connect."""
    from vlafuzz.clients import wire

    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))


@pytest.fixture
def opened(monkeypatch):
    """All connections that a test opens; it leaves none of them open."""
    from tests.clients.served import still_open
    from vlafuzz.clients import websocket_connection as sockets

    made, connect = [], sockets.connect
    monkeypatch.setattr(sockets, "connect", lambda *a, **k: made.append(connect(*a, **k)) or made[-1])
    yield made
    assert still_open(made) == 0
