"""The studio: a twin of what a scene shows, under lights that cast shadows, for pictures that people look at.

The simulated scene, its lights and its cameras are left as they are, so what policies see does not change.
"""

from collections.abc import Mapping

import cv2
import numpy as np
import sapien
from numpy.typing import NDArray

from vlafuzz.worlds.manipulation.rigs import Lights
from vlafuzz.worlds.tabletop.sim.rendering import SceneLights, full_shaders

# A key light from the front left, and a weak one against it. All of it is as bright as the Panda's own lights.
LIGHTS = Lights(ambient=0.2, directional=(((-0.45, 0.5, -1.0), 1.0), ((-0.6, -0.5, -1.0), 0.25)))
FINER = 2  # pixels of a side that are averaged to one: smooth edges


class Studio:
    """Draws the pictures of some cameras.

    Args:
        cameras: of the simulated scene by their names, which are followed.
    """

    def __init__(self, device: sapien.Device, cameras: Mapping[str, sapien.render.RenderCameraComponent]) -> None:
        self._scene = sapien.Scene([sapien.render.RenderSystem(device)])
        self._lights = SceneLights(self._scene, LIGHTS, shadows=True)
        self._followed = cameras
        self._cameras = {name: self._twin_of(camera) for name, camera in cameras.items()}
        self._twins: list[tuple[sapien.Entity, sapien.Entity]] = []

    def begin(self, scene: sapien.Scene, light: float) -> None:
        """Show what is visible in a scene, under light × ``light``."""
        for _, twin in self._twins:
            self._scene.remove_entity(twin)
        self._twins = []
        for entity in scene.entities:
            visual = entity.find_component_by_type(sapien.render.RenderBodyComponent)
            if visual is not None:
                twin = sapien.Entity()
                twin.add_component(visual.clone())
                self._scene.add_entity(twin)
                self._twins.append((entity, twin))
        self._lights.apply(self._scene, light)

    def picture(self, camera: str) -> NDArray[np.uint8]:
        """``(height, width, 3)``: what a camera shows at present."""
        for entity, twin in self._twins:
            twin.pose = entity.pose
        taking, followed = self._cameras[camera], self._followed[camera]
        taking.entity.pose = followed.get_global_pose()
        self._scene.update_render()
        taking.take_picture()
        image = taking.get_picture("Color")[..., :3]
        size = (followed.width, followed.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def _twin_of(self, camera: sapien.render.RenderCameraComponent) -> sapien.render.RenderCameraComponent:
        full_shaders()
        twin = sapien.render.RenderCameraComponent(FINER * camera.width, FINER * camera.height)
        across, down, u, v = (FINER * length for length in (camera.fx, camera.fy, camera.cx, camera.cy))
        twin.set_perspective_parameters(camera.near, camera.far, across, down, u, v, 0.0)
        entity = sapien.Entity()
        entity.add_component(twin)
        self._scene.add_entity(entity)
        return twin
