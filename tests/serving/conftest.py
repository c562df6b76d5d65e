"""Fixtures of the clients' tests, which servers are tested with too."""

from tests.clients.conftest import no_pause, opened

__all__ = ["no_pause", "opened"]
