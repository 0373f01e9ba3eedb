"""PPO never leaves a tree in ruins, and one that fails disturbs no other (law 9)."""

import pytest
import torch
from ppo_for_tests import (
    ACTIONS,
    FEATURES,
    LITTLE,
    MIXED,
    GivenSource,
    Trained,
    assert_close,
    config,
    generators,
    hardened,
)

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks, make_actor
from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.ppo import Learner


def spoiled(key, value, *, tree=1, batch=1):
    """Put a value into one sample of one tree."""

    def change(samples, number):
        if number == batch:
            samples[key][tree, 7] = value

    return change


FAILURES = {
    "an observation": spoiled("observation", torch.nan),
    "a reward": spoiled(("next", "reward"), torch.inf),
    "the loss": spoiled("action_log_prob", torch.nan),
}


@pytest.mark.parametrize("what", FAILURES)
@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_a_failing_tree_is_put_back_and_disturbs_no_other(what, optimizer):
    """Law 9; it fails in the second update, when it and its optimiser have moved already."""
    settings, steps = config(optimizer=optimizer), 3
    trained = Trained(MIXED, settings, change=FAILURES[what])
    before = Trained(MIXED, config(max_timesteps=200, epochs=1, lr_actor=1e-12, lr_critic=1e-12))
    failures = [record.failure for record in trained.records]
    assert failures == [None, f"{what} is not finite in update 2, after {steps} gradient steps", None]
    assert trained.records[1].gradient_steps == steps
    assert_close(trained.parameters_of(1), before.parameters_of(1), 1e-9)
    for row in (0, 2):
        alone = Trained([MIXED[row]], settings, seeds=[row])
        assert_close(trained.parameters_of(row), alone.parameters_of(0), 1e-4)
        assert trained.records[row].gradient_steps == 9


def test_a_gradient_and_a_parameter_that_are_not_finite_put_a_tree_back_too():
    def learner():
        rngs = generators(range(3))
        ddt = soften(MIXED, ACTIONS, LITTLE.alpha, generators=rngs)
        return ddt, Learner(ddt, make_actor(ddt), ValueNetworks(FEATURES, (8,), rngs), config(epochs=1))

    def spoiled_gradient(gradient):
        gradient = gradient.clone()
        gradient[1] = torch.inf
        return gradient

    ddt, of_gradient = learner()
    hook = ddt.threshold.register_hook(spoiled_gradient)
    of_gradient.update(GivenSource(range(3)).collect(50))
    hook.remove()
    assert [r.failure for r in of_gradient.records()] == [
        None,
        "a gradient is not finite in update 1, after 0 gradient steps",
        None,
    ]
    ddt, of_parameter = learner()
    of_parameter._optimizer.register_step_post_hook(lambda *_: ddt.threshold.data[0].fill_(torch.nan))
    of_parameter.update(GivenSource(range(3)).collect(50))
    assert (
        of_parameter.records()[0].failure == "a parameter is not finite in update 1, after 0 gradient steps"
    )
    assert of_parameter.alive.tolist() == [False, True, True]
    assert hardened(ddt)[0] == MIXED[0]


def test_training_ends_when_all_trees_have_failed():
    looks = []

    def change(samples, batch):
        if batch == 1:
            samples["next", "reward"][:] = torch.nan

    trained = Trained(MIXED, change=change, after_update=lambda: looks.append(1))
    assert len(looks) == 1
    assert {record.updates for record in trained.records} == {1}
    assert [record.timesteps for record in trained.records] == [400] * 3
    assert hardened(trained.ddt) == list(MIXED)
