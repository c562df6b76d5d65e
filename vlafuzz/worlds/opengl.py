"""Which OpenGL draws MuJoCo's pictures here, without a screen."""

import os
import subprocess
import sys
from functools import cache

# A driver may crash, so a child process asks it for its device, and its version.
_CHILD = """
from mujoco.egl import GLContext
context = GLContext(8, 8)
context.make_current()
from OpenGL import GL
device, version = (GL.glGetString(name).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION))
print(device, version[version.find("Mesa"):] if "Mesa" in version else f"OpenGL {version}", sep=", ")
context.free()
"""


@cache
def device() -> str:
    """Device and driver with its version; empty if no pictures can be drawn."""
    child, place = [sys.executable, "-c", _CHILD], {"MUJOCO_GL": "egl", **os.environ}
    try:
        told = subprocess.run(child, env=place, capture_output=True, text=True, timeout=120, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return told.stdout.strip()
