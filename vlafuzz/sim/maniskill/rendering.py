"""Whether a SAPIEN scene can render."""

from __future__ import annotations

import sapien


def render_system(scene: sapien.Scene) -> sapien.render.RenderSystem | None:
    """The scene's renderer; None for physics only."""
    try:
        return scene.render_system
    except RuntimeError:  # SAPIEN's way to say that there is none
        return None
