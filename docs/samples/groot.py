"""The smallest server that speaks as GR00T's does."""

import io

import msgpack
import numpy as np
import zmq

ACTION = ("x", "y", "z", "roll", "pitch", "yaw", "gripper")
KEYS = {"video": ["image"], "action": ACTION, "language": ["annotation.human.action.task_description"]}


def array(value):
    file = io.BytesIO()
    np.save(file, value)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def answer(request):
    if request["endpoint"] == "get_modality_config":
        return {kind: {"delta_indices": [0], "modality_keys": keys} for kind, keys in KEYS.items()}
    if request["endpoint"] == "reset":
        return {}
    picture = np.load(io.BytesIO(request["data"]["observation"]["video"]["image"]["as_npy"]))
    move = np.full((len(picture), 1, 1), 0.01, np.float32)  # (scenes, steps, 1); your model here
    return [{part: array(move) for part in ACTION}, {}]


def serve(socket):
    socket.send(msgpack.packb(answer(msgpack.unpackb(socket.recv()))))


if __name__ == "__main__":
    socket = zmq.Context.instance().socket(zmq.REP)
    socket.bind("tcp://0.0.0.0:5555")
    while True:
        serve(socket)
