from records_for_tests import summary

from ge_torchrl.report.tables import runs_table


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
