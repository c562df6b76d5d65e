"""A ZeroMQ connection for one request at a time. All failures are PolicyErrors with their cause."""

import socket
from urllib.parse import urlsplit

import zmq

from vlafuzz.policies.clients.wire import MAX_BYTES, OPENING, blamed, failure, late, short


class ZmqConnection:
    """A connection; after an error it is useless, since a request without a reply blocks the next one.

    ZeroMQ connects in the background and waits forever, so a plain TCP connection checks for a server first.
    """

    def __init__(self, url: str, timeout: float) -> None:
        self.url, self._timeout = url, timeout
        parts = urlsplit(url)
        with blamed(url, min(timeout, OPENING)):
            socket.create_connection((parts.hostname, parts.port), min(timeout, OPENING)).close()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_BYTES)
        self._socket.setsockopt(zmq.SNDTIMEO, int(timeout * 1000))
        self._lost = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._socket.connect(url)

    def ask(self, frame: bytes) -> bytes:
        """The reply to a request; PolicyError when it does not come in time, or the connection broke."""
        try:
            self._socket.send(frame)
            return self._reply()
        except zmq.Again:
            raise late(self.url, self._timeout) from None
        except zmq.ZMQError as error:
            raise failure(self.url, short(error), "connect") from None

    def _reply(self) -> bytes:
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._lost, zmq.POLLIN)
        ready = dict(poller.poll(int(self._timeout * 1000)))
        if self._socket in ready:
            return bytes(self._socket.recv())
        if ready:
            message = f"the connection broke, or a reply has more than {MAX_BYTES >> 20} MiB"
            raise failure(self.url, message, "connect")
        raise late(self.url, self._timeout)

    def close(self) -> None:
        self._socket.disable_monitor()
        self._context.destroy(linger=0)
