"""The mirrors that the shipped files declare hold."""

from pathlib import Path

import pytest
import yaml

from ge_torchrl.config import EnvironmentConfig
from ge_torchrl.environments.mirroring import check_mirror
from ge_torchrl.environments.spec import describe_settings
from ge_torchrl.refiners.mirror import Mirror

FILES = sorted((Path(__file__).resolve().parents[2] / "conf" / "env").glob("*.yaml"))
SETTINGS = {
    path.stem: (yaml.safe_load(path.read_text(encoding="utf-8")) or {}).get("env", {}) for path in FILES
}
WITH_A_MIRROR = sorted(name for name, env in SETTINGS.items() if "symmetry" in env)


def test_five_environments_have_one():
    assert WITH_A_MIRROR == ["acrobot", "cartpole", "lunarlander", "lunarlander_continuous", "pendulum"]


@pytest.mark.parametrize("name", WITH_A_MIRROR)
def test_it_is_not_refuted(name):
    spec = describe_settings(EnvironmentConfig(**SETTINGS[name]))
    symmetry = SETTINGS[name]["symmetry"]
    verdict = check_mirror(spec, symmetry, Mirror.declared(symmetry, spec.names))
    assert verdict.found
    assert not verdict.fault
