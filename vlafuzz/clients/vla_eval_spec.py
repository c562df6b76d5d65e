"""What a vla-eval server declares about its model, and what that is in our words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict

from vlafuzz.clients.layouts import LAYOUTS, OWN, width
from vlafuzz.clients.remote import SIDE, Options
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, PolicySpec

UNSAID = "raw"  # vla-eval's word for "no convention declared"
POSITIONS = {"delta_xyz": "delta_xyz"}
# Its Euler angles turn about fixed axes, as its rotation module says; ours of that name about moving ones.
ROTATIONS = {"axis_angle": "axis_angle", "euler_xyz": "rpy"}
GRIPPERS = {
    "binary_close_positive": "close_positive",
    "binary_close_negative": "open_positive",
    "binary_close_01": "close_01",
    "continuous_01": "open_01",
}


class Component(BaseModel):
    """A part of an action or observation."""

    model_config = ConfigDict(frozen=True)

    format: str = UNSAID


class Hello(BaseModel):
    """A server's greeting, as far as it matters here."""

    model_config = ConfigDict(frozen=True, protected_namespaces=())

    protocol_version: int
    harness_version: str = "unknown"
    model_server: str = "unknown"
    action_spec: Mapping[str, Component] = {}
    observation_spec: Mapping[str, Component] = {}
    observation_params: Mapping[str, Any] = {}


def spec_of(name: str, hello: Hello, options: Options) -> PolicySpec:
    """What the options say, else what the server declares, else the defaults.

    Raises:
        UsageError: it declares what is not supported, and no option says otherwise.
    """
    _check_components(name, hello)
    rotation, rotation_from = _meaning(name, hello, "rotation", ROTATIONS, options.rotation)
    gripper, gripper_from = _meaning(name, hello, "gripper", GRIPPERS, options.gripper)
    state = layout_of(name, hello, options)
    spoken: dict[str, Any] = {"rotation": rotation, "gripper": gripper}
    return PolicySpec(
        name,
        version=hello.harness_version,
        action=ActionSpec(
            **{key: value for key, value in spoken.items() if value is not None},
            relative_to=options.relative_to,
            position_scale=options.position_scale,
            rotation_scale=options.rotation_scale,
            sticky=options.sticky,
            hz=options.hz,
        ),
        cameras=_cameras(name, hello, options),
        state=state is not None,
        execute=options.execute,
        deterministic=options.deterministic,
        max_batch=options.batch,
        provenance={
            "server": hello.model_server,
            "rotation": rotation_from,
            "gripper": gripper_from,
            "state": state or "none",
        }
        | ({"profile": options.profile} if options.profile else {}),
    )


def declared_actions(spec: ActionSpec) -> dict[str, dict[str, Any]]:
    """Actions, as far as vla-eval has words for them."""
    rotations = {ours: theirs for theirs, ours in ROTATIONS.items()}
    grippers = {ours: theirs for theirs, ours in GRIPPERS.items()}
    turned = rotations.get(spec.rotation, UNSAID)
    return {
        "position": {"name": "position", "dims": 3, "format": "delta_xyz"},
        "rotation": {"name": "rotation", "dims": 3, "format": turned},
        "gripper": {"name": "gripper", "dims": 1, "format": grippers[spec.gripper]},
    }


def declared_observations(cameras: Sequence[CameraRequest], layout: str | None) -> dict[str, dict[str, Any]]:
    """Observations in vla-eval's words. ``layout`` of proprioception; None where there is none."""
    seen = {camera.name: ("rgb_hwc_uint8", 0) for camera in cameras}
    if layout is not None:
        seen["state"] = (layout, width(layout))
    seen["language"] = ("language", 0)
    return {name: {"name": name, "dims": dims, "format": kind} for name, (kind, dims) in seen.items()}


def layout_of(name: str, hello: Hello, options: Options) -> str | None:
    """In which layout proprioception is sent; None for not at all.

    Raises:
        UsageError: the server declares one that is not supported.
    """
    if options.state == "0":
        return None
    if options.state not in (None, "1"):
        return options.state
    declared = hello.observation_spec.get("state")
    if options.state is None and declared is None and not hello.observation_params.get("send_state"):
        return None
    if declared is None or declared.format == UNSAID:
        return OWN
    if declared.format not in LAYOUTS:
        raise _unsupported(name, "state", declared.format, LAYOUTS, "state")
    return declared.format


def _check_components(name: str, hello: Hello) -> None:
    for component, declared in hello.action_spec.items():
        if component in ("rotation", "gripper"):
            continue  # an option may say otherwise
        if declared.format == UNSAID and component in ("actions", "position"):
            continue
        if component != "position" or declared.format not in POSITIONS:
            known = "position (delta_xyz), rotation and gripper"
            raise UsageError(
                f"{name}: the server's actions have {component} {declared.format!r}",
                hint=f"supported: {known}",
            )


def _meaning(
    name: str, hello: Hello, component: str, known: Mapping[str, str], asked: str | None
) -> tuple[str | None, str]:
    """Our word for a convention, None for the default; and who says so."""
    declared = hello.action_spec.get(component, Component()).format
    if asked is not None:
        return asked, "option"
    if declared == UNSAID:
        return None, "default"
    if declared not in known:
        raise _unsupported(name, component, declared, known, component)
    return known[declared], "server"


def _unsupported(
    name: str, component: str, declared: str, known: Mapping[str, Any], option: str
) -> UsageError:
    return UsageError(
        f"{name}: the server declares {component} {declared!r}",
        hint=f"supported: {', '.join(known)}; if it declares wrongly, the option {option}=… wins",
    )


def _cameras(name: str, hello: Hello, options: Options) -> tuple[CameraRequest, ...]:
    """The third-person camera first: servers tell pictures apart by their order."""
    pictures = [part for part in hello.observation_spec.values() if part.format == "rgb_hwc_uint8"]
    if len(pictures) > 2 and options.wrist is None:
        raise UsageError(
            f"{name}: the server wants {len(pictures)} pictures",
            hint="supported: one, and with wrist=1 a second one from the wrist",
        )
    wrist = options.wrist
    if wrist is None:
        wrist = len(pictures) > 1 or bool(hello.observation_params.get("send_wrist_image"))
    size = options.camera
    if size is None:
        size = (SIDE, SIDE) if pictures or wrist or not hello.observation_spec else (0, 0)
    cameras = [CameraRequest("front", *size)] if size != (0, 0) else []
    if wrist:
        cameras.append(CameraRequest("wrist", *(size if cameras else (SIDE, SIDE)), role="wrist"))
    return tuple(cameras)
