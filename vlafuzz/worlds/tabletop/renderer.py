"""Probes whether this machine can render, by a tiny picture in a child process, since drivers may crash.

``python -m vlafuzz.worlds.tabletop.renderer`` prints one line and exits with 0 or 3.
"""

import ctypes
import json
import os
import struct
import sys
from functools import cache
from typing import Any, NamedTuple

from vlafuzz.common.child import tried

HINT = (
    "install mesa-vulkan-drivers 24.3 or newer and libvulkan1, as scripts/setup does on Debian and Ubuntu; "
    "with a GPU, its maker's Vulkan driver"
)
# SAPIEN's default pack would first compute a reflectance table, for 6 s on a CPU.
SHADER_PACK = "trivial"
_CHILD = "from vlafuzz.worlds.tabletop.renderer import _draw; _draw()"


class Renderer(NamedTuple):
    """A device and driver with which the probe drew a picture; ``problem``: why it did not."""

    device: str | None = None
    driver: str | None = None
    problem: str | None = None

    @property
    def works(self) -> bool:
        return self.problem is None

    @property
    def name(self) -> str:
        return ", ".join(part for part in (self.device, self.driver) if part)

    def __str__(self) -> str:
        if self.works:
            return f"rendering works: {self.name}"
        return f"rendering does not work: {self.problem}" + (f" ({self.name})" if self.name else "")


def probe(timeout: float = 120.0) -> Renderer:
    """Draw one picture in a new process within ``timeout`` seconds."""
    lines, problem = tried(_CHILD, timeout, LP_NUM_THREADS="0")
    answers = [line for line in lines if line.startswith("{")]
    return Renderer(**json.loads(answers[-1])) if answers else Renderer(problem=problem or "no output")


@cache
def probe_once() -> Renderer:
    """The result of the first probe of this process, which takes half a second."""
    return probe()


def _draw() -> None:
    """Main function of the child process; prints a ``Renderer`` as JSON."""
    seen, problem = Renderer(), None
    try:
        chosen = rendering_device()
        listed = _vulkan_devices()
        seen = next((device for device in listed if device.device == chosen.name), [*listed, seen][0])
        if not _picture(chosen).any():
            problem = "the picture is black"
    except ImportError as error:
        problem = f"SAPIEN cannot be imported: {error}"
    except RuntimeError as error:
        problem = str(error) if seen.device else f"Vulkan finds no device ({error})"
    sys.stdout.write(json.dumps(seen._replace(problem=problem)._asdict()) + "\n")
    sys.stdout.flush()
    os._exit(0)  # without unloading the driver, which may crash


def rendering_device() -> Any:
    """SAPIEN's device: the GPU where CUDA finds one and Vulkan has a driver for it, else what Vulkan has."""
    import sapien

    try:
        device = sapien.Device("cuda")
        sapien.render.RenderSystem(device)
    except RuntimeError:
        return sapien.Device("cpu")
    return device


def _picture(device: Any) -> Any:
    """The colours of 16 × 16 pixels with a white box in view."""
    import sapien

    sapien.render.set_camera_shader_dir(SHADER_PACK)
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem(device)])
    builder = scene.create_actor_builder()
    builder.add_box_visual(half_size=[0.1, 0.1, 0.1], material=[1.0, 1.0, 1.0])
    builder.set_initial_pose(sapien.Pose([1.0, 0.0, 0.0]))
    builder.build_static(name="box")
    camera = scene.add_camera("camera", 16, 16, 1.0, 0.1, 10.0)
    scene.update_render()
    camera.take_picture()
    return camera.get_picture("Color")[..., :3]


# Vulkan's structures, in the format of ``struct``. Each begins with its type and the address of the next.
_APPLICATION = "iPPIPII"  # name, version, engine, its version, version of the interface
_INSTANCE = "iPIPIPIP"  # flags, application, layers and extensions with their counts
_DRIVER = "iPi256s256s4x"  # number, name, version
_DEVICE = "iP20x256s1024x"  # name; room for limits and more, of which Vulkan writes 548 bytes
_DRIVER_TYPE, _DEVICE_TYPE = 1000196000, 1000059001
_VULKAN_1_2 = (1 << 22) | (2 << 12)


def _vulkan_devices() -> list[Renderer]:
    """Vulkan's devices with their drivers' versions; empty without Vulkan. This loads the drivers."""
    try:
        vulkan = ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return []
    instance, count, handles = ctypes.c_void_p(), ctypes.c_uint32(16), (ctypes.c_void_p * 16)()
    application = _filled(_APPLICATION, 0, 0, 0, 0, 0, 0, _VULKAN_1_2)
    info = _filled(_INSTANCE, 1, 0, 0, ctypes.addressof(application), 0, 0, 0, 0)
    if vulkan.vkCreateInstance(info, None, ctypes.byref(instance)) != 0:
        return []
    if vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles) < 0:
        return []
    return [_described(vulkan, handle) for handle in handles[: count.value] if handle]


def _filled(form: str, *values: int | bytes) -> ctypes.Array[ctypes.c_char]:
    return ctypes.create_string_buffer(struct.pack(form, *values))


def _described(vulkan: ctypes.CDLL, handle: int) -> Renderer:
    driver = _filled(_DRIVER, _DRIVER_TYPE, 0, 0, b"", b"")
    device = _filled(_DEVICE, _DEVICE_TYPE, ctypes.addressof(driver), b"")
    vulkan.vkGetPhysicalDeviceProperties2(ctypes.c_void_p(handle), device)
    _, _, _, driver_name, version = struct.unpack_from(_DRIVER, driver)
    _, _, device_name = struct.unpack_from(_DEVICE, device)
    name, info, shown = (field.partition(b"\0")[0].decode() for field in (driver_name, version, device_name))
    return Renderer(shown, info if info.startswith("Mesa") else f"{name} {info}")


if __name__ == "__main__":
    result = probe()
    print(result)  # noqa: T201 - a small program of its own
    sys.exit(0 if result.works else 3)
