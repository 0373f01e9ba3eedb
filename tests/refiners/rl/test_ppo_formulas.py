"""PPO's training beside formulas written out."""

import torch
from ppo_for_tests import ACTIONS, FEATURES, MIXED, Trained, assert_close, config, drawn_samples, generators

from ge_torchrl.refiners.rl.actor_critic import ValueNetworks
from ge_torchrl.refiners.rl.ddt import soften


def naive_targets(samples, value, settings):
    """What the critic should say and the standardised advantages, of one stream of samples."""
    seen, then = samples["observation"], samples["next", "observation"]
    reward, done, terminated = (
        samples["next", key].squeeze(-1).double() for key in ("reward", "done", "terminated")
    )
    with torch.no_grad():
        now, later = value(seen).double(), value(then).double()
    delta = reward + settings.gamma * (1 - terminated) * later - now
    advantage = torch.zeros_like(delta)
    for t in range(len(delta) - 1, -1, -1):
        beyond = advantage[t + 1] if t + 1 < len(delta) else 0.0
        advantage[t] = delta[t] + settings.gamma * settings.gae_lambda * (1 - done[t]) * beyond
    return (advantage + now).float(), ((advantage - advantage.mean()) / advantage.std()).float()


def naive_parameters(tree, seed, settings):
    """One tree trained by formulas written out: no stack, no padding, no TorchRL."""
    rngs = generators([seed])
    start = soften([tree], ACTIONS, settings.alpha, leaf_logit=settings.leaf_logit, generators=rngs)
    networks = ValueNetworks(FEATURES, settings.critic_hidden, rngs)
    moves = torch.zeros(tree.num_decision_nodes, requires_grad=True)
    logits = start.leaf_logits[0].detach().clone().requires_grad_()
    layers = [
        (weight[0].detach().clone().requires_grad_(), bias[0, :, 0].detach().clone().requires_grad_())
        for weight, bias in networks.layers()
    ]
    optimizer = torch.optim.Adam(
        [
            {"params": [moves, logits], "lr": settings.lr_actor},
            {"params": [p for layer in layers for p in layer], "lr": settings.lr_critic},
        ]
    )
    threshold = torch.from_numpy(tree.threshold.copy())

    def probabilities(node, x):
        if node < 0:
            return logits[~node].softmax(0)
        z = settings.alpha * (threshold[node] + moves[node] - x[tree.feature[node]])
        left, right = (probabilities(int(c[node]), x) for c in (tree.children_left, tree.children_right))
        return torch.sigmoid(z) * left + torch.sigmoid(-z) * right

    def value(x):
        for i, (weight, bias) in enumerate(layers):
            x = torch.nn.functional.linear(x if i == 0 else x.relu(), weight, bias)
        return x.squeeze(-1)

    for batch in range(settings.max_timesteps // settings.update_timesteps):
        samples = drawn_samples(1000 * batch + seed, settings.update_timesteps)
        seen, (target, normal) = samples["observation"], naive_targets(samples, value, settings)
        progress = batch / max(settings.max_timesteps // settings.update_timesteps - 1, 1)
        bonus = settings.entropy_coeff * (1 - progress)
        for _ in range(settings.epochs):
            p = torch.stack([probabilities(0 if len(moves) else ~0, x) for x in seen])
            chosen = p.gather(1, samples["action"].unsqueeze(1)).squeeze(1)
            ratio = chosen / samples["action_log_prob"].exp()
            clipped = ratio.clamp(1 - settings.clip_epsilon, 1 + settings.clip_epsilon)
            gain = torch.minimum(ratio * normal, clipped * normal).mean()
            entropy = -(p * p.log()).sum(1).mean()
            error = 0.5 * (value(seen) - target).square().mean()
            optimizer.zero_grad()
            (-gain - bonus * entropy + error).backward()
            optimizer.step()
    numbers = {"threshold": moves, "leaf_logits": logits[: tree.num_leaves]}
    numbers["numbers"] = torch.cat([p.flatten() for layer in layers for p in layer])
    return {name: number.detach() for name, number in numbers.items()}


def test_training_is_that_of_formulas_written_out():
    settings = config(max_timesteps=120, update_timesteps=40, epochs=2)
    trained = Trained(MIXED, settings)
    for row, tree in enumerate(MIXED):
        assert_close(naive_parameters(tree, row, settings), trained.parameters_of(row), 1e-4)
