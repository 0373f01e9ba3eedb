"""What a run leaves that was interrupted, or that a fault broke off."""

import io
import re

import pytest
from rich.console import Console
from runs_for_tests import assert_untested, config, run

from ge_torchrl import interrupts
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.errors import EnvironmentFaultError, GrammarError, RunFaultError
from ge_torchrl.run import experiment, running


class TestInterrupt:
    @staticmethod
    def interrupt_in(monkeypatch, generation):
        original = running.Progress.show

        def interrupted(self, record, *more):
            original(self, record, *more)
            if record.generation == generation:
                raise KeyboardInterrupt

        monkeypatch.setattr(running.Progress, "show", interrupted)

    def test_it_keeps_and_tests_what_was_found(self, tmp_path, monkeypatch):
        self.interrupt_in(monkeypatch, 4)
        summary, output = run(config(), tmp_path / "run")
        assert (summary.stopped_by, summary.generations) == ("interrupt", 5)
        assert len(RunFolder(tmp_path / "run").read_history()) == 5
        assert re.search(r"stopped by +interrupt", output)
        assert "Ctrl-C again leaves it untested" in output

    def test_a_second_one_leaves_the_best_tree_and_the_archive_untested(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(running, "choose", impatient)
        with pytest.raises(KeyboardInterrupt):
            run(config(), tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))

    def test_where_nobody_reads_any_more_what_was_found_is_kept_and_nothing_is_called_broken(self, tmp_path):
        class Closed(io.StringIO):
            def write(self, text):
                if text.startswith("    3 "):
                    raise BrokenPipeError
                return super().write(text)

        class ClosedConsole(Console):
            def on_broken_pipe(self):
                self.quiet = True
                raise BrokenPipeError

        with pytest.raises(BrokenPipeError):
            experiment.run(config(), tmp_path / "run", ClosedConsole(file=Closed(), width=100))
        assert_untested(RunFolder(tmp_path / "run"))
        assert not (tmp_path / "run" / "traceback.txt").exists()

    def test_in_the_last_refinement_it_goes_on_with_what_was_there(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(running, "refine_once_more", impatient)
        settings = config(
            ge={"generations": 2}, polish={"every": 1, "max_timesteps": 5000}, archive={"final_keep": 1}
        )
        summary, output = run(settings, tmp_path / "run")
        assert (summary.stopped_by, summary.generations) == ("generations", 2)
        assert "Ctrl-C again leaves it untested" in output

    def test_where_the_main_thread_does_not_hear_of_it_there_are_last_words(self, tmp_path, monkeypatch):
        original, said = running.Progress.show, []

        def asked(self, record, *more):
            original(self, record, *more)
            if record.generation == 3:
                said.append(interrupts._saved())
                assert_untested(RunFolder(tmp_path / "run"))

        monkeypatch.setattr(running.Progress, "show", asked)
        run(config(ge={"generations": 5}), tmp_path / "run")
        run_folder = tmp_path / "run"
        assert said == [
            f"the best tree so far is in {run_folder}, untested; ge-torchrl resume {run_folder} goes on"
        ]
        assert interrupts._saved() == "nothing was saved"

    def test_before_the_first_generation_there_is_nothing_to_keep(self, tmp_path, monkeypatch):
        def impatient(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(running.Search, "run", impatient)
        with pytest.raises(KeyboardInterrupt):
            run(config(), tmp_path / "run")
        assert {path.name for path in (tmp_path / "run").iterdir()} == {"config.yaml", "history.jsonl"}


class TestFault:
    @staticmethod
    def break_in(monkeypatch, generation, fault):
        original = running.Progress.show

        def breaking(self, record, *more):
            original(self, record, *more)
            if record.generation == generation:
                raise fault

        monkeypatch.setattr(running.Progress, "show", breaking)

    def test_a_fault_of_the_environment_keeps_the_best_tree_and_the_archive(self, tmp_path, monkeypatch):
        self.break_in(monkeypatch, 3, EnvironmentFaultError("CartPole-v1 raised OSError(),\nand what not"))
        with pytest.raises(EnvironmentFaultError) as raised:
            run(config(), tmp_path / "run")
        text = str(raised.value)
        assert re.fullmatch(
            r"CartPole-v1 raised OSError\(\), and what not; the best tree so far is in .*run, untested; .*",
            text,
        )
        assert len(RunFolder(tmp_path / "run").read_history()) == 4
        assert_untested(RunFolder(tmp_path / "run"))

    @pytest.mark.parametrize("fault", [ZeroDivisionError("a bug\nof ours"), MemoryError()])
    def test_a_bug_does_too_and_says_where_its_details_are(self, tmp_path, monkeypatch, fault):
        self.break_in(monkeypatch, 3, fault)
        with pytest.raises(RunFaultError) as raised:
            run(config(), tmp_path / "run")
        text = str(raised.value)
        assert "\n" not in text
        assert re.search(
            rf"broke off \({type(fault).__name__}: ?.*\); the best tree .* untested; .*; details are in .*",
            text,
        )
        trace = tmp_path / "run" / "traceback.txt"
        assert str(trace) in text
        assert "in breaking" in trace.read_text()
        assert_untested(RunFolder(tmp_path / "run"))

    @pytest.mark.parametrize("phase", ["choose", "examine", "refine_once_more"])
    def test_whatever_the_phase(self, tmp_path, monkeypatch, phase):
        def broken(*_):
            raise RuntimeError(phase)

        monkeypatch.setattr(running, phase, broken)
        settings = config(
            ge={"generations": 3}, polish={"every": 1, "max_timesteps": 2000}, archive={"final_keep": 1}
        )
        with pytest.raises(RunFaultError, match=rf"RuntimeError: {phase}.*untested"):
            run(settings, tmp_path / "run")
        assert_untested(RunFolder(tmp_path / "run"))

    def test_before_the_first_tree_that_is_said(self, tmp_path, monkeypatch):
        def broken(*_):
            raise RuntimeError("early")

        monkeypatch.setattr(running.Search, "run", broken)
        with pytest.raises(RunFaultError, match="no tree was there yet"):
            run(config(), tmp_path / "run")

    def test_genotypes_too_short_for_the_grammar_are_explained(self, tmp_path):
        with pytest.raises(
            GrammarError, match=r"no genotype of 2 codons gave a tree.*ge\.genotype_length"
        ) as raised:
            run(config(ge={"genotype_length": 2}), tmp_path / "run")
        assert "\n" not in str(raised.value)
