"""Fixtures of the clients' tests, which the tests of servers share."""

from tests.policies.clients.conftest import no_pause, opened

__all__ = ["no_pause", "opened"]
