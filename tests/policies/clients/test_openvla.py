"""The client of /act: its JSON, and servers that misbehave."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.policies.clients.served import black, check_failure, failure, seen, start
from vlafuzz.policies.clients.openvla import decode, encode
from vlafuzz.rollouts.policies import make_policy

GOLDEN = Path(__file__).parent / "golden"  # by json-numpy 2.1.1: scripts/make_frames.py
PICTURE = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
STILL = [0.0] * 6 + [1.0]
pytestmark = pytest.mark.usefixtures("no_pause")


@contextmanager
def scripted(*replies: Any, keep: bool = True) -> Iterator[tuple[str, list, threading.Semaphore]]:
    """A server with scripted replies (status, body) or waits; its name, the requests that it got, and a count of the
    connections that are closed.

    ``keep``: as HTTP 1.1 keeps a connection; else it is closed after the reply, without a word.
    """
    left, requests, over = list(replies), [], threading.Event()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            requests.append((self.path, body))
            reply = left.pop(0)
            if isinstance(reply, float):
                over.wait(reply)
            elif isinstance(reply, bytes):
                self.wfile.write(reply)
                self.close_connection = True
            else:
                self.send_response(reply[0])
                self.send_header("Content-Length", str(len(reply[1])))
                self.end_headers()
                self.wfile.write(reply[1].encode())
                self.close_connection = not keep

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads, server.block_on_close = True, False
        shut, closed = server.shutdown_request, threading.Semaphore(0)
        server.shutdown_request = lambda request: shut(request) or closed.release()
        threading.Thread(target=server.serve_forever, args=(0.02,)).start()
        yield f"http://127.0.0.1:{server.server_port}/act", requests, closed
        over.set()
        server.shutdown()


def answered(*replies: Any, options: str = "?camera=0", keep: bool = True) -> tuple[list, list]:
    """The actions in these replies, and the requests."""
    with scripted(*replies, keep=keep) as (name, requests, closed):
        policy = make_policy(name + options)
        policy.reset([start("one", 3)])
        pictures = black(policy.spec)
        closed.acquire()  # the connection of the policy's making
        answers = []
        for _ in replies:
            answers += [policy.act([seen("one", images=pictures)])[0].actions.tolist()]
            keep or closed.acquire()
        policy.close()
    return answers, requests


MESSAGE = {"image": PICTURE, "instruction": "pick up apple", "unnorm_key": "bridge_orig"}


class TestJson:
    def test_a_request_equals_that_of_json_numpy(self):
        assert encode(MESSAGE).decode() == (GOLDEN / "act_request.txt").read_text()

    @pytest.mark.parametrize("name", ["act_reply", "act_reply_chunk", "act_reply_encoded"])
    def test_replies_of_json_numpy_are_read(self, name):
        decoded = np.atleast_2d(decode((GOLDEN / f"{name}.txt").read_bytes()))
        expected = np.linspace(-1, 1, 14).reshape(2, 7) if "chunk" in name else np.linspace(-1, 1, 7)[None]
        assert np.array_equal(decoded, expected)


class TestConversation:
    @pytest.mark.parametrize(
        ("reply", "steps"),
        [
            (json.dumps(STILL), 1),
            (json.dumps([STILL] * 3), 3),
            (encode(np.array(STILL)).decode(), 1),
            (encode(encode(np.array(STILL)).decode()).decode(), 1),
            (encode([np.array(STILL)] * 8).decode(), 8),
            (encode({"action": np.array(STILL)}).decode(), 1),
            (encode({"actions": [STILL]}).decode(), 1),
        ],
    )
    def test_one_action_or_a_chunk_as_arrays_or_lists(self, reply, steps):
        assert answered((200, reply))[0] == [[STILL] * steps]

    def test_a_request_is_openvlas(self):
        _, requests = answered((200, json.dumps(STILL)), options="?camera=48x32&unnorm_key=bridge_orig")
        path, body = requests[0]
        message = decode(body)
        assert (path, list(message)) == ("/act", ["image", "instruction", "unnorm_key"])
        assert (message["image"].shape, message["image"].dtype) == ((32, 48, 3), np.uint8)
        assert (message["instruction"], message["unnorm_key"]) == ("pick up apple", "bridge_orig")

    def test_a_connection_that_the_server_has_closed_in_between_is_opened_anew(self):
        reply = (200, json.dumps(STILL))
        assert answered(reply, reply, keep=False)[0] == [[STILL]] * 2


class TestWrongAnswers:
    @pytest.mark.parametrize(
        ("reply", "cause", "says"),
        [
            ((200, '"error"'), "remote", 'it answers "error"$'),
            ((200, '{"error": "no memory"}'), "remote", ": no memory$"),
            ((500, "Internal Server Error"), "remote", "HTTP 500: Internal Server Error"),
            ((404, '{"detail": "Not Found"}'), "remote", "HTTP 404"),
            ((200, "<html>"), "protocol", "not a reply of /act: <html>"),
            ((200, '"up a bit"'), "protocol", "not a reply of /act"),
            ((200, "[" * 100_000), "protocol", "not a reply of /act"),
            ((200, '{"__numpy__": "AA==", "dtype": "<f8", "shape": [7]}'), "protocol", "buffer"),
            ((200, "{}"), "bad_action", "without actions"),
            ((200, "null"), "bad_action", "no numbers: None"),
            ((200, '["up", "down"]'), "bad_action", "no numbers"),
            ((200, "[[1], [1, 2]]"), "bad_action", "inhomogeneous"),
            ((200, "[0, 0, 0]"), "bad_action", r"actions of shape \(1, 3\)"),
            ((200, " " * (5 << 20)), "protocol", "more than 4 MiB"),
            (b"SSH-2.0\r\n", "protocol", "not HTTP: BadStatusLine"),
            (b"", "connect", "closed connection"),
            (b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n[", "protocol", "IncompleteRead|not a reply"),
        ],
    )
    def test_are_errors_with_their_cause(self, reply, cause, says):
        with scripted(reply) as (name, *_):
            check_failure(failure(f"{name}?camera=0"), cause, says)

    def test_a_slow_server_runs_out_of_time(self):
        with scripted(5.0) as (name, *_):
            error = failure(f"{name}?camera=0&timeout=0.2")
        assert (error.cause, error.message.split(": ")[-1]) == ("timeout", "no reply within 0.2 s")
