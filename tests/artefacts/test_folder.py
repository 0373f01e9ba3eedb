"""The folder of a run: what is written comes back, and nobody ever reads a half of it."""

import json
import math
import os
from dataclasses import replace

import pytest
import yaml
from configs_for_tests import config_with
from hypothesis import given, settings
from hypothesis import strategies as st
from records_for_tests import generation, history, kept, refinement, skipped, summary
from sweeps_for_tests import FULL, PRUNED, chain, config, controller

from ge_torchrl.artefacts import texts
from ge_torchrl.artefacts.folder import RunFolder, find_runs
from ge_torchrl.artefacts.lines import RecordWriter, checked_values, read_records, to_json
from ge_torchrl.artefacts.records import ArchiveRecord, GenerationRecord, RefinementRecord
from ge_torchrl.artefacts.texts import write_whole
from ge_torchrl.errors import ArtefactError, ConfigError, InvalidTreeError

ARCHIVE = [(kept(size, 100.0 * size), controller(chain(size))) for size in (0, 1, 3)]


@pytest.fixture
def folder(tmp_path):
    made = RunFolder.create(tmp_path / "deep" / "run", config("GE+PPO+polish", seed=3))
    made.release()
    return made


def write_lines(writer, records):
    with writer as opened:
        for record in records:
            opened.write(record)


def files(folder):
    return {str(path.relative_to(folder.path)) for path in folder.path.rglob("*") if path.is_file()}


class TestThereAndBack:
    def test_configuration(self, folder):
        assert folder.read_config() == config("GE+PPO+polish", seed=3)
        measured = replace(
            folder.read_config(), evaluation=replace(folder.read_config().evaluation, steps_per_second=2e6)
        )
        folder.write_config(measured)
        assert folder.read_config() == measured

    def test_history_and_refinements(self, folder):
        generations = history([None, 9.0, 500.0], [None, None, 499.5])
        refinements = [refinement(1), skipped(2)]
        write_lines(folder.history_writer(), generations)
        write_lines(folder.refinements_writer(), refinements)
        assert folder.read_history() == generations
        assert folder.read_refinements() == refinements

    def test_trees(self, folder):
        folder.write_trees(controller(PRUNED), controller(FULL), "±\n")
        assert folder.read_best_tree() == controller(PRUNED)
        assert folder.read_best_tree_full() == controller(FULL)
        assert (folder.path / "best_tree.txt").read_text(encoding="utf-8") == "±\n"

    def test_summary(self, folder):
        found = summary(steps={"fitness": 3, "test": 4}, warnings=("one", "two"), solved=None)
        folder.write_summary(found)
        assert folder.read_summary() == found
        assert json.loads((folder.path / "summary.json").read_text())["env_steps_total"] == 7

    def test_archive(self, folder):
        assert folder.read_archive() == []
        folder.write_archive(ARCHIVE)
        assert folder.read_archive() == [record for record, _ in ARCHIVE]
        for record, tree in ARCHIVE:
            assert folder.read_archive_tree(record.decision_nodes) == tree

    def test_an_archive_that_nothing_has_tested_yet(self, folder):
        untested = kept(1, 9.0, validation_mean=9.0, test_std=None, archive_mean=50.0)
        untested = replace(untested, validation_mean=None, test_mean=None)
        folder.write_archive([(untested, controller(chain(1)))])
        assert folder.read_archive() == [untested]


class TestWritingAgain:
    def test_what_is_written_again_replaces_what_was_there(self, folder):
        folder.write_trees(controller(FULL), controller(FULL), "a\n")
        folder.write_trees(controller(PRUNED), controller(FULL), "b\n")
        folder.write_archive(ARCHIVE)
        folder.write_archive([(kept(1, 250.0), controller(chain(1)))])
        assert folder.read_best_tree().tree == PRUNED
        assert [record.test_mean for record in folder.read_archive()] == [250.0]
        assert files(folder) == {
            "config.yaml",
            "best_tree.json",
            "best_tree_full.json",
            "best_tree.txt",
            "archive.jsonl",
            "archive/01.json",
        }

    def test_an_end_in_the_middle_leaves_the_former_tree(self, folder, monkeypatch):
        folder.write_trees(controller(PRUNED), controller(FULL), "a\n")

        def half(descriptor, content):
            os.write(descriptor, content[:1])
            raise KeyboardInterrupt

        monkeypatch.setattr(texts, "put", half)
        with pytest.raises(KeyboardInterrupt):
            folder.write_trees(controller(FULL), controller(FULL), "b\n")
        assert folder.read_best_tree().tree == PRUNED

    @given(st.text(max_size=20), st.text(max_size=20))
    def test_a_file_is_the_former_or_the_new_one(self, tmp_path_factory, former, new):
        path = tmp_path_factory.mktemp("whole") / "file"
        for text in (former, new):
            write_whole(path, lambda beside, text=text: beside.write_bytes(text.encode()))
            assert path.read_bytes() == text.encode()
            assert [found.name for found in path.parent.iterdir()] == ["file"]


class TestMistakes:
    def test_a_folder_with_a_run_is_refused(self, folder):
        write_lines(folder.history_writer(), [generation(0, 1.0)])
        with pytest.raises(ArtefactError, match=r"hydra\.run\.dir must be a folder without a run"):
            RunFolder.create(folder.path, config())

    def test_a_path_that_cannot_be_written_is_told(self, tmp_path, folder):
        (tmp_path / "file").write_text("")
        with pytest.raises(ArtefactError, match="cannot be written"):
            RunFolder.create(tmp_path / "file" / "run", config())
        (folder.path / "summary.json").mkdir()
        with pytest.raises(ArtefactError, match=r"summary\.json cannot be written"):
            folder.write_summary(summary())

    def test_a_configuration_of_before_is_read_without_what_is_gone(self, folder):
        path = folder.path / "config.yaml"
        values = yaml.safe_load(path.read_text())
        values["refiner"] |= {"best_probability": 0.3, "ppo": values["refiner"]["ppo"] | {"leaf_sd": 0.2}}
        config = folder.read_config()
        path.write_text(yaml.safe_dump(values))
        assert folder.read_config() == config
        path.write_text(yaml.safe_dump(values | {"refiner": {"often": 3}}))
        with pytest.raises(ConfigError, match=r"refiner\.often is unknown"):
            folder.read_config()

    def test_what_is_missing_is_named(self, tmp_path):
        nothing = RunFolder(tmp_path)
        for read, name in (
            (nothing.read_config, "config.yaml"),
            (nothing.read_history, "history.jsonl"),
            (nothing.read_refinements, "refinements.jsonl"),
            (nothing.read_summary, "summary.json"),
            (nothing.read_best_tree, "best_tree.json"),
        ):
            with pytest.raises(ArtefactError, match=name):
                read()

    def test_what_is_broken_is_named(self, folder):
        for name, text in (("config.yaml", "a: ["), ("history.jsonl", "\n")):
            (folder.path / name).write_text(text)
        with pytest.raises(ArtefactError, match=r"config\.yaml is not YAML"):
            folder.read_config()
        with pytest.raises(ArtefactError, match=r"history\.jsonl:1 is not JSON"):
            folder.read_history()
        (folder.path / "config.yaml").write_text("seed: -1")
        with pytest.raises(ConfigError):
            folder.read_config()
        (folder.path / "best_tree.json").write_text("{")
        with pytest.raises(InvalidTreeError):
            folder.read_best_tree()
        (folder.path / "archive.jsonl").write_text("{}\n")
        with pytest.raises(ArtefactError, match=r"archive\.jsonl:1 .* ArchiveRecord; missing"):
            folder.read_archive()
        (folder.path / "archive.jsonl").write_bytes(b"\xff\n")
        with pytest.raises(ArtefactError, match="not text in UTF-8"):
            folder.read_archive()
        (folder.path / "summary.json").write_text("{")
        for read in (folder.read_summary, folder.read_archive):
            with pytest.raises(ArtefactError, match=r"summary\.json is not JSON"):
                read()

    def test_sizes_that_the_archive_lacks(self, folder):
        with pytest.raises(ArtefactError, match=r"must hold an archive, as archive\.keep above 0 makes it"):
            folder.read_archive_tree(2)
        folder.write_archive(ARCHIVE)
        with pytest.raises(ArtefactError, match=r"must be one of 0, 1, 3, because the archive of .*; got 2"):
            folder.read_archive_tree(2)


class TestLines:
    def test_each_record_is_on_disk_when_it_is_written(self, tmp_path):
        path = tmp_path / "lines.jsonl"
        with RecordWriter(path) as writer:
            writer.write(generation(0, 9.0))
            assert read_records(GenerationRecord, path) == [generation(0, 9.0)]

    def test_a_file_that_cannot_be_written_is_told(self, tmp_path):
        with pytest.raises(ArtefactError, match="cannot be written"), RecordWriter(tmp_path / "no" / "lines"):
            pass

    def test_records_are_written_inside_a_with_statement(self, tmp_path):
        with pytest.raises(ValueError, match="with statement"):
            RecordWriter(tmp_path / "lines.jsonl").write(generation(0, 9.0))

    def test_a_field_with_a_default_may_be_younger_than_the_file(self, tmp_path):
        path = tmp_path / "lines.jsonl"
        path.write_text('{"generation": 4, "outcome": "skipped", "forgotten": 1}\n')
        assert read_records(RefinementRecord, path) == [RefinementRecord(4, "skipped")]

    def test_another_kind_of_json_is_no_record(self, tmp_path):
        path = tmp_path / "lines.jsonl"
        path.write_text("[]\n")
        with pytest.raises(ArtefactError, match="must be a JSON object"):
            read_records(ArchiveRecord, path)

    @given(st.floats() | st.none())
    def test_numbers_come_back_and_what_json_lacks_as_null(self, value):
        told = json.loads(to_json(refinement(soft_return=value)))["soft_return"]
        assert told == (value if value is not None and math.isfinite(value) else None)


def test_finished_runs_are_found_at_any_depth(tmp_path):
    for name in ("b/2", "a", "b/1"):
        RunFolder.create(tmp_path / name, config()).write_summary(summary())
    RunFolder.create(tmp_path / "unfinished", config())
    assert [found.path for found in find_runs(tmp_path)] == [tmp_path / name for name in ("a", "b/1", "b/2")]


@settings(max_examples=300)
@given(st.text(st.sampled_from("ab <>|:=#-'\"\\\n\t\r\u0085\u2028é"), min_size=1).filter(str.strip))
def test_the_text_of_a_grammar_is_read_back_as_it_was(tmp_path_factory, text):
    given_one = config_with("grammar", "bnf", text)
    folder = RunFolder(tmp_path_factory.mktemp("run"))
    folder.write_config(given_one)
    assert folder.read_config() == given_one


def test_a_grammar_is_written_as_a_block_of_lines(tmp_path):
    bnf = "<dt> ::= <if>\n<if> ::= if lt(x, [0, 1] step 1) then left else right\n"
    RunFolder(tmp_path).write_config(config_with("grammar", "bnf", bnf))
    assert "  bnf: |\n    <dt> ::= <if>\n    <if> ::= if lt(" in (tmp_path / "config.yaml").read_text()


def test_a_summary_that_was_changed_says_what_to_remove():
    changed = '{"test_mean": 500.0, "sha256": {}, "crc32": "00000000"}'
    with pytest.raises(
        ArtefactError, match=r"is damaged.*; where the change is yours, remove its keys sha256 and crc32"
    ):
        checked_values(changed, "run/summary.json")
