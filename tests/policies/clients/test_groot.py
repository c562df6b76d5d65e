"""The client of GR00T's policy server: golden frames, conversations and errors."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from tests.policies.clients.groot_server import MODALITIES, NAMES, TASK, config, nd, npy, parts, served
from tests.policies.clients.served import STATE, black, check_failure, failure as served_failure, seen, start
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError
from vlafuzz.policies.base import Observation
from vlafuzz.policies.clients.msgpack_wire import pack_groot, unpack
from vlafuzz.rollouts.policies import make_policy

GOLDEN = Path(__file__).parent / "golden"  # by msgpack-numpy 0.4.8: scripts/make_frames.py
STILL = np.array([[0.0] * 6 + [1.0]], dtype=np.float32)
pytestmark = pytest.mark.usefixtures("no_pause")


def looking(*episodes: str, side: int = 32) -> list[Observation]:
    return [seen(name, images={"front": np.full((side, side, 3), 7, np.uint8)}) for name in episodes]


def file(descr: str, shape: str, data: bytes) -> bytes:
    """An .npy file, by hand: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html."""
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    npy = b"\x93NUMPY\x01\x00" + b"v\x00" + header.encode() + data
    return b"\x82\xb1__ndarray_class__\xc3\xa6as_npy\xc4" + bytes([len(npy)]) + npy


class TestFrames:
    """Against bytes written by hand, and against those of msgpack-numpy."""

    def test_a_request(self):
        picture = np.arange(18, dtype=np.uint8).reshape(1, 1, 2, 3, 3)
        observation = {
            "video": {"image": picture},
            "state": {"x": np.array([[[0.5]]], dtype=np.float32)},
            "language": {"task": [["up"]]},
        }
        data = {"observation": observation, "options": None}
        assert pack_groot({"endpoint": "get_action", "data": data}) == (
            b"\x82\xa8endpoint\xaaget_action\xa4data\x82\xabobservation\x83"
            b"\xa5video\x81\xa5image"
            + file("|u1", "(1, 1, 2, 3, 3)", bytes(range(18)))
            + b"\xa5state\x81\xa1x"
            + file("<f4", "(1, 1, 1)", b"\x00\x00\x00\x3f")
            + b"\xa8language\x81\xa4task\x91\x91\xa2up\xa7options\xc0"
        )

    def test_a_reply_of_n16(self):
        moves = b"\x00\x00\x80\x3f\x00\x00\x00\x40"
        reply, info = unpack(b"\x92\x81\xa1x" + file("<f4", "(1, 2, 1)", moves) + b"\x80")
        assert (reply["x"].tolist(), reply["x"].dtype, info) == ([[[1.0], [2.0]]], np.float32, {})

    def test_a_reply_of_n17(self):
        reply, info = unpack((GOLDEN / "groot_reply.msgpack").read_bytes())
        assert np.array_equal(reply["x"], np.linspace(-1, 1, 14).reshape(1, 2, 7).astype(np.float32))
        assert info == {"milliseconds": 1.5}

    @pytest.mark.parametrize("mark", [b"\xb8__ModalityConfig_class__", b"\xb2__ModalityConfig__"])
    @pytest.mark.parametrize("under", [b"\xa7as_json", b"\xa7as_dict"])
    def test_a_models_keys(self, mark, under):
        plain = b"\x82\xaddelta_indices\x91\x00\xadmodality_keys\x91\xa5image"
        read = unpack(b"\x81\xa5video\x82" + mark + b"\xc3" + under + plain)
        assert read == {"video": {"delta_indices": [0], "modality_keys": ["image"]}}

    def test_an_array_by_columns(self):
        columns = np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3))
        assert unpack(msgpack.packb(npy(columns))).tolist() == columns.tolist()


def conversed(reply: dict, query: str, *observations: Observation, **keys: list[str]) -> tuple[list, dict[str, Any]]:
    """The actions in a reply, and the only request; ``keys``: of the model, where they are others."""
    with served([reply, {}], modalities=config(MODALITIES | keys)) as (name, requests):
        policy = make_policy(name + query)
        policy.reset([start(each.episode) for each in observations])
        shown = [replace(each, images=each.images or black(policy.spec)) for each in observations]
        chunks = policy.act(shown)
        policy.close()
    (request,) = requests
    return [chunk.actions.tolist() for chunk in chunks], request["data"]


def unpacked(part: Any) -> Any:
    return unpack(msgpack.packb(part))


class TestConversation:
    def test_an_observation_has_the_models_keys(self):
        video = ["image", "wrist_image"]
        query = "?profile=libero&camera=48x32"
        _, data = conversed(parts(STILL[None]), query, seen("one"), video=video, state=[*NAMES])
        observation = data["observation"]
        state = {key: unpacked(part) for key, part in observation["state"].items()}
        assert [*observation["video"]] == video
        assert unpacked(observation["video"]["image"]).shape == (1, 1, 32, 48, 3)
        assert [part.shape for part in state.values()] == [(1, 1, 1)] * 6 + [(1, 1, 2)]
        assert {part.dtype.str for part in state.values()} == {"<f4"}
        assert state["yaw"][0, 0, 0] == STATE[5]
        assert observation["language"] == {TASK: [["pick up apple"]]}
        assert data["options"] is None

    @pytest.mark.parametrize(("write", "prefix"), [(npy, ""), (nd, ""), (npy, "action.")])
    def test_all_observations_go_in_one_request(self, write, prefix):
        moves = np.arange(2 * 16 * 7, dtype=np.float32).reshape(2, 16, 7)
        chunks, _ = conversed(parts(moves, write, prefix), "?camera=32", *looking("a", "b"))
        assert chunks == moves.tolist()

    def test_the_wrapper_for_simulators_wants_flat_keys(self):
        reply = parts(STILL[None], prefix="action.")
        _, data = conversed(reply, "?camera=32&flat=1", *looking("one"))
        assert [*data["observation"]] == ["video.image", TASK]
        assert data["observation"][TASK] == ["pick up apple"]

    def test_a_widowx_hand_that_points_down_has_no_angles(self):
        down = np.array([0.1, 0.2, 0.3, np.pi, 0, 0, 0.5], dtype=np.float32)
        reply, state = parts(np.repeat(STILL[None], 8, axis=1)), [*NAMES[:6], "pad", "gripper"]
        observation = Observation("one", 0, "up", state=down)
        _, data = conversed(reply, "?profile=bridge", observation, video=["image_0"], state=state)
        numbers = [float(unpacked(part)[0, 0, 0]) for part in data["observation"]["state"].values()]
        assert numbers == pytest.approx([0.1, 0.2, 0.3, 0, 0, 0, 0, 0.5], abs=1e-6)


def failure(*replies: Any, options: str = "?camera=32") -> PolicyError:
    with served(*replies) as (name, _):
        return served_failure(name + options, images=looking("one")[0].images)


def forged(descr: str, data: bytes, shape: list[int] = [1, 1, 1]) -> list:  # noqa: B006
    return [{"x": {b"nd": True, b"type": descr, b"kind": b"", b"shape": shape, b"data": data}}, {}]


class TestWrongAnswers:
    @pytest.mark.parametrize(
        ("reply", "cause", "says"),
        [
            ({"error": "Error:\n no memory"}, "remote", ": Error: no memory$"),
            (b"ERROR", "protocol", "not a GR00T message: 5 bytes"),
            (b"\xc1", "protocol", "not a GR00T message: 1 bytes"),
            (b"", "protocol", "not a GR00T message: 0 bytes"),
            (3, "protocol", "no actions, but 3"),
            ([], "protocol", r"no actions, but \[\]"),
            ([{}, {}], "bad_action", "a reply without the action 'x', but"),
            ([{"x": [1.0]}, {}], "bad_action", r"a reply without the action 'x', but \['x'\]"),
            ([parts(np.zeros((2, 4, 7))), {}], "bad_action", r"\(2, 4, 1\), expected"),
            ([parts(np.zeros((1, 0, 7))), {}], "bad_action", r"actions of shape \(0, 7\)"),
            ([parts(STILL[None]) | {"y": npy(np.zeros((1, 3, 1)))}, {}], "bad_action", "dimensions"),
            (forged("<f4", bytes(5)), "protocol", "buffer"),
            (forged("<f4", bytes(4), [1 << 40]), "protocol", "reshape"),
            ([{"x": {"__ndarray_class__": True, "as_npy": b"PK"}}, {}], "protocol", "magic"),
            ([{"x": npy(np.zeros(3))["as_npy"]}, {}], "bad_action", "without the action 'x'"),
            ([parts(STILL[None]), bytes(5 << 20)], "connect", "more than 4 MiB"),
        ],
    )  # fmt: skip
    def test_are_errors_with_their_cause(self, reply, cause, says):
        check_failure(failure(*[reply] * 3), cause, says)

    def test_an_array_that_claims_to_be_huge_takes_no_memory(self):
        claims = npy(np.zeros((1, 1, 1)))
        claims["as_npy"] = claims["as_npy"].replace(b"(1, 1, 1)", b"(9**9,1,)")
        assert failure([{"x": claims}, {}]).cause == "protocol"

    def test_a_slow_server_runs_out_of_time(self):
        error = failure(None, options="?camera=32&timeout=0.2")
        assert (error.cause, error.message.split(": ")[-1]) == ("timeout", "no reply within 0.2 s")

    def test_a_server_that_is_killed_and_there_again_is_asked_again(self, caplog):
        with served() as (name, _):
            policy = make_policy(f"{name}?camera=32")
            policy.reset([start("one")])
        with served([parts(STILL[None]), {}], port=int(name.rpartition(":")[2])):
            assert policy.act(looking("one"))[0].actions.tolist() == STILL.tolist()
            policy.close()
        assert len(caplog.records) == 1
        assert "the connection broke" in caplog.text

    def test_another_server_in_its_place_is_noticed(self):
        with served() as (name, _):
            policy = make_policy(f"{name}?camera=32")
        with served(modalities=config(MODALITIES | {"video": ["other"]}), port=int(name.rpartition(":")[2])):
            with pytest.raises(PolicyError, match="another server answers") as caught:
                policy.reset([start("one")])
            policy.close()
        assert caught.value.cause == "protocol"


class TestRefused:
    """Errors before the first rollout."""

    @pytest.mark.parametrize(
        ("keys", "says"),
        [
            ({"video": ["ego_view"]}, "keys of video are ego_view, and the options name image"),
            ({"state": ["joints"]}, "keys of state are joints, and the options name none"),
            ({"language": ["task"]}, f"keys of language are task, and the options name {TASK}"),
            ({"action": ["joints"]}, "keys of action are joints, and the options name x, y"),
        ],
    )
    def test_a_model_whose_keys_nobody_names(self, keys, says):
        model = served(modalities=config(MODALITIES | keys))
        with model as (name, _), pytest.raises(UsageError, match=says) as caught:
            make_policy(name)
        assert caught.value.hint.startswith("a profile, or the option ")

    def test_a_model_that_wants_the_past(self):
        modalities = config(MODALITIES)
        modalities["video"]["as_json"]["delta_indices"] = [-1, 0]
        with served(modalities=modalities) as (name, _), pytest.raises(UsageError, match="wants 2 time steps of video"):
            make_policy(name)

    @pytest.mark.parametrize("modalities", [{}, {"action": 3}, {"action": {"delta_indices": [0]}}, [1]])
    def test_a_server_of_something_else(self, modalities):
        server = served(modalities=modalities)
        with server as (name, _), pytest.raises(PrerequisiteError, match="its modality config: "):
            make_policy(name)
