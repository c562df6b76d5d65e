"""The smallest server that vlafuzz can test: POST /act with a picture and a sentence."""

import base64
import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np


def act(image, instruction):  # (224, 224, 3) uint8 and a sentence; your model here
    brightness = image.mean() / 255
    return [0.0, 0.0, -0.03 * brightness, 0.0, 0.0, 0.0, 1.0]  # metres, radians, 1 opens and -1 closes


def arrays(value):  # NumPy arrays as json-numpy writes them
    if "__numpy__" not in value:
        return value
    data = base64.b64decode(value["__numpy__"])
    return np.frombuffer(data, np.dtype(value["dtype"])).reshape(value["shape"])


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        seen = json.loads(body, object_hook=arrays)
        reply = json.dumps({"action": act(seen["image"], seen["instruction"])}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(reply)))
        self.end_headers()
        self.wfile.write(reply)

    def log_message(self, *_):
        pass


if __name__ == "__main__":
    ThreadingHTTPServer(("0.0.0.0", 8000), Handler).serve_forever()
