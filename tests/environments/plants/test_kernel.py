"""Law 5 for plants: kernel, Gymnasium environment and plain Python step alike, from the same starts."""

import re
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from plants_for_tests import CART, KINDS, MOTOR, ROOT, in_plain_python, write_plants

from ge_torchrl.environments.choose import agrees_with_gymnasium, open_backend
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernel_choice import dynamics_of
from ge_torchrl.environments.kernels.dynamics import advance
from ge_torchrl.environments.kernels.lanes import ACTION, LANE_ROWS, LANES, OBSERVATION, REWARD, TERMINATED
from ge_torchrl.environments.mirroring import check_mirror
from ge_torchrl.environments.plants.environment import register_plant
from ge_torchrl.environments.plants.kernel import plant_kernel
from ge_torchrl.environments.plants.plant import read_plant
from ge_torchrl.environments.plants.source import state_rows
from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree


@pytest.fixture(scope="module")
def plants(tmp_path_factory):
    """The file of all kinds, named as one that lies in the current folder."""
    return write_plants(tmp_path_factory.mktemp("plants"))


def described(plants, name):
    return describe(f"{plants}:{name}")


def some_action(spec, rng):
    if spec.is_continuous:
        return np.clip(
            rng.uniform(2 * spec.action_low - 1, 2 * spec.action_high + 1), spec.action_low, spec.action_high
        )
    return np.array([rng.integers(spec.n_actions)])


def as_the_author_has_it(spec, action):
    actions = read_plant(spec.id).actions
    if not spec.is_continuous:
        return actions.values[int(action[0])] if actions.values else int(action[0])
    entries = tuple(action.astype(np.float32).tolist())
    return entries if len(entries) > 1 else entries[0]


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**40), n=st.integers(1, 19))
def test_kernel_environment_and_plain_python_step_alike(plants, name, seed, n):
    spec, rng = described(plants, name), np.random.default_rng(seed)
    dynamics, rows = dynamics_of(spec), state_rows(read_plant(spec.id))
    starts = dynamics.starts(np.arange(seed, seed + n))
    lanes = np.zeros((LANE_ROWS, LANES))
    lanes[: starts.shape[1], :n] = starts.T
    watched = int(rng.integers(n))
    first = OBSERVATION // LANES
    with closing(make_gymnasium(spec)) as environment:
        observation, _ = environment.reset(seed=seed + watched)
        expected = np.random.default_rng(seed + watched).random(len(rows))
        low, high = np.array(read_plant(spec.id).start).T
        np.testing.assert_array_equal(lanes[rows, watched], low + (high - low) * expected)
        for _ in range(30):
            np.testing.assert_array_equal(lanes[first : first + spec.n_features, watched], observation)
            before = tuple(lanes[rows, watched].tolist())
            actions = np.array([some_action(spec, rng) for _ in range(n)], np.float32)
            lanes[ACTION // LANES : ACTION // LANES + actions.shape[1], :n] = actions.T
            advance(dynamics.index, lanes.reshape(-1), n)
            taken = actions[watched]
            observation, reward, terminated, _, _ = environment.step(
                taken if spec.is_continuous else int(taken[0])
            )
            outcome = lanes[REWARD // LANES, watched], lanes[TERMINATED // LANES, watched]
            assert outcome == (reward, terminated)
            np.testing.assert_array_equal(environment.unwrapped.state, lanes[rows, watched])
            after, paid, ended = in_plain_python(plants, name, before, as_the_author_has_it(spec, taken))
            np.testing.assert_allclose(lanes[rows, watched], after, rtol=1e-12, atol=1e-12)
            assert (reward, terminated) == (pytest.approx(paid, rel=1e-12, abs=1e-12), ended)
            if terminated:
                break


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_tree_returns_the_same_on_both_routes(plants, name, threads):
    spec = described(plants, name)
    assert agrees_with_gymnasium(spec)
    leaves = (
        [DecisionTree.value_leaf([v] * spec.n_actions, {0: [0.5] * spec.n_actions}) for v in (-0.5, 0.5)]
        if spec.is_continuous
        else [DecisionTree.leaf(0), DecisionTree.leaf(spec.n_actions - 1)]
    )
    tree = DecisionTree.split(0, 0.1, *leaves)
    forest = Forest.stack([tree, leaves[1], DecisionTree.split(1, -0.1, *leaves)])
    seeds = np.arange(40)
    with closing(open_backend(spec, threads=threads)) as kernel, closing(GymnasiumBackend(spec, 1)) as other:
        assert kernel.name == "kernel"
        ours, theirs = kernel.evaluate(forest, seeds, "test"), other.evaluate(forest, seeds, "test")
        one, two = kernel.record(tree, 3), other.record(tree, 3)
    np.testing.assert_array_equal(ours.lengths, theirs.lengths)
    np.testing.assert_allclose(ours.returns, theirs.returns, rtol=1e-12)
    np.testing.assert_array_equal(one.observations, two.observations)
    np.testing.assert_array_equal(one.rewards, two.rewards)


def test_a_plant_says_its_names_and_its_limit(plants):
    spec = described(plants, "Box")
    assert spec.names.features == ("sine", "speed", "both")
    assert spec.names.units == ("", "m/s", "")
    assert spec.names.actions == ("force",)
    assert spec.action_low.tolist() == [np.float32(-1.3)]
    assert (spec.max_episode_steps, spec.has_limit, spec.solved_at) == (60, True, -3.0)
    longer = describe(spec.id, max_episode_steps=70, features=("a", "b", "c"))
    assert (longer.max_episode_steps, longer.names.features) == (70, ("a", "b", "c"))


@pytest.mark.parametrize("name", ["Names", "Two", "Rk4"])
def test_gymnasium_finds_nothing_wrong(plants, name, recwarn):
    environment = gym.make(register_plant(f"{plants}:{name}"))
    check_env(environment.unwrapped, skip_render_check=True)
    # That it has no bounds of what is observed, and that forces are no numbers around 0.
    assert not [
        told for told in recwarn if not re.search("infinity|symmetric and normalized", str(told.message))
    ]


def test_another_limit_and_wrappers_are_kept(plants):
    cut = describe(f"{plants}:Box", wrappers=["gymnasium.wrappers:DiscretizeAction {bins: 3}"])
    assert (cut.names.features, cut.n_actions) == (("sine", "speed", "both"), 3)
    with closing(open_backend(cut, workers=1)) as backend:
        assert backend.name == "gymnasium"
    with closing(open_backend(describe(f"{plants}:Box", max_episode_steps=7))) as backend:
        forest = Forest.stack([DecisionTree.value_leaf([0.0], {})])
        assert backend.evaluate(forest, np.arange(3), "test").lengths.tolist() == [[7, 7, 7]]
    with pytest.raises(
        EnvironmentFaultError, match=r"under a name of their own, which are none; got gravity"
    ):
        describe(f"{plants}:Box", kwargs={"gravity": 5})


@pytest.mark.parametrize(
    ("name", "told"), [("Lost", "infinite or no number"), ("Raises", r"ValueError\('too far'\)")]
)
def test_what_is_lost_late_is_told_with_its_place(plants, name, told):
    spec = described(plants, name)
    right = Forest.stack([DecisionTree.leaf(0), DecisionTree.leaf(2)])
    with closing(KernelBackend(spec, 1)) as backend:
        # To the left all is well.
        assert np.isfinite(backend.evaluate(right.take([0]), np.arange(5), "test").returns).all()
        with pytest.raises(
            EnvironmentFaultError, match=rf"{told}.*; episode seed \d, step \d+, action 2 \(right\)$"
        ):
            backend.evaluate(right, np.arange(5), "test")


def test_a_plant_that_no_lane_holds_is_stepped_by_gymnasium(tmp_path):
    (tmp_path / "wide.py").write_text(
        "class Wide:\n"
        "    features = tuple(f'x{i}' for i in range(30))\n"
        "    actions = ('left', 'right')\n"
        "    start = [(0, 1)] * 30\n"
        "    max_episode_steps = 5\n"
        "    def step(state, action):\n"
        "        return state, 1.0, False\n"
    )
    spec = describe(f"{tmp_path / 'wide.py'}:Wide")
    assert dynamics_of(spec) is None
    with closing(open_backend(spec, workers=1)) as backend:
        assert backend.name == "gymnasium"


@pytest.mark.parametrize(("negated", "is_true"), [(["x", "v"], True), (["x"], False)])
def test_a_mirror_is_tried_by_setting_states(plants, negated, is_true):
    spec = described(plants, "Names")
    symmetry = {"negate": negated, "actions": {"left": "right"}}
    verdict = check_mirror(spec, symmetry, Mirror.declared(symmetry, spec.names))
    assert (not verdict.fault) == is_true
    assert ("steps from mirrored states" in verdict.found) == is_true
    assert ("has to become" in verdict.fault) != is_true


TRAIN = """
class Train:
    features = tuple(f"{what}{i}" for i in range(5) for what in "xv")
    actions = {"first": (-1.0, 1.0), "last": (-1.0, 1.0)}
    start = [(-1.0, 1.0)] * 10
    max_episode_steps = 50

    def step(state, action):
        a, va, b, vb, c, vc, d, vd, e, ve = state
        va, ve = va + 0.1 * (b - a + action[0]), ve + 0.1 * (d - e + FAR * action[1])
        vb, vd, vc = vb + 0.1 * (a - 2 * b + c), vd + 0.1 * (e - 2 * d + c), vc + 0.1 * (b - 2 * c + d)
        after = (a + 0.1 * va, va, b + 0.1 * vb, vb, c + 0.1 * vc, vc, d + 0.1 * vd, vd, e + 0.1 * ve, ve)
        return after, a * a + e * e, False
"""
ENDS = {"swap": [["x0", "x4"], ["v0", "v4"], ["x1", "x3"], ["v1", "v3"]], "actions": {"first": "last"}}
TURNED = {"negate": [f"{what}{i}" for i in range(5) for what in "xv"], "negate_actions": ["first", "last"]}


@pytest.mark.parametrize(
    ("far", "symmetry", "is_true"),
    [
        (1.0, ENDS, True),
        (1.01, ENDS, False),
        (1.01, TURNED, True),
        (1.0, {**TURNED, "negate": TURNED["negate"][:9]}, False),
    ],
)
def test_the_mirror_of_a_long_state_is_tried_by_setting_it(tmp_path, far, symmetry, is_true):
    (tmp_path / "train.py").write_text(f"FAR = {far}\n{TRAIN}")
    spec = describe(f"{tmp_path / 'train.py'}:Train")
    verdict = check_mirror(spec, symmetry, Mirror.declared(symmetry, spec.names))
    assert ("steps from mirrored states" in verdict.found) == is_true
    assert ("has to become" in verdict.fault) != is_true


def test_the_examples_of_the_documentation_agree(monkeypatch):
    monkeypatch.chdir(ROOT)
    for dynamics in (CART, MOTOR):
        with closing(open_backend(describe(dynamics), threads=1)) as backend:
            assert backend.name == "kernel"


def test_the_same_file_elsewhere_under_another_name_takes_what_was_compiled(tmp_path, plants):
    described(plants, "Names")
    (tmp_path / "other.py").write_bytes(plants.read_bytes())
    elsewhere = plant_kernel(f"{tmp_path / 'other.py'}:Names")
    elsewhere.step((0.0, 0.0), 1)
    assert elsewhere.step.stats.cache_hits
    assert not elsewhere.step.stats.cache_misses
