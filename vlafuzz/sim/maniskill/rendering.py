"""Rendering: the device, the shaders, and whether a scene has a renderer."""

from __future__ import annotations

import hashlib
import json
import os
import re
from functools import cache
from pathlib import Path

import sapien
from mani_skill.render.shaders import ShaderConfig

from vlafuzz import shipped

# The reflectance table of SAPIEN's shaders takes 6 s to compute on a CPU. It is for mirrored surroundings, of
# which there are none: without it the pictures are the same.
_NAME = "samplerBRDFLUT"
_TABLE = re.compile(r"^layout\(.*\) uniform sampler2D samplerBRDFLUT;$", re.MULTILINE)
_LOOKUP = re.compile(r"texture\(samplerBRDFLUT, [^;]*\)\.xy")
_FORMATS = {
    "Color": "r8g8b8a8unorm",
    "ColorRaw": "r8g8b8a8unorm",
    "PositionSegmentation": "r16g16b16a16sint",
}


def render_system(scene: sapien.Scene) -> sapien.render.RenderSystem | None:
    """The renderer of a scene; None if it only has physics."""
    try:
        return scene.render_system
    except RuntimeError:  # raised by SAPIEN if there is none
        return None


def render_backend() -> str:
    """ManiSkill's name of the rendering device: a GPU if there is one, else the CPU."""
    os.environ.setdefault("LP_NUM_THREADS", "0")  # lavapipe's threads; one worker per core is faster
    try:
        sapien.Device("cuda")
    except RuntimeError:
        return "sapien_cpu"
    return "sapien_cuda"


def use_shaders() -> ShaderConfig:
    """Use our shaders for all cameras that are added from now on: SAPIEN keeps them globally."""
    pack = _shader_pack()
    sapien.render.set_camera_shader_dir(str(pack))
    for name, format_ in _FORMATS.items():
        sapien.render.set_picture_format(name, format_)
    return _config(pack)


@cache
def _config(pack: Path) -> ShaderConfig:
    return ShaderConfig(
        shader_pack=str(pack),
        texture_names={"Color": ["rgb"]},
        texture_transforms={"Color": lambda data: {"rgb": data[..., :3]}},
    )


@cache
def _shader_pack() -> Path:
    """SAPIEN's fastest shader pack without the reflectance table, in the user's cache."""
    source = Path(sapien.__file__).parent / "vulkan_shader"
    shaders = {
        f"{name}/{file.name}": _without_table(file.read_text(encoding="utf-8"))
        for name in ("minimal", "common")
        for file in sorted((source / name).iterdir())
    }
    digest = hashlib.sha256(json.dumps(shaders).encode()).hexdigest()[:20]
    folder = shipped.made_once(
        f"shaders/{digest}",
        lambda folder: _fill(shaders, folder),
        lambda folder: all((folder / name).is_file() for name in shaders),
    )
    return folder / "minimal"


def _without_table(shader: str) -> str:
    """The shader without the table; unchanged if SAPIEN has changed how it uses it, which is only slower."""
    without = _LOOKUP.sub("vec2(0)", _TABLE.sub("", shader))
    return shader if _NAME in without else without


def _fill(shaders: dict[str, str], folder: Path) -> None:
    for name, text in shaders.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
