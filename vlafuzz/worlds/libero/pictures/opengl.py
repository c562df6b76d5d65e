"""Which OpenGL draws LIBERO's pictures. It is asked in a child process, since drivers may crash."""

from __future__ import annotations

import subprocess
import sys
from functools import cache

from vlafuzz.worlds.libero.packages import load, versions

_CHILD = "from vlafuzz.worlds.libero.pictures.opengl import tell; tell()"


@cache
def opengl() -> str:
    """Device, driver and the versions of what draws with it; empty if no pictures can be drawn."""
    try:
        told = subprocess.run(
            [sys.executable, "-c", _CHILD], capture_output=True, text=True, timeout=120, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    found = versions()
    return f"{told.stdout.strip()}, MuJoCo {found.mujoco}, robosuite {found.robosuite}"


def tell() -> None:
    """Main function of the child process: print the device and the driver with its version."""
    context = load("mujoco.egl").GLContext(8, 8)
    context.make_current()
    gl = load("OpenGL.GL")
    device, version = (gl.glGetString(name).decode() for name in (gl.GL_RENDERER, gl.GL_VERSION))
    driver = version[version.find("Mesa") :] if "Mesa" in version else f"OpenGL {version}"
    sys.stdout.write(f"{device}, {driver}\n")
    context.free()
