"""The lights of a scene: those of the rig, scaled by the scene's intensity."""

from __future__ import annotations

import numpy as np
import sapien

from vlafuzz.rigs.rig import Lights


class SceneLights:
    """Ambient and directional lights. Their entities move with the others into each new PhysX scene."""

    def __init__(self, scene: sapien.Scene, nominal: Lights) -> None:
        self._nominal = nominal
        self._lights: list[sapien.render.RenderDirectionalLightComponent] = []
        for direction, intensity in nominal.directional:
            light = sapien.render.RenderDirectionalLightComponent()
            light.color = [intensity] * 3
            light.disable_shadow()
            entity = sapien.Entity()
            entity.name = "light"
            entity.add_component(light)
            entity.pose = _looking_along(direction)
            scene.add_entity(entity)
            self._lights.append(light)

    def apply(self, scene: sapien.Scene, intensity: float) -> None:
        """Scale all lights including the ambient one."""
        scene.render_system.ambient_light = [self._nominal.ambient * intensity] * 3
        for light, (_, nominal) in zip(self._lights, self._nominal.directional, strict=True):
            light.color = [nominal * intensity] * 3

    def measure(self, scene: sapien.Scene) -> float:
        """The factor on the nominal lights, read back from the renderer.

        Raises:
            ValueError: the lights are not scaled by one factor.
        """
        factors = [float(scene.render_system.ambient_light[0]) / self._nominal.ambient]
        factors += [
            float(light.color[0]) / nominal
            for light, (_, nominal) in zip(self._lights, self._nominal.directional, strict=True)
        ]
        if max(factors) - min(factors) > 1e-4 * max(factors):
            raise ValueError(f"lights scaled by {factors}")
        return factors[0]


def _looking_along(direction: tuple[float, float, float]) -> sapien.Pose:
    forward = np.array(direction) / np.linalg.norm(direction)
    side = np.cross([0.0, 1.0, 0.0] if abs(forward[1]) < 0.9 else [1.0, 0.0, 0.0], forward)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([forward, np.cross(forward, -side), side], axis=1)
    return sapien.Pose(matrix)
