from records_for_tests import summary

from ge_torchrl.report.published import PUBLISHED
from ge_torchrl.report.tables import aligned, published_summary, runs_table, thesis_table


def test_a_row_a_run_in_the_order_of_seeds_and_a_table_an_environment():
    runs = [
        summary(
            seed=1, solved=False, test_mean=199.7, train_fitness=234.8, complexity_M=35.6, decision_nodes=2
        ),
        summary(environment="Acrobot-v1", solved_at=None, solved=None, test_mean=-83.0, train_fitness=-81.0),
        summary(seed=0),
    ]
    assert runs_table(runs) == (
        "**Acrobot-v1** (100 test episodes)\n"
        "\n"
        "| seed | training | test mean ± sd | solved | M | decision nodes | evolution s | all s |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 0 | -81.00 | -83.00 ± 12.35 |  | 53.4 | 3 | 0.25 | 0.50 |\n"
        "| **all** | -81.00 | -83.00 | **0 of 1** | 53.4 | 3.0 | 0.25 | 0.50 |\n"
        "\n"
        "**CartPole-v1** (100 test episodes, solved from 475)\n"
        "\n"
        "| seed | training | test mean ± sd | solved | M | decision nodes | evolution s | all s |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 0 | 500.00 | 487.40 ± 12.35 | yes | 53.4 | 3 | 0.25 | 0.50 |\n"
        "| 1 | 234.80 | 199.70 ± 12.35 | no | 35.6 | 2 | 0.25 | 0.50 |\n"
        "| **all** | 367.40 | 343.55 | **1 of 2** | 44.5 | 2.5 | 0.25 | 0.50 |"
    )


def test_a_method_is_named_in_the_title():
    assert runs_table([summary()], "GE+PPO").startswith("**CartPole-v1 GE+PPO** (100 test episodes, solved")


def test_the_numbers_of_the_thesis_stand_beside_ours():
    runs = [
        summary(seed=1, train_fitness=500.0, test_mean=480.0, complexity_M=17.8),
        summary(seed=12, train_fitness=400.0, test_mean=300.0, complexity_M=53.4, solved=False),
    ]
    assert thesis_table(runs, PUBLISHED["CartPole-v1"]) == (
        "| run | seed | training | thesis | test | thesis | M | thesis | solved | thesis |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| R2 | 1 | 500.00 | 234.80 | 480.00 | 199.71 | 17.8 | 35.6 | yes | no |\n"
        "| R13 | 12 | 400.00 |  | 300.00 |  | 53.4 |  | no |  |\n"
        "|  | **mean** | 450.00 | 473.48 | 390.00 | 465.17 | 35.6 | 48.1 | 1 of 2 | 9 of 10 |"
    )


def test_without_numbers_of_the_thesis_there_are_no_columns_for_them():
    assert thesis_table([summary(environment="LunarLander-v3")], None) == (
        "| seed | training | test | M | solved |\n"
        "| --- | ---: | ---: | ---: | ---: |\n"
        "| 0 | 500.00 | 487.40 | 53.4 | yes |\n"
        "| **mean** | 500.00 | 487.40 | 53.4 | 1 of 1 |"
    )


def test_what_the_thesis_found_in_short():
    assert published_summary(PUBLISHED["MountainCar-v0"]) == ["5 of 10", "-110.19", "73.0"]


def test_a_table_for_a_terminal_is_aligned_to_the_right():
    assert aligned(["seed", "mean"], [["3", "-110.00"], ["10", "-9.5"]]) == (
        "seed     mean\n   3  -110.00\n  10     -9.5"
    )
