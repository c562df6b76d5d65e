"""A server of GR00T's policy protocol, written to its format and not with our own code."""

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
    told = {
        kind: {"delta_indices": moments.get(kind, [0]), "modality_keys": names}
        for kind, names in keys.items()
    }
    return {kind: {mark: True, "as_json": value} for kind, value in told.items() if value["modality_keys"]}


def parts(moves: np.ndarray, write: Callable[[np.ndarray], Any] = npy, prefix: str = "") -> dict[str, Any]:
    """``(count, steps, 7)`` moves as a reply has them: an array for every number."""
    return {f"{prefix}{name}": write(moves[:, :, [number]]) for number, name in enumerate(NAMES)}


@contextmanager
def served(*replies: Any, told: Any = None, port: int = 0) -> Iterator[tuple[str, list]]:
    """A server that answers observations with the next of some replies; its name, and what it was asked.

    A reply is bytes as they are, a value to pack, or None for none at all.
    """
    left, asked, over = list(replies), [], threading.Event()
    context = zmq.Context()
    line = context.socket(zmq.REP)
    line.setsockopt(zmq.LINGER, 0)
    line.bind(f"tcp://127.0.0.1:{port or '*'}")
    url = line.getsockopt_string(zmq.LAST_ENDPOINT)

    def answer(request: dict[str, Any]) -> Any:
        if request["endpoint"] == "get_modality_config":
            return config(MODALITIES) if told is None else told
        if request["endpoint"] == "reset":
            return {}
        asked.append(request)
        return left.pop(0)

    def serve() -> None:
        while not over.is_set():
            if line.poll(20):
                reply = answer(msgpack.unpackb(line.recv()))
                if reply is None:
                    break
                line.send(reply if isinstance(reply, bytes) else msgpack.packb(reply))
        over.wait()
        context.destroy(linger=0)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"groot:{url}", asked
    finally:
        over.set()
        thread.join()
