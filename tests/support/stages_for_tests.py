"""Controllers and moments to draw."""

from dataclasses import replace

import numpy as np
from documents_for_tests import names_for

from ge_torchrl.play.episode import Moment, way_through
from ge_torchrl.trees.controller import Controller

OBSERVED = np.float32([0.1, -0.2, 0.3, 1e-7])


def controller_of(tree):
    """A controller whose leaves may answer anything."""
    names = names_for(tree)
    return Controller(tree, replace(names, action_bounds=tuple((-1.0, 1.0) for _ in names.action_bounds)))


def moment_of(controller, observation=OBSERVED, picture=None, ended=""):
    """What is shown of an observation."""
    path, leaf = way_through(controller.tree, observation)
    answer = controller(observation)
    told = answer if isinstance(answer, int) else tuple(answer.tolist())
    return Moment(1234, observation, path, leaf, told, -56.7, ended, picture)
