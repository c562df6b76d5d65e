"""What a vla-eval server declares about its model, translated from and to our specs."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import BaseModel, Field

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, PolicySpec
from vlafuzz.policies.clients.conventions import LAYOUTS, OWN, layout_width
from vlafuzz.policies.clients.remote import SIDE, VlaEvalOptions, cameras_of

UNDECLARED = "raw"  # vla-eval's word for "no convention declared"
POSITION = "delta_xyz"
# vla-eval's euler_xyz is extrinsic, according to its rotation module; ours of that name is intrinsic.
ROTATIONS = {"axis_angle": "axis_angle", "euler_xyz": "rpy"}
GRIPPERS = {
    "binary_close_positive": "close_positive",
    "binary_close_negative": "open_positive",
    "binary_close_01": "close_01",
    "continuous_01": "open_01",
}
# vla-eval's own LIBERO: the names of its pictures by those of our cameras, and its proprioception.
LIBERO_PICTURES = {"front": "agentview", "wrist": "wrist"}
LIBERO_STATE = "eef_pos3_axisangle3_gripper2"
Name = Annotated[str, Field(max_length=1000)]  # stores keep them with every run


class Component(BaseModel, frozen=True):
    """A part of an action or observation."""

    format: Name = UNDECLARED


class Parameters(BaseModel, frozen=True):
    """What a server wants to be sent, besides what its specs say."""

    send_state: bool | None = None
    send_wrist_image: bool | None = None
    quat_no_antipodal: bool | None = None
    absolute_action: bool | None = None


class Hello(BaseModel, frozen=True, protected_namespaces=()):
    """The fields of a server's greeting that are used here."""

    protocol_version: int
    harness_version: Name = "unknown"
    model_server: Name = "unknown"
    action_spec: Mapping[str, Component] = {}
    observation_spec: Mapping[str, Component] = {}
    observation_params: Parameters = Parameters()


def spec_of(name: str, hello: Hello, options: VlaEvalOptions) -> PolicySpec:
    """The spec from the options, else from what the server declares, else from the defaults.

    Raises:
        UsageError: the server declares something unsupported, and no option overrides it.
    """
    _check_components(name, hello)
    rotation, rotation_from = _convention(name, hello, "rotation", ROTATIONS, options.rotation)
    gripper, gripper_from = _convention(name, hello, "gripper", GRIPPERS, options.gripper)
    state = layout_of(name, hello, options)
    conventions: dict[str, Any] = {"rotation": rotation, "gripper": gripper}
    provenance = {"server": hello.model_server, "rotation": rotation_from, "gripper": gripper_from}
    provenance |= {"state": state or "none"} | (options.provenance() if options.profile else {})
    return PolicySpec(
        name,
        version=options.version or hello.harness_version,
        action=ActionSpec(
            **{key: value for key, value in conventions.items() if value is not None},
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
        provenance=provenance,
    )


def picture_names(spec: PolicySpec, options: VlaEvalOptions) -> dict[str, str]:
    """The names under which pictures are sent, by those of the cameras, in their order."""
    known = LIBERO_PICTURES if options.benchmark == "libero" else {}
    return {camera.name: known.get(camera.name, camera.name) for camera in spec.cameras}


def wants_short_turns(hello: Hello, options: VlaEvalOptions) -> bool:
    """Whether rotation vectors are sent as vla-eval's LIBERO does unasked: no longer than half a turn."""
    return options.benchmark == "libero" and not hello.observation_params.quat_no_antipodal


def declared_actions(spec: ActionSpec) -> dict[str, dict[str, Any]]:
    """Our actions in vla-eval's terms, as far as there are any."""
    rotations = {name: declared for declared, name in ROTATIONS.items()}
    grippers = {name: declared for declared, name in GRIPPERS.items()}
    return {
        "position": {"name": "position", "dims": 3, "format": POSITION},
        "rotation": {"name": "rotation", "dims": 3, "format": rotations.get(spec.rotation, UNDECLARED)},
        "gripper": {"name": "gripper", "dims": 1, "format": grippers[spec.gripper]},
    }


def declared_observations(cameras: Sequence[CameraRequest], layout: str | None) -> dict[str, dict[str, Any]]:
    """Our observations in vla-eval's terms. ``layout``: of the proprioception, None for none."""
    parts = {camera.name: ("rgb_hwc_uint8", 0) for camera in cameras}
    if layout is not None:
        parts["state"] = (layout, layout_width(layout))
    parts["language"] = ("language", 0)
    return {name: {"name": name, "dims": dims, "format": kind} for name, (kind, dims) in parts.items()}


def layout_of(name: str, hello: Hello, options: VlaEvalOptions) -> str | None:
    """The layout in which proprioception is sent, None if it is not; UsageError for an unsupported one."""
    if options.state == "0":
        return None
    if options.state not in (None, "1"):
        return options.state
    if options.benchmark == "libero":
        return LIBERO_STATE if options.state or hello.observation_params.send_state else None
    declared = hello.observation_spec.get("state")
    if options.state is None and declared is None and not hello.observation_params.send_state:
        return None
    if declared is None or declared.format == UNDECLARED:
        return OWN
    if declared.format not in LAYOUTS:
        raise _unsupported(name, "state", declared.format, LAYOUTS)
    return declared.format


def _check_components(name: str, hello: Hello) -> None:
    if hello.observation_params.absolute_action:
        message = f"{name}: the server's actions are poses of the hand (absolute_action)"
        raise UsageError(message, hint="supported: moves of the hand (delta_xyz)")
    for component, declared in hello.action_spec.items():
        if component in ("rotation", "gripper"):
            continue  # an option may override it
        known = {"position": (UNDECLARED, POSITION), "actions": (UNDECLARED,)}
        if declared.format not in known.get(component, ()):
            message = f"{name}: the server's actions have {component} {declared.format!r}"
            raise UsageError(message, hint="supported: position (delta_xyz), rotation and gripper")


def _convention(
    name: str, hello: Hello, component: str, known: Mapping[str, str], option: str | None
) -> tuple[str | None, str]:
    """Our name of a convention, None for the default, and the source: option, server or default."""
    declared = hello.action_spec.get(component, Component()).format
    if option is not None:
        return option, "option"
    if declared == UNDECLARED:
        return None, "default"
    if declared not in known:
        raise _unsupported(name, component, declared, known)
    return known[declared], "server"


def _unsupported(name: str, component: str, declared: str, known: Mapping[str, Any]) -> UsageError:
    hint = f"supported: {', '.join(known)}; if it declares wrongly, the option {component}=… wins"
    return UsageError(f"{name}: the server declares {component} {declared!r}", hint)


def _cameras(name: str, hello: Hello, options: VlaEvalOptions) -> tuple[CameraRequest, ...]:
    """The third-person camera first, since servers identify pictures by their order."""
    pictures = [part for part in hello.observation_spec.values() if part.format == "rgb_hwc_uint8"]
    if len(pictures) > 2 and options.wrist is None:
        message = f"{name}: the server wants {len(pictures)} pictures"
        raise UsageError(message, hint="supported: one, and with wrist=1 a second one from the wrist")
    wrist = options.wrist
    if wrist is None:
        wrist = len(pictures) > 1 or bool(hello.observation_params.send_wrist_image)
    size = options.camera
    if size is None:
        size = (SIDE, SIDE) if pictures or wrist or not hello.observation_spec else (0, 0)
    return cameras_of(size, wrist=wrist)
