"""A run that was killed anywhere goes on, and ends as the run left alone (law 8)."""

import io
import json
import shutil

import pytest
from rich.console import Console
from runs_for_tests import assert_same_bytes, config, run, without_clock

from ge_torchrl.artefacts.checkpoints import CHECKPOINTS
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.artefacts.journal import Journal
from ge_torchrl.artefacts.locks import LOCK
from ge_torchrl.errors import ArtefactError
from ge_torchrl.run import checkpointing, experiment, running

GENERATIONS = 8
REFINED = {
    "ge": {"generations": GENERATIONS, "population_size": 20, "restarts": 1},
    "evaluation": {"episodes": 3, "validation_episodes": 10, "test_episodes": 10},
    "refiner": {"method": "cmaes", "schedule": {"every": 2}, "acceptance_episodes": 3, "min_nodes": 1},
    "polish": {"max_timesteps": 1000, "every": 1, "episodes": 3},
    "archive": {
        "keep": 2, "episodes": 5, "neighbours": 2, "neighbours_drawn": 5, "revisit_factor": 2, "migrants": 2,
        "final_keep": 1, "final_factor": 2,
    },
}  # fmt: skip


class KilledError(BaseException):
    """What no code of a run answers to: as when the process is gone."""


@pytest.fixture(autouse=True)
def after_every_generation(monkeypatch):
    monkeypatch.setattr(checkpointing, "_TIMES", 0)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The run left alone."""
    folder = tmp_path_factory.mktemp("alone") / "run"
    run(config(**REFINED), folder)
    return folder


def killed(folder, where, at, settings=None, what=running):
    """Run until a function of a module is called for the n-th time, and let nothing happen from there on."""
    original, calls = getattr(what, where), []

    def dying(*args, **more):
        calls.append(1)
        if len(calls) > at:
            raise KilledError
        return original(*args, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(what, where, dying)
        with pytest.raises(KilledError):
            run(config(**REFINED) if settings is None else settings, folder)
    assert not (folder / "summary.json").exists()


def resume(folder):
    output = io.StringIO()
    summary = experiment.resume(folder, Console(file=output, width=200))
    return summary, output.getvalue()


class TestGoesOn:
    @pytest.mark.parametrize("generation", [1, 2, 5, GENERATIONS - 1])
    def test_in_any_generation(self, alone, tmp_path, generation):
        killed(tmp_path / "run", "generation_record", generation)
        _, output = resume(tmp_path / "run")
        assert f"Going on after generation {generation - 1}" in output
        assert "\nonce more   kept trees of " in output
        assert_same_bytes(alone, tmp_path / "run")

    @pytest.mark.parametrize(
        "part", ["refine_once_more", "choose", "examine", "write_verdict", "keep_episodes"]
    )
    def test_in_any_part_of_the_conclusion(self, alone, tmp_path, part):
        killed(tmp_path / "run", part, 0)
        resume(tmp_path / "run")
        assert_same_bytes(alone, tmp_path / "run")

    def test_before_its_first_checkpoint_it_begins_anew(self, alone, tmp_path):
        killed(tmp_path / "run", "generation_record", 0)
        resume(tmp_path / "run")
        assert_same_bytes(alone, tmp_path / "run")

    def test_again_and_again(self, alone, tmp_path):
        folder, original = tmp_path / "run", running.generation_record
        killed(folder, "generation_record", 1)
        for _ in range(GENERATIONS - 2):
            calls = []

            def dying(*args, calls=calls):
                calls.append(1)
                if len(calls) > 1:
                    raise KilledError
                return original(*args)

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(running, "generation_record", dying)
                with pytest.raises(KilledError):
                    resume(folder)
        resume(folder)
        assert_same_bytes(alone, folder)

    def test_where_the_last_checkpoint_is_some_generations_old(self, alone, tmp_path, monkeypatch):
        monkeypatch.setattr(checkpointing, "_TIMES", 1e9)
        killed(tmp_path / "run", "generation_record", 5)
        _, output = resume(tmp_path / "run")
        assert "Going on after generation 0" in output
        assert_same_bytes(alone, tmp_path / "run")

    def test_where_validation_was_asked_whether_it_is_solved(self, tmp_path):
        settings = config(
            env={"solved_at": 40},
            ge={"stop_when_solved": True, "generations": 30},
            evaluation={"episodes": 1, "validation_episodes": 30},
        )
        summary, _ = run(settings, tmp_path / "alone")
        assert summary.stopped_by == "solved"
        assert summary.steps["asking validation"] > 0
        for generation in range(1, summary.generations):
            folder = tmp_path / str(generation)
            killed(folder, "generation_record", generation, settings)
            resume(folder)
            assert_same_bytes(tmp_path / "alone", folder)

    def test_where_steps_are_limited(self, tmp_path):
        limited = config(**{**REFINED, "ge": {**REFINED["ge"], "max_env_steps": 400_000, "generations": 50}})
        summary, _ = run(limited, tmp_path / "alone")
        assert summary.stopped_by == "max_env_steps"
        for generation in (1, 2):
            killed(tmp_path / str(generation), "generation_record", generation, limited)
            resume(tmp_path / str(generation))
            assert_same_bytes(tmp_path / "alone", tmp_path / str(generation))

    def test_of_a_process_killed_on_its_last_steps_nothing_stays(self, alone, tmp_path):
        folder = tmp_path / "run"
        shutil.copytree(alone, folder)
        (folder / LOCK).write_text("999999\n")
        (folder / "report.html").unlink()
        assert resume(folder)[0] is None
        assert_same_bytes(alone, folder)


class TestInterrupted:
    """What Ctrl-C ended is tested, and can go on all the same."""

    def test_it_goes_on(self, alone, tmp_path, monkeypatch):
        folder, original = tmp_path / "run", running.Progress.show

        def interrupted(self, record, *more):
            original(self, record, *more)
            if record.generation == 4:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(running.Progress, "show", interrupted)
            summary, output = run(config(**REFINED), folder)
        assert summary.stopped_by == "interrupt"
        assert f"ge-torchrl resume {folder}" in output
        summary, output = resume(folder)
        assert summary.stopped_by == "generations"
        assert "ge-torchrl resume" not in output
        assert_same_bytes(alone, folder)

    def test_in_the_conclusion(self, alone, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(running, "refine_once_more", impatient)
            run(config(**REFINED), tmp_path / "run")
        resume(tmp_path / "run")
        assert_same_bytes(alone, tmp_path / "run")


class TestOnDisk:
    def test_trees_can_be_read_while_the_run_goes_on(self, tmp_path):
        killed(tmp_path / "run", "generation_record", 3)
        folder = RunFolder(tmp_path / "run")
        assert folder.read_best_tree().provenance["test_mean"] is None
        for record in folder.read_archive():
            assert (
                folder.read_archive_tree(record.decision_nodes).tree.num_decision_nodes
                == record.decision_nodes
            )
        assert len(folder.read_history()) == 3

    def test_two_checkpoints_are_kept_and_none_at_the_end(self, alone, tmp_path):
        killed(tmp_path / "run", "generation_record", 4)
        names = sorted(path.name for path in (tmp_path / "run" / CHECKPOINTS).iterdir())
        assert names == ["00000002.checkpoint", "00000003.checkpoint"]
        assert not (alone / CHECKPOINTS).exists()
        assert not (alone / ".lock").exists()


class TestRefused:
    def test_a_finished_run_has_nothing_to_go_on_with(self, alone):
        before = {path: path.read_bytes() for path in alone.rglob("*") if path.is_file()}
        assert resume(alone) == (None, "")
        assert before == {path: path.read_bytes() for path in alone.rglob("*") if path.is_file()}

    def test_a_run_that_another_process_runs(self, tmp_path):
        killed(tmp_path / "run", "generation_record", 2)
        held = Journal.reopen(tmp_path / "run")
        with pytest.raises(ArtefactError, match=r"no other process.*goes on in process \d+"):
            resume(tmp_path / "run")
        held.release()
        resume(tmp_path / "run")

    def test_a_folder_without_a_run(self, tmp_path):
        with pytest.raises(ArtefactError, match=r"expected the folder of a run; .*none is not there"):
            resume(tmp_path / "none")
        with pytest.raises(
            ArtefactError, match=r"must be the folder of one run, which holds config\.yaml; it holds no run"
        ):
            resume(tmp_path)
        assert list(tmp_path.iterdir()) == []
        (tmp_path / "sweep.json").write_text("{}")
        with pytest.raises(
            ArtefactError, match=r"ge-torchrl status .* tells which runs of the sweep are not done"
        ):
            resume(tmp_path)

    def test_a_long_run_without_checkpoints(self, tmp_path):
        killed(tmp_path / "run", "generation_record", 3)
        shutil.rmtree(tmp_path / "run" / CHECKPOINTS)
        before = (tmp_path / "run" / "history.jsonl").read_bytes()
        with pytest.raises(ArtefactError, match=r"must hold a checkpoint to go on from; it holds none, nor"):
            resume(tmp_path / "run")
        assert (tmp_path / "run" / "history.jsonl").read_bytes() == before


@pytest.fixture(scope="module")
def broken_off(tmp_path_factory):
    """A run that was killed after its fifth generation."""
    folder = tmp_path_factory.mktemp("broken") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpointing, "_TIMES", 0)
        killed(folder, "generation_record", 5)
    return folder


def truncated(content):
    return content[: len(content) * 2 // 3]


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def names_of(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def refused(folder):
    """Go on with a run; return the error that refuses it, or None."""
    try:
        resume(folder)
    except ArtefactError as error:
        return str(error)
    return None


class TestDamaged:
    """Each file of a run's folder, cut, with a bit flipped, and gone: recovered, or refused by its name."""

    @pytest.mark.parametrize("damage", [truncated, flipped, None])
    def test_every_file(self, alone, broken_off, tmp_path, damage, tried):
        names, lost = names_of(broken_off), []
        for number, name in enumerate(names):
            folder = tmp_path / str(number)
            shutil.copytree(broken_off, folder)
            if damage is None:
                (folder / name).unlink()
            else:
                (folder / name).write_bytes(damage((folder / name).read_bytes()))
            refusal = refused(folder)
            if refusal is None:
                assert_same_bytes(alone, folder)
            elif (
                name not in ("config.yaml", "history.jsonl", "refinements.jsonl")
                or str(folder / name) not in refusal
            ):
                lost.append(refusal)
        tried("damages of the files of a run that was broken off", len(names), len(lost))
        assert not lost

    def test_a_torn_tail_is_cut(self, alone, broken_off, tmp_path):
        shutil.copytree(broken_off, tmp_path / "run")
        for name in ("history.jsonl", "refinements.jsonl"):
            with (tmp_path / "run" / name).open("a") as file:
                file.write('{"generation": 5, "outc')
        assert len(RunFolder(tmp_path / "run").read_history()) == 5
        resume(tmp_path / "run")
        assert_same_bytes(alone, tmp_path / "run")

    def test_both_checkpoints(self, broken_off, tmp_path):
        shutil.copytree(broken_off, tmp_path / "run")
        files = sorted((tmp_path / "run" / CHECKPOINTS).iterdir())
        for path in files:
            path.write_bytes(flipped(path.read_bytes()))
        with pytest.raises(ArtefactError, match=r"00000004\.checkpoint is damaged: its SHA-256"):
            resume(tmp_path / "run")

    def test_a_checkpoint_of_another_version(self, broken_off, tmp_path):
        shutil.copytree(broken_off, tmp_path / "run")
        for path in (tmp_path / "run" / CHECKPOINTS).iterdir():
            path.write_bytes(path.read_bytes().replace(b" 0.", b" 9.", 1))
        with pytest.raises(ArtefactError, match="another version may go on in another way"):
            resume(tmp_path / "run")

    def test_a_line_in_the_middle_of_the_history_tells_that_it_is_damaged(self, alone, tmp_path):
        path = tmp_path / "history.jsonl"
        lines = (alone / "history.jsonl").read_text().splitlines(keepends=True)
        values = json.loads(lines[3])
        lines[3] = json.dumps({**values, "env_steps": values["env_steps"] + 1}) + "\n"
        path.write_text("".join(lines))
        with pytest.raises(ArtefactError, match=r"history\.jsonl:4 is damaged: its crc32"):
            RunFolder(tmp_path).read_history()
        assert without_clock(alone / "history.jsonl")


def test_code_that_a_run_of_somebody_elses_names_does_not_run_unless_the_user_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "downloaded_environment.py").write_text("raise SystemExit")
    settings = config(env={"id": "downloaded_environment:Cart-v0"})
    RunFolder.create(tmp_path / "run", settings).release()
    with pytest.raises(ArtefactError, match="names code that would run here, downloaded_environment"):
        resume(tmp_path / "run")
