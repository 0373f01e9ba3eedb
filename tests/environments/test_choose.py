import gymnasium as gym
import pytest
from environments_for_tests import CountdownEnv

from ge_torchrl.environments.choose import agrees_with_gymnasium, open_backend
from ge_torchrl.environments.gymnasium_backend import GymnasiumBackend
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.kernels.dynamics import DYNAMICS
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError


@pytest.fixture
def opened():
    """Open backends that are closed at the end."""
    backends = []

    def open_one(*arguments):
        backends.append(open_backend(*arguments))
        return backends[-1]

    yield open_one
    for backend in backends:
        backend.close()


@pytest.fixture
def countdown():
    gym.register("Countdown-v0", entry_point=CountdownEnv)
    yield describe("Countdown-v0")
    del gym.registry["Countdown-v0"]


@pytest.mark.parametrize("environment_id", DYNAMICS)
@pytest.mark.parametrize("limit", [None, 7])
def test_auto_takes_the_kernel_where_it_agrees(environment_id, limit, opened):
    spec = describe(environment_id, max_episode_steps=limit)
    assert agrees_with_gymnasium(spec)
    backend = opened(spec)
    assert isinstance(backend, KernelBackend)
    assert backend.name == "kernel"


@pytest.mark.parametrize(
    "described",
    [
        {"kwargs": {"goal_velocity": 0.05}},
        {"wrappers": ("environments_for_tests:DoubledReward",)},
    ],
    ids=["arguments", "a wrapper"],
)
def test_the_kernel_runs_only_for_the_environment_that_it_implements(described, opened):
    spec = describe("MountainCar-v0", **described)
    assert isinstance(opened(spec, "auto", 0, 1), GymnasiumBackend)
    with pytest.raises(EnvironmentFaultError, match="without arguments or wrappers"):
        opened(spec, "kernel")


def test_auto_falls_back_with_a_warning_where_gymnasium_differs(monkeypatch, caplog, opened):
    gravity_on_the_moon = gym.make("CartPole-v1")
    gravity_on_the_moon.unwrapped.gravity = 1.62
    monkeypatch.setattr("ge_torchrl.environments.choose.make_gymnasium", lambda _: gravity_on_the_moon)
    backend = opened(describe("CartPole-v1"))
    assert isinstance(backend, GymnasiumBackend)
    assert "differs from the kernel" in caplog.text


def test_gymnasium_is_taken_where_it_is_asked_for(opened):
    backend = opened(describe("CartPole-v1"), "gymnasium", 0, 1)
    assert isinstance(backend, GymnasiumBackend)
    assert backend.name == "gymnasium"


def test_the_kernel_is_refused_where_there_is_none(countdown, opened):
    with pytest.raises(EnvironmentFaultError, match=r"env\.route=kernel needs a kernel"):
        opened(countdown, "kernel")
    assert isinstance(opened(countdown, "auto", 0, 1), GymnasiumBackend)


def test_other_routes_are_refused():
    with pytest.raises(
        ValueError, match=r'env\.route must be "auto", "kernel" or "gymnasium"; got "?\'?compiled'
    ):
        open_backend(describe("CartPole-v1"), "compiled")
