import pytest

from ge_torchrl.report.thesis.beside import (
    published_beside,
    published_columns,
    published_in_short,
    refinements_of,
    source_of,
)
from ge_torchrl.report.thesis.published import PUBLISHED


@pytest.mark.parametrize("method", ["GE", "GE+PPO", "GE+PPO+polish", "GE+CMA-ES"])
def test_the_thesis_stands_beside_its_own_settings_alone(method):
    assert published_beside(method, "CartPole-v1") is None
    assert published_beside("thesis", "CartPole-v1") is PUBLISHED["CartPole-v1"]
    assert published_beside("thesis", "LunarLander-v3") is None


def test_columns_are_empty_where_the_thesis_has_no_such_run():
    assert published_columns(PUBLISHED["CartPole-v1"], [1, 12]).markdown() == (
        "| thesis | training | test | M | solved |\n"
        "| --- | ---: | ---: | ---: | ---: |\n"
        "| R2 | 234.80 | 199.71 | 35.6 | no |\n"
        "|  |  |  |  |  |\n"
        "| all | 473.48 | 465.17 | 48.1 | 9 of 10 |"
    )


def test_what_the_thesis_found_in_short():
    assert published_in_short([PUBLISHED["MountainCar-v0"], None]).rows == (
        ("5 of 10", "-110.19", "73.0"),
        ("", "", ""),
    )


def test_sources_are_named():
    assert source_of(PUBLISHED["Acrobot-v1"]).startswith(
        "Thesis: Table 4.6. A seed does not make the same run"
    )
    assert refinements_of(PUBLISHED["CartPole-v1"]).startswith(
        "* Thesis: 29 of 40 improved the tree, 4 of them"
    )
