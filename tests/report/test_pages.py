import re

import pytest
from records_for_tests import history, kept, refinement
from sweeps_for_tests import write_run

from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.pages import write_report
from ge_torchrl.report.runs import read_runs
from ge_torchrl.report.sizes import by_size, sizes_table


@pytest.fixture
def sweep(tmp_path):
    folder = tmp_path / "sweep"
    for seed in range(4):
        write_run(folder / "ge" / str(seed), seed=seed, generations=history([9.0] * 5 + [500.0]))
        write_run(
            folder / "ppo" / str(seed),
            "GE+PPO",
            seed=seed,
            generations=history([9.0] * (seed + 1) + [500.0] * (5 - seed)),
            refinements=[refinement(1)],
        )
    return folder


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_report_links_to_nothing_that_is_missing_and_leaves_nothing_unlinked(sweep, tmp_path):
    write_run(sweep / "acrobot", environment="Acrobot-v1", solved_at=-100.0, test_mean=-90.0)
    report = write_report(sweep, None, tmp_path / "out")
    text = report.read_text()
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    written = {str(path) for path in contents(tmp_path / "out") if path.suffix == ".svg"}
    assert linked == written
    assert len(written) == 3 + 4 + 1 + 2
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE) == ["Acrobot-v1", "CartPole-v1"]
    assert re.findall(r"^### CartPole-v1: (.*)$", text, flags=re.MULTILINE) == [
        "GE+PPO",
        "what PPO did in GE+PPO",
        "GE",
        "generations to solve, GE+PPO and GE alone",
        "figures",
        "the best tree of GE+PPO",
        "the best tree of GE",
    ]


def test_each_refined_method_is_compared_with_ge_alone(sweep, tmp_path):
    for seed in range(2):
        write_run(sweep / "cmaes" / str(seed), "GE+CMA-ES", seed=seed, refinements=[refinement(1)])
    text = write_report(sweep, None, tmp_path / "out").read_text()
    assert "GE is Grammatical Evolution alone, GE+PPO with PPO, GE+CMA-ES with CMA-ES. Numbers" in text
    assert re.findall(r"^### CartPole-v1: (.*)$", text, flags=re.MULTILINE) == [
        "GE+PPO",
        "what PPO did in GE+PPO",
        "GE+CMA-ES",
        "what CMA-ES did in GE+CMA-ES",
        "GE",
        "generations to solve, GE+PPO and GE alone",
        "generations to solve, GE+CMA-ES and GE alone",
        "figures",
        "the best tree of GE+PPO",
        "the best tree of GE+CMA-ES",
        "the best tree of GE",
    ]
    assert {path.name for path in (tmp_path / "out" / "figures").glob("*.svg")} == {
        "cartpole-v1-fitness.svg",
        "cartpole-v1-ge-ppo-solving.svg",
        "cartpole-v1-ge-ppo-pairs.svg",
        "cartpole-v1-ge-cma-es-solving.svg",
        "cartpole-v1-ge-cma-es-pairs.svg",
    }


def test_equal_artefacts_give_equal_bytes(sweep, tmp_path):
    write_report(sweep, None, tmp_path / "one")
    write_report(sweep, None, tmp_path / "other")
    assert contents(tmp_path / "one") == contents(tmp_path / "other")


def test_a_report_on_a_report_replaces_it(sweep):
    write_report(sweep, None, sweep / "report")
    first = contents(sweep / "report")
    write_report(sweep, None, sweep / "report")
    assert contents(sweep / "report") == first


def test_the_other_method_may_lie_elsewhere(sweep, tmp_path):
    together = write_report(sweep, None, tmp_path / "together").read_text()
    apart = write_report(sweep / "ppo", sweep / "ge", tmp_path / "apart").read_text()
    assert apart.splitlines()[1:] == together.splitlines()[1:]


def test_the_thesis_is_told_beside_its_own_runs(tmp_path):
    write_run(tmp_path / "sweep" / "a", "thesis", refinements=[refinement(1)])
    text = write_report(tmp_path / "sweep", None, tmp_path / "out").read_text()
    assert "GE is Grammatical Evolution alone, thesis with PPO as the thesis applies it." in text
    assert "* Thesis: 29 of 40 improved the tree, 4 of them to the highest possible return." in text
    assert "| R1 | 500.00 | 500.00 | 53.4 | yes |" in text


def test_sizes_have_a_table_and_a_figure_where_a_run_kept_an_archive(tmp_path):
    for seed, sizes in ((0, (1, 2)), (1, (1, 2, 5))):
        archive = [kept(size, 100.0 * size) for size in sizes]
        write_run(tmp_path / "sweep" / str(seed), "GE+polish", seed=seed, archive=archive)
    text = write_report(tmp_path / "sweep", None, tmp_path / "out").read_text()
    rows = by_size(tree for run in read_runs(tmp_path / "sweep").runs for tree in run.by_size)
    assert sizes_table(rows).markdown() in text
    assert "so its mean flatters" in text
    (figure,) = re.findall(r"\((figures/[^)]*-sizes\.svg)\)", text)
    assert (tmp_path / "out" / figure).exists()


def test_a_report_that_cannot_be_written_is_told(tmp_path):
    write_run(tmp_path / "sweep" / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtefactError, match="cannot be written"):
        write_report(tmp_path / "sweep", None, tmp_path / "file")
