"""How the refiners' bench refines: the rows of its tables, by what they ask."""

from dataclasses import dataclass, replace

from ge_torchrl.config import PolishConfig, PPOConfig, RefinerConfig


@dataclass(frozen=True)
class Row:
    """How trees are refined: by PPO or local search, followed by the polish or not; accepted or not by `refiner`."""

    name: str
    refiner: RefinerConfig
    search: PolishConfig | None = None
    polish: PolishConfig | None = None


def rows_of_ppo(refiner: RefinerConfig, polish: PolishConfig) -> list[Row]:
    """PPO as the default has it, with one part at a time left out or put back to what the thesis has."""
    ppo = refiner.ppo

    def of(**changes) -> RefinerConfig:
        return replace(refiner, ppo=replace(ppo, **changes))

    changed = {
        "PPO, straight-through": of(straight_through=True),
        "not standardised, alpha 1000": of(standardise=False, alpha=1000.0),
        "leaves of Eq. 3": of(leaf_logit=None),
        "last tree, not the best snapshot": of(snapshot_episodes=0),
        "accepted unseen": replace(refiner, acceptance_episodes=0),
        "last tree, accepted unseen": replace(of(snapshot_episodes=0), acceptance_episodes=0),
        "straight-through, last tree, accepted unseen": replace(
            of(straight_through=True, snapshot_episodes=0), acceptance_episodes=0
        ),
    }
    rows = [Row("PPO", refiner), *(Row(name, config) for name, config in changed.items())]
    return [*rows, Row("PPO, then the polish", refiner, polish=polish)]


def rows_of_hyperparameters(refiner: RefinerConfig, _polish: PolishConfig) -> list[Row]:
    """PPO with other numbers than the default's."""
    ppo = refiner.ppo
    changed: dict[str, PPOConfig] = {
        "alpha 50": replace(ppo, alpha=50.0),
        "learning rate 0.001, as in the thesis": replace(ppo, lr_actor=0.001),
        "RMSprop": replace(ppo, optimizer="rmsprop"),
        "gamma 0.95, lambda 0.95": replace(ppo, gamma=0.95, gae_lambda=0.95),
        "entropy bonus constant": replace(ppo, entropy_final=None),
        "minibatches of 250": replace(ppo, minibatch_size=250),
        "critic of 64 and 64": replace(ppo, critic_hidden=(64, 64)),
        "a quarter of the steps": replace(ppo, max_timesteps=ppo.max_timesteps // 4),
        "four times the steps": replace(ppo, max_timesteps=ppo.max_timesteps * 4),
    }
    rows = [Row(name, replace(refiner, ppo=config)) for name, config in changed.items()]
    return [Row("PPO", refiner), *rows]


def rows_of_budgets(refiner: RefinerConfig, polish: PolishConfig) -> list[Row]:
    """Local search with other budgets, episodes and moves; on few episodes the best tree tried is the luckiest."""
    changed: dict[str, PolishConfig] = {"as the polish": polish}
    for episodes in (40, 100, 400):
        for first_step in (0.5, 0.02):
            changed[f"CMA-ES, {episodes} episodes, first step {first_step}"] = replace(
                polish,
                max_timesteps=episodes * 7500,
                episodes=episodes,
                moves=0,
                first_step=first_step,
            )
    for episodes, million in ((100, 1.0), (400, 1.0), (400, 2.5), (400, 10.0), (1000, 10.0)):
        changed[f"8 moves, {episodes} episodes, screened on a quarter, {million:g} million steps"] = replace(
            polish,
            max_timesteps=int(million * 1e6),
            episodes=episodes,
            moves=8,
            first_step=0.02,
        )
    return [Row(name, refiner, search=config) for name, config in changed.items()]


def rows_in_short(refiner: RefinerConfig, polish: PolishConfig) -> list[Row]:
    """PPO with soft and with straight-through splits, and what the polish adds to it."""
    first, straight_through, *_, polished = rows_of_ppo(refiner, polish)
    return [first, straight_through, polished]


ROWS = {
    "parts": rows_of_ppo,
    "short": rows_in_short,
    "hyperparameters": rows_of_hyperparameters,
    "budgets": rows_of_budgets,
}
