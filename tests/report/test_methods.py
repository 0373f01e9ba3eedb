import pytest
from sweeps_for_tests import config

from ge_torchrl.report.methods import METHODS, method_of, refiner_of


@pytest.mark.parametrize(
    ("refiner", "method", "name"),
    [("none", "GE", ""), ("ppo", "GE+PPO", "PPO"), ("cmaes", "GE+CMA-ES", "CMA-ES")],
)
def test_methods_are_named_after_their_refiner(refiner, method, name):
    assert method_of(config(refiner=refiner)) == method
    assert method in METHODS
    assert refiner_of(method) == name
