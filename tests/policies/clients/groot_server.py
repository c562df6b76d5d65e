"""A server of GR00T's policy protocol that uses none of our code for its format."""

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import numpy as np
import zmq

TASK = "annotation.human.action.task_description"
NAMES = ("x", "y", "z", "roll", "pitch", "yaw", "gripper")
MODALITIES = {"video": ["image"], "state": [], "action": [*NAMES], "language": [TASK]}


def npy(array: np.ndarray) -> dict[str, Any]:
    file = io.BytesIO()
    np.save(file, array)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def nd(array: np.ndarray) -> dict[bytes, Any]:
    data = {b"type": array.dtype.str, b"kind": b"", b"shape": array.shape, b"data": array.tobytes()}
    return {b"nd": True, **data}


def config(keys: dict[str, list[str]], mark: str = "__ModalityConfig_class__") -> dict[str, Any]:
    moments = {"action": list(range(16))}
    configs = {kind: {"delta_indices": moments.get(kind, [0]), "modality_keys": names} for kind, names in keys.items()}
    return {kind: {mark: True, "as_json": value} for kind, value in configs.items() if value["modality_keys"]}


def parts(moves: np.ndarray, write: Callable[[np.ndarray], Any] = npy, prefix: str = "") -> dict[str, Any]:
    """``(count, steps, 7)`` moves as a reply contains them: one array per dimension."""
    return {f"{prefix}{name}": write(moves[:, :, [number]]) for number, name in enumerate(NAMES)}


@contextmanager
def served(*replies: Any, modalities: Any = None, port: int = 0) -> Iterator[tuple[str, list]]:
    """A server with scripted replies to observations; its name, and the requests that it got.

    A reply is raw bytes, a value to pack, or None for no reply; a single function makes them of all requests.
    """
    left, requests, over = list(replies), [], threading.Event()
    context = zmq.Context()
    line = context.socket(zmq.ROUTER)  # unlike REP it need not answer
    line.setsockopt(zmq.LINGER, 0)
    line.bind(f"tcp://127.0.0.1:{port or '*'}")
    url = line.getsockopt_string(zmq.LAST_ENDPOINT)

    def answer(request: dict[str, Any]) -> Any:
        if request["endpoint"] == "get_modality_config":
            return config(MODALITIES) if modalities is None else modalities
        if request["endpoint"] == "reset":
            return {}
        requests.append(request)
        return left[0](request) if callable(left[0]) else left.pop(0)

    def serve() -> None:
        while not over.is_set():
            if line.poll(20):
                *to, frame = line.recv_multipart()
                reply = answer(msgpack.unpackb(frame))
                if reply is not None:
                    line.send_multipart([*to, reply if isinstance(reply, bytes) else msgpack.packb(reply)])
        context.destroy(linger=0)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"groot:{url}", requests
    finally:
        over.set()
        thread.join()
