"""Which environments have compiled dynamics: five of Gymnasium's, and every plant that fits the lanes."""

from __future__ import annotations

from ge_torchrl.environments.kernels.dynamics import DYNAMICS, Dynamics
from ge_torchrl.environments.plants.kernel import plant_kernel
from ge_torchrl.environments.plants.plant import names_plant
from ge_torchrl.environments.spec import EnvironmentSpec


def dynamics_of(spec: EnvironmentSpec) -> Dynamics | None:
    """Return the compiled dynamics of an environment just as it is; any limit of its episodes will do."""
    if spec.names.wrappers:
        return None
    if names_plant(spec.id):
        return plant_kernel(spec.id, spec.names.kwargs).dynamics
    return None if spec.names.kwargs else DYNAMICS.get(spec.id)


def has_kernel(spec: EnvironmentSpec) -> bool:
    """Tell whether there are compiled dynamics of an environment just as it is."""
    return dynamics_of(spec) is not None
