"""`play`: an episode to watch."""

import os
import sys
from pathlib import Path

from ge_torchrl.checks import MOST_SEED
from ge_torchrl.cli.parser import Parser, add_controller, add_trust, integer_from
from ge_torchrl.cli.process import seen_by_others
from ge_torchrl.cli.statuses import OK


def play(arguments: list[str]) -> int:
    """Show an episode of a controller, as `play --help` tells; return the exit status."""
    options = _parser().parse_args(arguments)
    # pygame greets on standard output, and would look for a display where a file is written.
    variables = {"PYGAME_HIDE_SUPPORT_PROMPT": "1"}
    if options.out is not None:
        variables["SDL_VIDEODRIVER"] = "dummy"
        if sys.platform == "linux":
            # MuJoCo would open a window of its own, and end the program where there is no display.
            variables["MUJOCO_GL"] = os.environ.get("MUJOCO_GL", "egl")
    with seen_by_others(sys.argv[1:], variables):
        from ge_torchrl.environments.trust import trusting
        from ge_torchrl.play.playing import play as play_episode
        from ge_torchrl.report.reading import read_tree
        from ge_torchrl.trees.controller import Controller

        with trusting(vouched=options.trust):
            tree, spec = read_tree(options.path, options.nodes)
        played = play_episode(
            Controller(tree, spec.names), spec, options.seed, options.out, options.episode, options.steps
        )
    if not played.is_drawn:
        print(f"ge-torchrl: {spec.id} draws no picture of itself; what it observes is drawn", file=sys.stderr)
    print(played.as_text())
    return OK


def _parser() -> Parser:
    parser = Parser(
        prog="ge-torchrl play",
        description="Show an episode of a tree, with the rule beside it and the path that decides lit: in a window, or "
        "as a GIF or an MP4.",
    )
    add_controller(parser, "TREE_OR_RUN")
    add_trust(parser)
    parser.add_argument(
        "--seed",
        type=integer_from(0, MOST_SEED),
        default=10000,
        help="of the episode; default: 10000, as of evaluate",
    )
    parser.add_argument(
        "--episode",
        choices=("best", "median", "worst"),
        help="take this one, by its return, of the 100 episodes from --seed on",
    )
    parser.add_argument(
        "--steps", metavar="N", type=integer_from(1), default=1000, help="so many at most; default: 1000"
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="write episode.gif or episode.mp4; default: open a window"
    )
    return parser
