"""The cameras of an environment: what ManiSkill is to create, and the images that they take."""

from collections.abc import Sequence

import cv2
import numpy as np
import sapien
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.sensors.camera import CameraConfig
from numpy.typing import NDArray

from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.manipulation.camera import CameraPose, camera_pose
from vlafuzz.worlds.manipulation.rigs import Rig
from vlafuzz.worlds.tabletop.sim.rendering import use_shaders
from vlafuzz.worlds.tabletop.sim.robots import wrist_of

Picture = NDArray[np.uint8]
# In the hand's frame: in front of the palm, 5 cm off its middle, looking along the fingers.
WRIST_CAMERA = ((0.05, 0.0, 0.03), (0.0, 0.5**0.5, 0.0, 0.5**0.5))


class Cameras:
    """The requested cameras of one rig."""

    def __init__(self, rig: Rig, requests: Sequence[CameraRequest]) -> None:
        self._rig, self._requests = rig, {request.name: request for request in requests}

    @property
    def third_person(self) -> list[str]:
        return [name for name, request in self._requests.items() if request.role == "third_person"]

    def configs(self, agent: BaseAgent) -> list[CameraConfig]:
        """The requested cameras for ManiSkill, at their nominal poses."""
        configs = []
        for name, request in self._requests.items():
            if request.role == "third_person":
                configs.append(self._config(name, self._width(request), request.height))
                continue
            size = request.width, request.height
            more = {"mount": wrist_of(agent), "shader_config": use_shaders()}
            configs.append(CameraConfig(name, sapien.Pose(*WRIST_CAMERA), *size, np.pi / 2, **more))
        return configs

    def picture(self, name: str, camera: sapien.render.RenderCameraComponent) -> Picture:
        """``(height, width, 3)``: what a camera shows at present, in the requested size."""
        camera.take_picture()
        colour = camera.get_picture("Color")[..., :3]
        image = np.asarray(np.clip(colour * 255 + 0.5, 0, 255) if colour.dtype != np.uint8 else colour, dtype=np.uint8)
        request = self._requests[name]
        size = (request.width, request.height)
        if image.shape[1::-1] != size:
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return image

    def _width(self, request: CameraRequest) -> int:
        """The rendered width: a view that is not square is rendered whole, then squeezed to the request."""
        view = self._rig.view
        return request.width if view.aspect == 1 else view.width(request.height)

    def _config(self, name: str, width: int, height: int) -> CameraConfig:
        view = camera_pose(self._rig.view)
        fov = np.radians(self._rig.view.fov)
        return CameraConfig(name, sapien_pose(view), width, height, fov, shader_config=use_shaders())


def sapien_pose(view: CameraPose) -> sapien.Pose:
    return sapien.Pose(view.position, view.quaternion)
