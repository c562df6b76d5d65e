"""The contract of every policy."""

import numpy as np
import pytest

from tests.worlds.tabletop.sim.scenes import evaluate, nominal, pick_up, put
from vlafuzz.errors import UsageError
from vlafuzz.model import Scene, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.clients.servers import SERVERS, client
from vlafuzz.policies.harness import check_chunks
from vlafuzz.policies.serving import serving
from vlafuzz.rollouts.policies import CONTROLS, built_in, known_policies, make_policy
from vlafuzz.worlds import world_of
from vlafuzz.worlds.tabletop.evaluator import outlines
from vlafuzz.worlds.tabletop.experts.expert import Calibration, Privileged
from vlafuzz.worlds.tabletop.sim.world import SIM_HZ
from vlafuzz.worlds.tabletop.tasks import task

SHOWN = [
    pick_up(put("coke_can", -0.05, 0.1)),
    pick_up(put("green_cube", 0.05, -0.15, 30.0), put("orange", -0.1, 0.15)),
    nominal("put-in"),
]
STATE = np.array([0, 0, 0.17, np.pi, 0, 0, 1], dtype=np.float32)
POLICIES = (*world_of("pick-up").policies, *CONTROLS)
REMOTE = "random behind vla-eval"
SERVED = "random behind our own server"


@pytest.fixture(scope="module")
def own_server() -> str:
    """The name of a policy behind our own server."""
    with serving(make_policy("random")) as name:
        yield name


@pytest.fixture(scope="module")
def server() -> str:
    """The name of a policy behind the real vla-eval server."""
    from tests.policies.clients import served
    from tests.policies.clients.served import Rounded

    with served.serving(Rounded(make_policy("random")), max_batch_size=3) as name:
        yield name


@pytest.fixture
def name(request: pytest.FixtureRequest) -> str:
    """The name as given on the command line."""
    param = request.param
    if param is SERVED:
        return request.getfixturevalue("own_server")
    return f"{request.getfixturevalue('server')}?deterministic=1" if param is REMOTE else param


@pytest.fixture
def policy(name: str) -> Policy:
    policy = make_policy(name)
    yield policy
    policy.close()


@pytest.fixture(scope="module")
def observe(env):
    """``observe(spec, scene, episode)``: the observation that the spec asks for, at a scene's start."""

    def observation(spec: PolicySpec, scene: Scene, episode: str) -> Observation:
        state = env.begin(scene)
        return Observation(
            episode,
            0,
            scene.instruction,
            images={camera.name: np.zeros((camera.height, camera.width, 3), np.uint8) for camera in spec.cameras},
            state=STATE if spec.state else None,
            outlines=outlines(env.models, state, env.view, 1.0) if spec.silhouettes else None,
            privileged=Privileged(scene, env.models, state) if spec.privileged else None,
            calibration=Calibration(env.view, 1.0, env.models[: task(scene.task).targets]) if spec.calibrated else None,
        )

    return observation


def begin(policy: Policy, observe, *seeds: int) -> list[Observation]:
    """The first observations of as many rollouts, each in its own scene."""
    shown = [(f"episode-{number}", SHOWN[number], seed) for number, seed in enumerate(seeds)]
    policy.reset([EpisodeStart(name, scene.instruction, scene.task, seed) for name, scene, seed in shown])
    return [observe(policy.spec, scene, name) for name, scene, _ in shown]


def actions(policy: Policy, observations: list[Observation]) -> list[list]:
    return [chunk.actions.tolist() for chunk in policy.act(observations)]


@pytest.mark.parametrize("name", [*POLICIES, REMOTE, SERVED], indirect=True)
class TestPolicy:
    def test_its_spec_says_who_it_is_and_fits_the_simulator(self, policy: Policy, name: str):
        spec = policy.spec
        assert (spec.name, bool(spec.version)) == (name.partition("?")[0], True)
        assert SIM_HZ % spec.action.hz == 0
        assert spec.max_batch >= 1
        assert spec.execute is None or spec.execute >= 1

    def test_every_observation_is_answered_with_a_chunk_of_finite_actions(self, policy: Policy, observe):
        observations = begin(policy, observe, 0, 1, 2)
        assert len(check_chunks(policy.act(observations), 3, policy.spec.name)) == 3

    def test_any_subset_of_the_live_episodes_may_be_asked_in_any_order(self, policy: Policy, observe):
        first, second, third = begin(policy, observe, 0, 1, 2)
        for batch in ([third], [second, first], [], [first], [third, second, first]):
            check_chunks(policy.act(batch), len(batch), policy.spec.name)

    def test_a_batch_is_answered_as_one_by_one(self, name: str, observe):
        together, alone = make_policy(name), make_policy(name)
        batch = actions(together, begin(together, observe, 4, 5, 6))
        singles = [actions(alone, [observation])[0] for observation in begin(alone, observe, 4, 5, 6)]
        assert batch == singles
        together.close()
        alone.close()

    def test_the_same_seed_gives_the_same_actions_in_a_used_policy(self, policy: Policy, observe):
        assert policy.spec.deterministic
        observations = begin(policy, observe, 7)
        first = [actions(policy, observations) for _ in range(3)]
        begin(policy, observe, 1, 2, 3)
        observations = begin(policy, observe, 7)
        assert [actions(policy, observations) for _ in range(3)] == first

    def test_it_may_be_closed_twice(self, policy: Policy):
        policy.close()

    def test_its_rollout_repeats_itself(self, policy: Policy):
        outcomes = evaluate(policy, SHOWN[0], SHOWN[1], SHOWN[0])
        assert {outcome.verdict for outcome in outcomes} <= {Verdict.PASSED, Verdict.FAILED}
        assert outcomes[0].rollouts[0].states_hash == outcomes[2].rollouts[0].states_hash
        assert outcomes[0].rollouts[0].states_hash != outcomes[1].rollouts[0].states_hash


def test_every_policy_is_listed_with_a_sentence():
    listed = known_policies()
    assert list(listed) == [*built_in(), *(client(protocol).form for protocol in SERVERS)]
    assert all(listed.values())


def test_random_rollouts_differ_by_their_seed_alone(observe):
    random = make_policy("random")
    first, second = (actions(random, begin(random, observe, seed)) for seed in (0, 1))
    assert first != second


def test_a_policy_of_ones_own_is_named_by_module_and_factory():
    assert make_policy("python:tests.doubles:Idle").spec.name == "idle"


def test_what_has_no_spec_is_no_policy():
    with pytest.raises(UsageError, match="made a TinySpace, which has no spec"):
        make_policy("python:tests.doubles:TinySpace")


def test_only_the_experts_are_told_the_simulators_state_or_the_true_camera_and_light():
    specs = {name: make_policy(name).spec for name in POLICIES}
    assert [name for name in specs if specs[name].privileged] == ["expert"]
    assert [name for name in specs if specs[name].calibrated] == ["seeing"]
