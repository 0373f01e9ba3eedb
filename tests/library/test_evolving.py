import pytest
from runs_for_tests import assert_same_bytes

import ge_torchrl as ge
from ge_torchrl.__main__ import main
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.run import experiment, running


def test_a_call_and_the_command_line_give_the_same_bytes(tmp_path, small):
    settings = {**small, "refiner.schedule.generations": [1], "refiner.ppo.max_timesteps": 2000}
    settings |= {"archive.neighbours": 2, "polish.max_timesteps": 5000}
    result = ge.evolve("CartPole-v1", seed=1, settings=settings, out=tmp_path / "called")
    words = [f"{key}={value}" for key, value in settings.items()]
    assert main(["env=cartpole", "seed=1", *words, f"hydra.run.dir={tmp_path / 'typed'}"]) == 0
    assert_same_bytes(tmp_path / "called", tmp_path / "typed", but=("report.html",))
    assert (tmp_path / "called" / "report.html").stat().st_size > 10_000
    assert result.summary.refined > 0
    assert ge.load_run(tmp_path / "typed").champion == result.champion


def test_it_leaves_no_files_unless_asked(tmp_path, monkeypatch, small, capfd):
    monkeypatch.chdir(tmp_path)
    result = ge.evolve("cartpole", refiner="none", settings=small)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", ""), "nobody looks"
    kept = ge.evolve("cartpole", refiner="none", settings=small, out="run")
    assert (tmp_path / "run" / "summary.json").is_file()
    assert kept.champion == result.champion == ge.load("run")
    assert kept.controllers == result.controllers
    assert ge.load("run", nodes=1) == result.controllers[1]
    with pytest.raises(ge.UserError, match="out must be a folder without a run"):
        ge.evolve("cartpole", refiner="none", settings=small, out="run")


class TestCallback:
    def test_it_is_told_of_every_generation_and_may_stop_there(self, small):
        told = []

        def callback(generation):
            told.append(generation)
            return generation.generation == 1

        result = ge.evolve("cartpole", refiner="none", settings=small, callback=callback)
        assert [one.generation for one in told] == [0, 1]
        assert (result.summary.stopped_by, len(result.history)) == ("callback", 2)
        last = told[-1]
        assert last.best == result.history[-1].best
        assert last.champion([0.0, 0.0, 0.1, 0.1]) in (0, 1)
        assert set(last.controllers) == set(range(len(last.controllers)))
        assert all(last.controllers[nodes].decision_nodes == nodes for nodes in last.controllers)
        assert "state" not in repr(last)

    def test_what_it_raises_is_the_users_own(self, small):
        def callback(_):
            raise ZeroDivisionError("mine")

        with pytest.raises(ZeroDivisionError, match=r"^mine$") as raised:
            ge.evolve("cartpole", refiner="none", settings=small, callback=callback)
        assert raised.value.champion([0.0, 0.0, 0.1, 0.1]) in (0, 1)

    def test_it_answers_yes_or_no(self, small):
        with pytest.raises(ge.UserError, match=r"callback must return True to stop, .* got 'stop'"):
            ge.evolve("cartpole", refiner="none", settings=small, callback=lambda _: "stop")
        with pytest.raises(ge.UserError, match="callback must be a function"):
            ge.evolve("cartpole", settings=small, callback=3)


class TestInterrupt:
    def test_it_returns_what_was_found_so_far(self, small):
        def interrupt(generation):
            if generation.generation == 1:
                raise KeyboardInterrupt

        result = ge.evolve("cartpole", refiner="none", settings=small, callback=interrupt)
        assert (result.summary.stopped_by, len(result.history)) == ("interrupt", 2)
        assert result.summary.test_episodes == 40
        assert "stopped by interrupt" in repr(result)

    def test_a_second_one_is_meant(self, small, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(running, "choose", impatient)
        with pytest.raises(KeyboardInterrupt) as raised:
            ge.evolve("cartpole", refiner="none", settings=small)
        assert raised.value.champion.names.id == "CartPole-v1"


@pytest.mark.parametrize("out", [None, "run"])
def test_what_breaks_off_carries_what_was_found(small, monkeypatch, tmp_path, out):
    def broken(*_):
        raise EnvironmentFaultError("CartPole-v1 raised") from ZeroDivisionError("mine")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(running, "choose", broken)
    with pytest.raises(ge.UserError, match="the best tree so far is in ") as raised:
        ge.evolve("cartpole", refiner="none", settings=small, out=out)
    error = raised.value
    assert ("in error.champion, untested" in str(error)) == (out is None)
    assert error.champion([0.0, 0.0, 0.1, 0.1]) in (0, 1)
    assert all(error.controllers[nodes].decision_nodes == nodes for nodes in error.controllers)
    assert len(error.controllers) > 1
    if out:
        assert "ZeroDivisionError: mine" in (tmp_path / out / "traceback.txt").read_text()
        assert str(error).endswith("; details are in run/traceback.txt")


def test_what_breaks_off_before_a_tree_carries_none():
    with pytest.raises(ge.UserError) as raised:
        ge.evolve("CartPole-v7")
    assert raised.value.champion is None
    assert not raised.value.controllers


def test_warnings_go_the_way_of_python_programs(small, monkeypatch, caplog):
    note = "CartPole-v1 is looked at"
    original = experiment.plan

    def noting(config):
        planned = original(config)
        return type(planned)(planned.config, planned.spec, planned.tables, (note,), planned.mirror)

    monkeypatch.setattr(experiment, "plan", noting)
    result = ge.evolve("cartpole", refiner="none", settings=small)
    assert result.summary.warnings == (note,)
    assert note in caplog.text
    assert f"warning: {note}" in repr(result)


@pytest.mark.parametrize(
    ("arguments", "options", "told"),
    [
        (["CartPole-v7"], {}, "env.id must be the id of an installed .* got 'CartPole-v7'"),
        ([], {"settings": {"ge.generation": 3}}, "ge.generation is unknown; .* such as ge.generations"),
        ([], {"seed": -1}, "seed must be an integer of at least 0.*got -1"),
        ([], {"refiner": "pppo"}, "refiner=pppo is unknown; expected one of cmaes, none, ppo, thesis"),
        ([], {"settings": {"logger": "csv"}}, "logger=csv writes beside the files of a run, so expected out"),
        (
            [],
            {"generations": 3},
            r"generations is no argument of evolve, .*settings=\{'ge.generations': 3\}\?$",
        ),
        ([], {"max_seconds": 3}, r"did you mean settings=\{'ge.max_seconds': 3\}\?$"),
        ([], {"refner": "none"}, r"did you mean refiner\?$"),
        (
            [],
            {"xyzzy": 1},
            r"xyzzy is no argument of evolve, which takes environment, seed, .*; got xyzzy=1$",
        ),
        ([lambda: None], {}, "must be the id of one that is registered"),
    ],
)
def test_mistakes_are_told_in_one_line(arguments, options, told):
    with pytest.raises(ge.UserError, match=told) as error:
        ge.evolve(*arguments, **options)
    assert "\n" not in str(error.value)
