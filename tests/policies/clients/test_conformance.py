"""Against the reference implementations openpi-client, json-numpy and msgpack-numpy, in a separate venv.

openpi-client 0.1.2 wants NumPy 1, which excludes our own packages. So it is not among them; name the Python of an
environment in which it is: python -m venv there; there/bin/pip install openpi-client==0.1.2 typing-extensions
json-numpy==2.1.1 msgpack-numpy==0.4.8; VLAFUZZ_OTHERS=there/bin/python scripts/test -m slow
"""

import os
import subprocess
from pathlib import Path

import pytest

OTHERS = os.environ.get("VLAFUZZ_OTHERS")
GOLDEN = Path(__file__).parent / "golden"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(OTHERS is None, reason="VLAFUZZ_OTHERS names no Python with openpi-client"),
]
MADE = """
import json, pathlib, sys
import json_numpy, msgpack, msgpack_numpy as theirs, numpy as np
from openpi_client import msgpack_numpy
image = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
obs = {"observation/image": image, "observation/wrist_image": image[::-1].copy(),
       "observation/state": np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0, 0.02, -0.02]), "prompt": "pick up apple"}
reply = {"actions": np.linspace(-1, 1, 14).reshape(2, 7).astype(np.float32), "state": np.array([0.5]),
         "server_timing": {"infer_ms": np.float64(1.5), "prev_total_ms": 2.5},
         "policy_timing": {"infer_ms": np.float32(1.25)}}
groot = [{"x": np.linspace(-1, 1, 14).reshape(1, 2, 7).astype(np.float32)}, {"milliseconds": np.float32(1.5)}]
act = {"image": image, "instruction": "pick up apple", "unnorm_key": "bridge_orig"}
move = np.linspace(-1, 1, 7)
out = pathlib.Path(sys.argv[1])
out.joinpath("openpi_observation.msgpack").write_bytes(msgpack_numpy.packb(obs))
out.joinpath("openpi_reply.msgpack").write_bytes(msgpack_numpy.packb(reply))
out.joinpath("groot_reply.msgpack").write_bytes(msgpack.packb(groot, default=theirs.encode))
out.joinpath("act_request.txt").write_text(json_numpy.dumps(act))
out.joinpath("act_request_encoded.txt").write_text(json.dumps({"encoded": json_numpy.dumps(act)}))
out.joinpath("act_reply.txt").write_text(json_numpy.dumps(move))
out.joinpath("act_reply_chunk.txt").write_text(json_numpy.dumps(list(np.linspace(-1, 1, 14).reshape(2, 7))))
out.joinpath("act_reply_encoded.txt").write_text(json.dumps(json_numpy.dumps(move)))
"""


def others(script: str, *arguments: object) -> str:
    """The output of a script in that environment."""
    command = [OTHERS, "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_golden_frames_are_what_they_write_today(tmp_path):
    others(MADE, tmp_path)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert files == {path.name: path.read_bytes() for path in GOLDEN.iterdir()}
