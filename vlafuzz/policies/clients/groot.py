"""Models behind GR00T's policy server."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator, BaseModel

from vlafuzz.common.arrays import Array
from vlafuzz.common.files import closed_on_error
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.clients.conventions import STATES
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.msgpack_wire import pack_groot, unpack
from vlafuzz.policies.clients.options import CommonOptions, ProfiledOptions
from vlafuzz.policies.clients.servers import Address, needed
from vlafuzz.policies.clients.wire import ZmqConnection
from vlafuzz.policies.harness import check_chunks


def parts_of(text: str) -> dict[str, int]:
    """Parse ``x,gripper:2`` to names and their numbers of values."""
    parts: dict[str, int] = {}
    for part in text.split(","):
        name, _, count = part.partition(":")
        if not name or name in parts or (count and not 0 < int(count) < 100):
            raise ValueError(f"expected names as x,y,gripper:2, each of them once, got {text!r}")
        parts[name] = int(count or 1)
    return parts


Parts = Annotated[str, AfterValidator(lambda text: parts_of(text) and text)]


class GrootOptions(ProfiledOptions):
    """The user's options for the model. The default keys are those of its published models.

    Attributes:
        state_key: the parts in which proprioception is sent, in the layout's order.
        action_key: the parts in which actions are received: position, rotation, gripper.
        flat: whether the server was started with --use-sim-policy-wrapper.
    """

    protocol: ClassVar[str] = "groot"

    state_key: Parts = "x,y,z,roll,pitch,yaw,gripper"
    action_key: Parts = "x,y,z,roll,pitch,yaw,gripper"
    instruction_key: str = "annotation.human.action.task_description"
    flat: bool = False

    def refusals(self) -> list[tuple[str, str]]:
        problems, layout = super().refusals(), self.layout
        total, expected = sum(parts_of(self.state_key).values()), len(STATES[layout]) if layout else 0
        if layout and total != expected:
            message = f"state_key: its parts have {total} numbers, {layout} has {expected}"
            problems.append((message, "such as state_key=x,y,z,roll,pitch,yaw,gripper:2"))
        return problems


class Modality(BaseModel, frozen=True):
    """One kind of input or output of a model. ``delta_indices``: its time steps, 0 for the current one."""

    delta_indices: tuple[int, ...]
    modality_keys: tuple[str, ...]


NONE = Modality(delta_indices=(0,), modality_keys=())


class Modalities(BaseModel, frozen=True):
    """A model's inputs and outputs, as its server declares them."""

    video: Modality = NONE
    state: Modality = NONE
    language: Modality = NONE
    action: Modality


class Groot:
    """A model behind GR00T's policy server, of N1.6 or N1.7; name a profile.

    The server keeps no state of rollouts, so all observations go into one request, which is repeated when the
    connection breaks.
    """

    form: ClassVar[str] = "groot:tcp://host:port"
    schemes: ClassVar[Sequence[str]] = ("tcp",)
    answers_batches: ClassVar[bool] = True
    options: ClassVar[type[CommonOptions]] = GrootOptions

    def __init__(self, address: Address) -> None:
        self._name, self._url, self._options = address.name, address.url, address.options
        self._connection: ZmqConnection | None = None
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        start_it = "start it first: python gr00t/eval/run_gr00t_server.py …"
        with needed(self._name, "msgpack", "zmq"), wire.required("GR00T", start_it):
            self._modalities = self._get_modalities()
        with closed_on_error(self):
            self._check_keys()

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Begin these rollouts, after checking that the server still has the same model."""
        if self._get_modalities() != self._modalities:
            raise wire.replaced(self._name)
        self._ask("reset", {"options": None})

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        if not observations:
            return []
        reply = self._ask("get_action", {"observation": self._message(observations), "options": None})
        if not isinstance(reply, list) or not reply or not isinstance(reply[0], dict):
            raise wire.failure(self._url, f"no actions, but {wire.short(reply)}", "protocol")
        with wire.read(self._name, "bad_action"):
            joined = self._joined(reply[0], len(observations))
            chunks = [ActionChunk(self._model.checked(actions)) for actions in joined]
        return check_chunks(chunks, len(observations), self._name)

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def _get_modalities(self) -> Modalities:
        declared = self._ask("get_modality_config")
        with closed_on_error(self), wire.read(f"{self._url}: its modality config"):
            return Modalities.model_validate(declared)

    def _keys(self) -> dict[str, tuple[str, ...]]:
        """The model's keys by modality, as the options name them."""
        options = self._options
        key_of = {"front": options.image_key, "wrist": options.wrist_key}
        return {
            "video": tuple(key_of[camera.name] for camera in self.spec.cameras),
            "state": tuple(parts_of(options.state_key)) if options.layout else (),
            "language": (options.instruction_key,),
            "action": tuple(parts_of(options.action_key)),
        }

    def _check_keys(self) -> None:
        """Raise a UsageError if the model wants other keys than the options name, or past steps."""
        prefixes = {"video": "image", "state": "state", "language": "instruction", "action": "action"}
        for kind, keys in self._keys().items():
            modality: Modality = getattr(self._modalities, kind)
            if set(keys) != set(modality.modality_keys):
                wanted, ours = ", ".join(modality.modality_keys) or "none", ", ".join(keys) or "none"
                message = f"{self._name}: the model's keys of {kind} are {wanted}, and the options name {ours}"
                raise UsageError(message, hint=f"a profile, or the option {prefixes[kind]}_key=…")
            if kind != "action" and len(modality.delta_indices) != 1:
                message = f"{self._name}: the model wants {len(modality.delta_indices)} time steps of {kind}"
                raise UsageError(message, hint="supported: one, the current step")

    def _message(self, observations: Sequence[Observation]) -> dict[str, Any]:
        """All observations by modality and key, with one time step each: (count, 1, …)."""
        messages, keys, options = list(map(self._model.message, observations)), self._keys(), self._options
        video = {key: np.stack([message[key] for message in messages])[:, None] for key in keys["video"]}
        state: dict[str, Any] = {}
        if options.layout:
            ends = np.cumsum([*parts_of(options.state_key).values()])[:-1]
            states = np.stack([message[options.state_key] for message in messages])[:, None]
            state = dict(zip(keys["state"], np.split(states, ends, axis=2), strict=True))
        texts = [message[options.instruction_key] for message in messages]
        if options.flat:
            flat = {f"state.{key}": part for key, part in state.items()}
            flat |= {f"video.{key}": pictures for key, pictures in video.items()}
            return flat | {options.instruction_key: texts}
        language = {options.instruction_key: [[text] for text in texts]}
        return {"state": state, "language": language, "video": video}

    def _joined(self, reply: Mapping[str, Any], count: int) -> Array:
        """The parts of the actions, joined to ``(count, steps, n)``."""
        parts = []
        for key, width in parts_of(self._options.action_key).items():
            part = reply.get(key, reply.get(f"action.{key}"))
            if not isinstance(part, np.ndarray) or part.dtype.kind not in "iuf":
                keys = wire.short(sorted(map(str, reply)))
                raise ValueError(f"a reply without the action {key!r}, but {keys}")
            if part.ndim != 3 or (len(part), part.shape[2]) != (count, width):
                problem = f"the action {key!r} has shape {part.shape}"
                raise ValueError(f"{problem}, expected ({count}, steps, {width})")
            parts.append(part.astype(np.float64))
        return np.concatenate(parts, axis=2)

    def _ask(self, endpoint: str, data: Mapping[str, Any] | None = None) -> Any:
        message = {"endpoint": endpoint} | ({} if data is None else {"data": data})
        reply = wire.with_retries(lambda: self._attempt(message))
        if isinstance(reply, dict) and "error" in reply:
            raise wire.failure(self._url, wire.short(reply["error"]), "remote")
        return reply

    def _attempt(self, message: object) -> Any:
        """One request; the connection is opened when there is none, and closed when it breaks."""
        with closed_on_error(self):
            if self._connection is None:
                self._connection = ZmqConnection(self._url, self._options.timeout)
            frame = self._connection.ask(pack_groot(message))
            with wire.read(f"{self._url}: not a GR00T message"):
                return unpack(frame)
