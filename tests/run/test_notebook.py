"""A run in a notebook has one output, which is drawn anew and does not grow."""

import nbformat
import pytest
from nbclient import NotebookClient

from ge_torchrl.run import notebook
from ge_torchrl.run.notebook import NotebookConsole, NotebookLive
from ge_torchrl.run.progress import print_line

CELL = """
import ge_torchrl as ge
settings = {"ge.generations": 30, "ge.population_size": 40, "evaluation.episodes": 3,
            "evaluation.steps_per_second": 1e8,
            "evaluation.validation_episodes": 20, "evaluation.test_episodes": 20, "archive.episodes": 20}
result = ge.evolve("CartPole-v1", refiner="none", settings=settings)
"""


def outputs_of(*cells):
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    NotebookClient(book, timeout=120, kernel_name="python3").execute()
    return [cell.outputs for cell in book.cells]


def test_a_run_is_one_output_of_a_few_lines():
    shown, silent, result = outputs_of(CELL, CELL.replace("refiner=", "progress=False, refiner="), "result")
    (output,) = shown
    text = output["data"]["text/plain"]
    assert "30 of 30 generations" in text
    assert "best by decision nodes  0: " in text
    assert len(text.splitlines()) < 25
    assert len(str(output)) < 8000
    assert silent == []
    assert "**CartPole-v1, seed 0, GE: " in result[0]["data"]["text/markdown"]


@pytest.fixture
def drawings(monkeypatch):
    class Handle:
        def __init__(self):
            self.drawn = []

        def update(self, bundle, *, raw):
            assert raw
            self.drawn.append(bundle["text/plain"])

    handle = Handle()
    monkeypatch.setattr("IPython.display.display", lambda *_, **__: handle)
    return handle.drawn


def test_it_is_drawn_from_time_to_time_with_the_last_news_above(drawings, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(notebook.time, "monotonic", lambda: now[0])
    live = NotebookLive(NotebookConsole())
    live.start()
    for tenth in range(100):
        now[0] += 0.1
        print_line(live.console, f"news {tenth}")
        live.update(f"generation {tenth}")
    live.stop()
    assert 15 <= len(drawings) <= 22
    assert drawings[-1].splitlines() == ["news 97", "news 98", "news 99", "generation 99"]
