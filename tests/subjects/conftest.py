"""What tests of model servers share."""

import pytest


@pytest.fixture
def no_pause(monkeypatch):
    """No waiting between attempts to connect."""
    from vlafuzz.subjects import vla_eval_wire

    monkeypatch.setattr(vla_eval_wire, "PAUSES", (0.0, 0.0))


@pytest.fixture
def opened(monkeypatch):
    """All connections that a test opens; it leaves none of them open."""
    from tests.subjects.served import still_open
    from vlafuzz.subjects import vla_eval_wire

    made, connect = [], vla_eval_wire.connect
    monkeypatch.setattr(vla_eval_wire, "connect", lambda *a, **k: made.append(connect(*a, **k)) or made[-1])
    yield made
    assert still_open(made) == 0
