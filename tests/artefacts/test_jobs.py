"""What a sweep writes of its jobs is read back, and what somebody else wrote there is refused in a line."""

import json

import pytest

from ge_torchrl.artefacts.jobs import (
    JOB,
    SWEEP,
    Job,
    Sweep,
    find_jobs,
    read_job,
    read_sweep,
    write_job,
    write_sweep,
)
from ge_torchrl.errors import ArtefactError


def test_jobs_come_back(tmp_path):
    job = Job(("env=cartpole", "seed=3"), "abc", "no\tspace left")
    write_job(tmp_path / "3", job)
    write_job(tmp_path / "4", Job(("seed=4",), "abd"))
    assert read_job(tmp_path / "3") == Job(job.words, "abc", "no space left")
    assert [(path.name, found.error) for path, found in find_jobs(tmp_path)] == [
        ("3", "no space left"),
        ("4", None),
    ]
    assert read_job(tmp_path) is None


def test_a_second_sweep_in_a_folder_adds_its_jobs(tmp_path):
    assert read_sweep(tmp_path) is None
    write_sweep(tmp_path, Sweep((("seed=0",), ("seed=1",)), ("-m", "seed=0,1")))
    write_sweep(tmp_path, Sweep((("seed=1",), ("seed=2",)), ("-m", "seed=1,2")))
    assert read_sweep(tmp_path) == Sweep((("seed=0",), ("seed=1",), ("seed=2",)), ("-m", "seed=1,2"))


@pytest.mark.parametrize(
    "text", ["", "[", "3", "{}", '{"jobs": 3, "command": []}', '{"jobs": [[3]], "command": []}']
)
def test_a_damaged_file_of_a_sweep_is_named(tmp_path, text):
    (tmp_path / SWEEP).write_text(text)
    with pytest.raises(ArtefactError, match=SWEEP):
        read_sweep(tmp_path)


@pytest.mark.parametrize("changed", [{"words": "seed=0"}, {"words": [1]}, {"settings": 3}, {"error": ["x"]}])
def test_a_damaged_file_of_a_job_is_named(tmp_path, changed):
    (tmp_path / JOB).write_text(json.dumps({"words": ["seed=0"], "settings": "abc", "error": None} | changed))
    with pytest.raises(ArtefactError, match=JOB):
        read_job(tmp_path)
