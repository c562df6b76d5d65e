"""make_env: an environment for a task, ready to be driven through ``begin`` and ``advance``."""

from __future__ import annotations

import gc

import gymnasium

from vlafuzz.errors import PrerequisiteError
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.policies.base import CameraRequest
from vlafuzz.sim.maniskill.env import TabletopEnv, gym_id
from vlafuzz.sim.maniskill.rendering import render_backend


def make_env(
    task: str,
    catalogue: Catalogue,
    cameras: tuple[CameraRequest, ...] = (),
    control_hz: int = 5,
    robot: str = "panda",
    placement: str = "resting",
) -> TabletopEnv:
    """A new environment; without cameras it needs no renderer.

    Raises:
        PrerequisiteError: it has cameras, and nothing here can render; or the robot's files are missing.
    """
    try:
        made = gymnasium.make(
            gym_id(task),
            catalogue=catalogue,
            cameras=cameras,
            control_hz=control_hz,
            robot=robot,
            placement=placement,
            obs_mode="none",
            render_backend=render_backend() if cameras else "none",
        )
    except RuntimeError as error:
        if "rendering device" not in str(error):
            raise
        raise PrerequisiteError(
            f"pictures need a renderer: {error}", hint="`vlafuzz doctor` says what to install"
        ) from None
    assert isinstance(made.unwrapped, TabletopEnv)
    gc.collect()
    gc.freeze()  # torch and ManiSkill stay for good: to look through them costs 5 % of a rollout
    return made.unwrapped
