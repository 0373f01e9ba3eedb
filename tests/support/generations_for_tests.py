"""Generations one after the other, of a search in which all or one thing goes on."""

from problems_for_tests import Nudge, problem_of

from ge_torchrl.search.step import first_state, step

EVERYTHING = {
    "refiner": {"schedule": {"every": 2}, "candidates": 2, "acceptance_episodes": 5, "measuring_episodes": 5},
    "polish": {"every": 3},
    "archive": {
        "keep": 3,
        "episodes": 20,
        "neighbours": 4,
        "revisit_factor": 2,
        "migrants": 4,
    },
}
ARCHIVE = {**EVERYTHING["archive"], "neighbours_drawn": 40, "max_nodes": 5}


def everything(backend, **changes):
    """Return a problem in which all that a generation can do is done."""
    return problem_of(backend, Nudge(backend), Nudge(backend, "polish"), **{**EVERYTHING, **changes})


def run(problem, n):
    """Return the states and events of `n` generations."""
    found = [first_state(problem)]
    while len(found) < n:
        found.append(step(problem, found[-1][0]))
    return found


def last_state(problem, n):
    return run(problem, n)[-1][0]


class Script:
    """Answers generation after generation with what the test wrote down."""

    def __init__(self, *answers):
        self._answers = list(answers)
        self.asked = []

    def refine(self, trees, rngs, effort):
        self.asked.append(list(trees))
        return self._answers.pop(0).refine(trees, rngs, effort)


def refining(backend, *answers, **changes):
    """Return a problem whose refiner, every second generation, answers so; nothing else goes on."""
    sections = {"refiner": {"schedule": {"every": 2}, "measuring_episodes": 5, "acceptance_episodes": 0}}
    for name, values in changes.items():
        sections[name] = {**sections.get(name, {}), **values}
    return problem_of(backend, Script(*answers), **sections)
