"""Runs environments that nobody here wrote, one command each, and writes docs/foreign_environments.md.

    python docs/foreign/run.py            # into an environment of its own, in a temporary folder
    python docs/foreign/run.py --here     # with the packages of this Python

The first installs the project and `requirements.txt`, some hundred megabytes.
"""

# ruff: noqa: INP001 (a script)
from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
PAGE = ROOT / "docs" / "foreign_environments.md"
SECONDS = 60
RANDOM_EPISODES, RANDOM_STEPS = 100, 20_000
FLAT = ("gymnasium.wrappers:FlattenObservation",)
IMAGE_AND_DIRECTION = (
    "gymnasium.wrappers:FilterObservation {filter_keys: [direction, image]}",
    "gymnasium.wrappers:FlattenObservation",
)


@dataclass(frozen=True)
class Foreign:
    """An environment, as it is typed, and what is special about it."""

    id: str
    special: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    wrappers: tuple[str, ...] = ()
    has_file: bool = False  # In conf/env, which is not to be taken.

    @property
    def words(self) -> list[str]:
        """What is typed behind `python -m ge_torchrl`."""
        wrappers = ",".join(f'"{name}"' if " " in name else name for name in self.wrappers)
        kwargs = [
            f"env.kwargs.{key}={json.dumps(value).strip(chr(34))}" for key, value in self.kwargs.items()
        ]
        return [
            *(["env=default"] if self.has_file else []),
            f"env.id={self.id}",
            *kwargs,
            *([f"env.wrappers=[{wrappers}]"] if wrappers else []),
            f"ge.max_seconds={SECONDS}",
        ]


ENVIRONMENTS = (
    Foreign("LunarLander-v3", "Box2D", has_file=True),
    Foreign("LunarLanderContinuous-v3", "Box2D, two numbers", has_file=True),
    Foreign("BipedalWalker-v3", "Box2D, four numbers, episodes of 1,600 steps"),
    Foreign("InvertedPendulum-v5", "MuJoCo"),
    Foreign("Hopper-v5", "MuJoCo"),
    Foreign("Swimmer-v5", "MuJoCo, each episode has 1,000 steps"),
    Foreign("Ant-v5", "MuJoCo, 105 features"),
    Foreign("Humanoid-v5", "MuJoCo, 348 features, some thousand steps a second"),
    Foreign("FrozenLake-v1", "a number, one-hot", wrappers=FLAT),
    Foreign("Taxi-v4", "500 states, one-hot", wrappers=FLAT),
    Foreign("Blackjack-v1", "a Tuple, one-hot; no limit of its own", wrappers=FLAT),
    Foreign("gymnasium_robotics:PointMaze_UMaze-v3", "a Dict, flattened", wrappers=FLAT),
    Foreign("minigrid:MiniGrid-Empty-5x5-v0", "a Dict with a sentence", wrappers=IMAGE_AND_DIRECTION),
    Foreign("minatar:MinAtar/Breakout-v1", "a picture of ten by ten, flattened", wrappers=FLAT),
    Foreign("ale_py:ALE/Freeway-v5", "Atari, 128 bytes of memory", kwargs={"obs_type": "ram"}),
    Foreign(
        "flappy_bird_gymnasium:FlappyBird-v0", "twelve numbers", kwargs={"use_lidar": False}, has_file=True
    ),
    Foreign("highway_env:highway-fast-v0", "a table, flattened; some dozen steps a second", wrappers=FLAT),
)


def main() -> None:
    """Run all environments, or those that are named, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--here", action="store_true", help="with the packages of this Python")
    parser.add_argument("--only", metavar="TEXT", default="", help="those whose id has this; writes no page")
    parser.add_argument(
        "--runs",
        metavar="FOLDER",
        type=Path,
        help="where the runs go, finished ones stay; default: a temporary one",
    )
    options = parser.parse_args()
    if not options.here:
        others = ["--only", options.only] if options.only else []
        others += ["--runs", str(options.runs)] if options.runs else []
        _in_an_environment_of_its_own([__file__, "--here", *others])
        return
    runs = options.runs or Path(tempfile.mkdtemp(prefix="foreign-"))
    chosen = [foreign for foreign in ENVIRONMENTS if options.only in foreign.id]
    rows, loads = [], []
    for number, foreign in enumerate(chosen):
        rows.append(_row(foreign, runs / f"{number:02}"))
        loads.append(os.getloadavg()[1])
    if not options.only:
        PAGE.write_text(_page(rows, sum(loads) / len(loads)), encoding="utf-8")


def _in_an_environment_of_its_own(words: list[str]) -> None:
    with tempfile.TemporaryDirectory(prefix="foreign-") as folder:
        venv.create(folder, with_pip=True)
        python = Path(folder) / "bin" / "python"
        constraints = ["-c", str(ROOT / "constraints.txt")]
        wanted = [str(ROOT), "-r", str(FOLDER / "requirements.txt")]
        for command in (["-m", "pip", "install", "--quiet", *constraints, *wanted], words):
            subprocess.run([python, *command], check=True)  # noqa: S603


def _row(foreign: Foreign, folder: Path) -> str:
    """Run an environment, and return its row of the table."""
    folder.mkdir(parents=True, exist_ok=True)
    found = folder / "run" / "summary.json"
    if not found.exists():
        command = [sys.executable, "-m", "ge_torchrl", *foreign.words, f"hydra.run.dir={folder / 'run'}"]
        with (folder / "screen.txt").open("w", encoding="utf-8") as screen:
            # Its own folder: nothing of it may depend on where this was started.
            done = subprocess.run(command, cwd=folder, stdout=screen, stderr=screen, check=False)  # noqa: S603
        print(f"{foreign.id}: exit status {done.returncode}; {folder / 'screen.txt'}", flush=True)
    told = (folder / "screen.txt").read_text(encoding="utf-8")
    if not found.exists() or "Traceback" in told:
        return f"| `{foreign.id}` | {foreign.special} | failed: {told.splitlines()[-1]} |  |  |  |  |  |  |"
    summary = json.loads(found.read_text(encoding="utf-8"))
    features, actions, random = _by_random_actions(foreign)
    return (
        f"| `{foreign.id}` | {foreign.special} | {features:,}, {actions} | {random:.4g} | "
        f"{summary['test_mean']:.4g} ({summary['test_episodes']:,}) | {summary['decision_nodes']} | "
        f"{summary['route']} | {_short(summary['steps_per_second'])} | {summary['wall_seconds']:.0f} |"
    )


def _by_random_actions(foreign: Foreign) -> tuple[int, str, float]:
    """Return the number of features, what an action is, and the mean return of random actions."""
    import numpy as np

    from ge_torchrl.environments.border import Border, Witness, random_action
    from ge_torchrl.environments.spec import describe

    spec = describe(foreign.id, kwargs=foreign.kwargs, wrappers=foreign.wrappers, max_episode_steps=None)
    if not spec.has_limit:
        spec = describe(foreign.id, kwargs=foreign.kwargs, wrappers=foreign.wrappers, max_episode_steps=1000)
    rng, returns, n_steps = np.random.default_rng(0), [], 0
    with closing(Border(spec, Witness(spec))) as border:
        while len(returns) < RANDOM_EPISODES and (n_steps < RANDOM_STEPS or not returns):
            border.reset(len(returns))
            total, ended = 0.0, False
            while not ended:
                _, reward, terminated, truncated = border.step(random_action(spec, rng))
                total, n_steps, ended = total + reward, n_steps + 1, terminated or truncated
            returns.append(total)
    kind = f"{spec.n_actions} numbers" if spec.is_continuous else f"one of {spec.n_actions}"
    return spec.n_features, kind.replace("1 numbers", "1 number"), float(np.mean(returns))


def _short(speed: float) -> str:
    return f"{float(f'{speed:.2g}'):,.0f}"


def _page(rows: list[str], load: float) -> str:
    commands = "\n".join(f"python -m ge_torchrl {_typed(foreign)}" for foreign in ENVIRONMENTS)
    head = "| environment | special | observed numbers, action | random actions | rule (test episodes) | nodes | route "
    return "\n".join(
        [
            "# Environments of other people",
            "",
            "`python docs/foreign/run.py` writes this page. Each environment is run by one command, below, without",
            f"any file or code for it and with {SECONDS} seconds, where a run without a limit takes minutes: the page",
            "shows that these environments run, what is typed, and what comes of a minute. Random actions play",
            f"{RANDOM_EPISODES} episodes, or {RANDOM_STEPS:,} steps. The rule's mean is over unseen episodes, as many",
            f"as the limit leaves room for. The machine had {os.cpu_count()} cores and a load of {load:.1f} on the",
            "average, that of these runs and of others.",
            "",
            f"{head}| steps a second | seconds |",
            "| --- | --- | --- | ---: | ---: | ---: | --- | ---: | ---: |",
            *rows,
            "",
            "```",
            commands,
            "```",
            "",
        ]
    )


def _typed(foreign: Foreign) -> str:
    return " ".join(f"'{word}'" if set(word) & set('[{" ') else word for word in foreign.words)


if __name__ == "__main__":
    main()
