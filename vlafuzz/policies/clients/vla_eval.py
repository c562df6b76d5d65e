"""Models behind servers of vla-eval's protocol, and what such servers declare, from and to our specs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, cast

from pydantic import BaseModel, Field
from scipy.spatial.transform import Rotation

from vlafuzz import __version__
from vlafuzz.common.arrays import Array
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.conventions import LAYOUTS, MEASURED, OWN, sent
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.msgpack_wire import pack_vla_eval, unpack_vla_eval
from vlafuzz.policies.clients.options import SIDE, CommonOptions, ProfiledOptions, VlaEvalOptions
from vlafuzz.policies.clients.sessions import Session, Sessions
from vlafuzz.policies.clients.wire import WebSocketConnection

PROTOCOL_VERSION = 1
GREETING = {"harness_version": f"vlafuzz {__version__}", "protocol_version": PROTOCOL_VERSION}
UNDECLARED = "raw"  # vla-eval's word for "no convention declared"
POSITION, PICTURE = "delta_xyz", "rgb_hwc_uint8"
# vla-eval's euler_xyz is extrinsic, according to its rotation module; ours of that name is intrinsic.
ROTATIONS = {"axis_angle": "axis_angle", "euler_xyz": "rpy"}
GRIPPERS = {
    "binary_close_positive": "close_positive",
    "binary_close_negative": "open_positive",
    "binary_close_01": "close_01",
    "continuous_01": "open_01",
}
PICTURES = {"front": "agentview", "wrist": "wrist"}  # by our cameras, in vla-eval's own benchmark
Name = Annotated[str, Field(max_length=1000)]  # stores keep them with every run


class Component(BaseModel, frozen=True):
    """A part of an action or observation."""

    format: Name = UNDECLARED


class ObservationParameters(BaseModel, frozen=True):
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
    observation_params: ObservationParameters = ObservationParameters()


class DeclaredModel(Model):
    """A model by its options, else by what its server declares, else usual; a UsageError for what is unsupported."""

    def __init__(self, name: str, hello: Hello, options: VlaEvalOptions) -> None:
        if hello.observation_params.absolute_action:
            message = f"{name}: the server's actions are poses of the hand (absolute_action)"
            raise UsageError(message, hint="supported: moves of the hand (delta_xyz)")
        known_formats = {"position": (UNDECLARED, POSITION), "actions": (UNDECLARED,)}
        for component, declared in hello.action_spec.items():  # an option may override rotation and gripper
            if component not in ("rotation", "gripper") and declared.format not in known_formats.get(component, ()):
                message = f"{name}: the server's actions have {component} {declared.format!r}"
                raise UsageError(message, hint="supported: position (delta_xyz), rotation and gripper")
        rotation, rotation_from = _convention(name, hello, "rotation", ROTATIONS, options.rotation)
        gripper, gripper_from = _convention(name, hello, "gripper", GRIPPERS, options.gripper)
        pictures = [part for part in hello.observation_spec.values() if part.format == PICTURE]
        if len(pictures) > 2 and options.wrist is None:
            message = f"{name}: the server wants {len(pictures)} pictures"
            raise UsageError(message, hint="supported: one, and with wrist=1 a second one from the wrist")
        asked = hello.observation_params
        wrist = bool(len(pictures) > 1 or asked.send_wrist_image) if options.wrist is None else options.wrist
        plain = (SIDE, SIDE) if pictures or wrist or not hello.observation_spec else (0, 0)
        settled = {
            "version": options.version or hello.harness_version,
            "rotation": rotation or "axis_angle",
            "gripper": gripper,
            "state": _layout(name, hello, options) or "0",
            "camera": options.camera or plain,
            "wrist": wrist,
        }
        super().__init__(name, ProfiledOptions.model_construct(**(vars(options) | settled)))
        provenance = {"server": hello.model_server, "rotation": rotation_from, "gripper": gripper_from}
        provenance |= {"state": self.layout or "none"} | (options.provenance() if options.profile else {})
        self.spec = replace(self.spec, provenance=provenance)
        known = PICTURES if options.benchmark else {}
        self._names = {camera.name: known.get(camera.name, camera.name) for camera in self.spec.cameras}
        # Rotation vectors as that benchmark sends them unasked: no longer than half a turn.
        self._short = bool(options.benchmark) and not asked.quat_no_antipodal

    def message(self, seen: Observation) -> dict[str, Any]:
        """An observation as vla-eval sends it: servers identify pictures by their order or by their names."""
        message: dict[str, Any] = {
            "images": {name: seen.images[camera] for camera, name in self._names.items()},
            "task_description": seen.instruction,
        }
        if self.layout is not None and seen.state is not None:
            state = sent(self.layout, seen)
            if self._short:
                state[3:6] = Rotation.from_rotvec(state[3:6]).as_rotvec()
            message |= {"state": state, "states": state}  # servers read either of the two
        return message


def declared_actions(spec: ActionSpec) -> dict[str, dict[str, Any]]:
    """Our actions in vla-eval's terms, as far as there are any."""
    rotations = {name: declared for declared, name in ROTATIONS.items()}
    grippers = {name: declared for declared, name in GRIPPERS.items()}
    return {
        "position": {"name": "position", "dims": 3, "format": POSITION},
        "rotation": {"name": "rotation", "dims": 3, "format": rotations.get(spec.rotation, UNDECLARED)},
        "gripper": {"name": "gripper", "dims": 1, "format": grippers[spec.gripper]},
    }


def _layout(name: str, hello: Hello, options: VlaEvalOptions) -> str | None:
    """The layout in which proprioception is sent, None if it is not; UsageError for an unsupported one."""
    asked = options.state == "1" or (options.state is None and hello.observation_params.send_state)
    declared = hello.observation_spec.get("state")
    if options.state not in (None, "0", "1"):
        return options.state
    if options.benchmark and options.state != "0":
        return MEASURED if asked else None
    if options.state == "0" or not (asked or declared):
        return None
    if declared is None or declared.format == UNDECLARED:
        return OWN
    if declared.format not in LAYOUTS:
        raise _unsupported(name, "state", declared.format, LAYOUTS)
    return declared.format


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


class VlaEval(Sessions):
    """A model behind a vla-eval server; options follow a question mark: ?camera=256&wrist=1.

    Every live rollout has its own connection, since servers keep action chunks per connection; without it, the rollout
    cannot continue. The policy is not ``shared``: the server itself batches the observations of several connections,
    and workers that connect directly save a hop.
    """

    form: ClassVar[str] = "vla-eval:ws://host:port"
    schemes: ClassVar[Sequence[str]] = ("ws", "wss")
    answers_batches: ClassVar[bool] = True
    options: ClassVar[type[CommonOptions]] = VlaEvalOptions
    server, start_it, packages = "vla-eval", "vla-eval serve --config …", ("msgpack", "websockets")
    connection = WebSocketConnection

    def _greet(self, session: Session) -> Hello:
        self._say(session, "hello", GREETING)
        greeting = self._reply(session, "hello")
        with wire.read(f"{self._url}: its hello"):
            hello = Hello.model_validate(greeting)
        if hello.protocol_version != PROTOCOL_VERSION:
            version = f"version {hello.protocol_version} of the protocol, not {PROTOCOL_VERSION}"
            hint = "install a vla-eval there that speaks it, such as 0.8.0"
            raise wire.failure(self._url, f"it speaks {version}", "protocol", hint)
        return hello

    def _described(self, first: Session) -> DeclaredModel:
        return DeclaredModel(self._name, first.greeting, self._options)

    def _begin(self, session: Session) -> None:
        if self._described(session).spec != self.spec:
            raise wire.replaced(self._name)
        start = cast(EpisodeStart, session.start)
        suite, _, number = start.task.rpartition("/")  # some servers have settings for each suite
        place = {"suite": suite, "task_id": int(number)} if suite else {"suite": "vlafuzz"}
        task = {"name": start.instruction, "task": start.task, **place}
        self._say(session, "episode_start", {"task": task | {"episode": start.episode, "seed": start.seed}})

    def _send(self, session: Session, seen: Observation) -> None:
        self._say(session, "observation", self._model.message(seen))

    def _receive(self, session: Session, seen: Observation, wait: float) -> Array:
        return wire.actions_of(self._reply(session, "action", wait))

    def _end(self, session: Session) -> None:
        """Send no metrics, since we judge the rollout ourselves."""
        self._say(session, "episode_end", {"metrics": {}})

    def _say(self, session: Session, kind: str, payload: Mapping[str, Any]) -> None:
        """Send a message with its number, which the reply must repeat."""
        session.sent += 1
        session.connection.send(pack_vla_eval(kind, payload, session.sent))

    def _reply(self, session: Session, kind: str, wait: float | None = None) -> Mapping[str, Any]:
        """The reply to the last message; PolicyError when it is late, an error, or another message."""
        frame = session.connection.receive(wait)
        with wire.read(f"{self._url}: not a vla-eval message"):
            received, payload, echoed = unpack_vla_eval(frame)
        if received == "error":
            raise wire.failure(self._url, wire.short(payload.get("error")), "remote")
        if (received, echoed) != (kind, session.sent):
            problem = f"expected the message {kind!r} with number {session.sent}, got {received!r} with {echoed!r}"
            raise wire.failure(self._url, problem, "protocol")
        return payload
