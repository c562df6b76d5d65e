"""Which device renders, and whether a scene has a renderer."""

from __future__ import annotations

import sapien


def render_system(scene: sapien.Scene) -> sapien.render.RenderSystem | None:
    """The scene's renderer; None for physics only."""
    try:
        return scene.render_system
    except RuntimeError:  # SAPIEN's way to say that there is none
        return None


def render_backend() -> str:
    """ManiSkill's name of what renders here: a GPU if there is one, else the CPU."""
    try:
        sapien.Device("cuda")
    except RuntimeError:
        return "sapien_cpu"
    return "sapien_cuda"
