#!/usr/bin/env python
"""Write the frames in tests/policies/clients/golden as the reference implementations do.

openpi-client 0.1.2 wants NumPy 1, which excludes our own packages, so this runs in an environment of its own:

    python -m venv there
    there/bin/pip install openpi-client==0.1.2 typing-extensions json-numpy==2.1.1 msgpack-numpy==0.4.8
    there/bin/python scripts/make_frames.py tests/policies/clients/golden && git diff --exit-code tests
"""

import argparse
import json
from pathlib import Path

import json_numpy
import msgpack
import msgpack_numpy
import numpy as np
from openpi_client import msgpack_numpy as openpi

IMAGE = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
MOVE, CHUNK = np.linspace(-1, 1, 7), np.linspace(-1, 1, 14).reshape(2, 7)
OPENPI = {
    "observation": {
        "observation/image": IMAGE,
        "observation/wrist_image": IMAGE[::-1].copy(),
        "observation/state": np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0, 0.02, -0.02]),
        "prompt": "pick up apple",
    },
    "reply": {
        "actions": CHUNK.astype(np.float32),
        "state": np.array([0.5]),
        "server_timing": {"infer_ms": np.float64(1.5), "prev_total_ms": 2.5},
        "policy_timing": {"infer_ms": np.float32(1.25)},
    },
}
GROOT = [{"x": CHUNK[None].astype(np.float32)}, {"milliseconds": np.float32(1.5)}]
REQUEST = json_numpy.dumps({"image": IMAGE, "instruction": "pick up apple", "unnorm_key": "bridge_orig"})
ACT = {
    "request": REQUEST,
    "request_encoded": json.dumps({"encoded": REQUEST}),
    "reply": json_numpy.dumps(MOVE),
    "reply_chunk": json_numpy.dumps(list(CHUNK)),
    "reply_encoded": json.dumps(json_numpy.dumps(MOVE)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    for name, message in OPENPI.items():
        (folder / f"openpi_{name}.msgpack").write_bytes(openpi.packb(message))
    (folder / "groot_reply.msgpack").write_bytes(msgpack.packb(GROOT, default=msgpack_numpy.encode))
    for name, text in ACT.items():
        (folder / f"act_{name}.txt").write_text(text)


if __name__ == "__main__":
    main()
