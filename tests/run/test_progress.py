import io
from dataclasses import replace

import pytest
from records_for_tests import generation, proposal, refinement, skipped
from rich.console import Console
from sweeps_for_tests import KEEPING, config

from ge_torchrl.run import progress as progress_module
from ge_torchrl.run.progress import Progress, print_line


class Clock:
    """A clock that stands until it is told to go on."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(progress_module, "time", clock)
    return clock


def console_to(output, *, terminal=False, **changes):
    options = {"width": 100, "color_system": None, "legacy_windows": False}
    return Console(file=output, force_terminal=terminal, **{**options, **changes})


def record(number, best, **changes):
    return generation(number, best, steps=1_000_000, **changes)


def shown(records, generations, *, terminal, settings=None, **options):
    output = io.StringIO()
    settings = settings or config(generations=generations)
    with Progress(console_to(output, terminal=terminal), generations, settings, **options) as progress:
        for one in records:
            progress.show(one)
    return output.getvalue()


def told(records, settings):
    """Return the lines of refinements on plain output."""
    output = io.StringIO()
    with Progress(console_to(output), settings.ge.generations, settings) as progress:
        for one in records:
            progress.show_refinement(one)
    return output.getvalue().splitlines()[1:]


class TestPlainLines:
    def test_they_are_few_and_tell_the_last_generation(self):
        lines = shown([record(g, float(g)) for g in range(240)], 240, terminal=False).splitlines()
        assert lines[0].split() == ["gen", "best", "median", "splits", "steps/s", "left"]
        assert 10 <= len(lines) <= 15
        assert lines[1].split() == ["0", "0.00", "9.40", "2", "2.0", "M", "2:00"]
        assert lines[-1].split() == ["239", "239.00", "9.40", "2", "2.0", "M", "0:00"]

    def test_a_short_run_shows_every_generation_once(self):
        lines = shown([record(g, 1.0) for g in range(3)], 3, terminal=False).splitlines()
        assert [line.split()[0] for line in lines[1:]] == ["0", "1", "2"]

    def test_the_time_left_covers_what_follows_the_search(self):
        output = io.StringIO()
        with Progress(console_to(output), 2, config(generations=2)) as progress:
            progress.show(record(0, 1.0, elapsed_seconds=8.0, evaluation_seconds=7.9), after_search=16.0)
        assert output.getvalue().splitlines()[1].split()[-1] == "0:24"

    def test_a_population_without_any_tree_shows_dashes(self):
        empty = record(0, None, median_fitness=None, mean_fitness=None, best_decision_nodes=None)
        line = shown([empty], 1, terminal=False).splitlines()[1]
        assert line.split()[:4] == ["0", "-", "-", "-"]

    def test_something_is_said_before_the_first_generation_ends(self, clock):
        output = io.StringIO()
        with Progress(console_to(output), 10, config(generations=10)) as progress:
            for second in range(1, 21):
                clock.now += 1.0
                progress.beat(second * 1_500)
        assert output.getvalue().splitlines()[1:] == [
            "generation 0, 7,500 steps of the environment in 0:05",
            "generation 0, 15,000 steps of the environment in 0:10",
            "generation 0, 22,500 steps of the environment in 0:15",
            "generation 0, 30,000 steps of the environment in 0:20",
        ]

    def test_in_between_it_tells_what_goes_on_and_how_long_it_will(self, clock):
        output = io.StringIO()
        with Progress(console_to(output), 10, config(generations=10)) as progress:
            progress.show(record(0, 1.0, elapsed_seconds=6.0, evaluation_seconds=5.9))
            clock.now += 6.0
            progress.beat(2_000_000)
            progress.say("Validating")
            clock.now += 60.0
            progress.beat(3_000_000)
        assert output.getvalue().splitlines()[2:] == [
            "generation 1, 2,000,000 steps of the environment in 0:06, about 0:48 left",
            "Validating",
            "Validating, 3,000,000 steps of the environment in 1:06",
        ]

    def test_a_run_that_goes_on_tells_pace_and_time_left_as_if_it_had_been_left_alone(self, clock):
        pace = {"evaluation_seconds": 1.0, "variation_seconds": 0.0}
        records = [
            generation(number, 1.0, steps=1_000_000, elapsed_seconds=10.0 + 2 * number, **pace)
            for number in range(6)
        ]
        outputs = []
        for before in ([], records[:4]):
            output = io.StringIO()
            with Progress(console_to(output), 8, config(generations=8)) as progress:
                progress.recall(before, after_search=3.0)
                for one in records[len(before) :]:
                    progress.show(one, after_search=3.0)
                clock.now += 2.0
                progress.beat(6_500_000)
                outputs.append((output.getvalue().splitlines(), progress._status()))
        (alone, _), (gone_on, status) = outputs
        assert gone_on[1:] == alone[-2:]
        # Seconds of before are seconds of the run.
        assert status == "generation 6, 6,500,000 steps of the environment in 0:18, about 0:05 left"

    def test_what_is_left_is_known_in_the_last_phases(self, clock):
        output = io.StringIO()
        settings = config(generations=100, max_seconds=60.0)
        with Progress(console_to(output), 100, settings) as progress:
            progress.show(record(1, 1.0, elapsed_seconds=20.0, evaluation_seconds=19.0))
            progress.expect(90.0, elapsed=35.0)
            progress.say("Refining")
            clock.now += 10.0
            progress.beat(2_000_000)
        assert output.getvalue().splitlines()[-1].endswith("about 0:15 left")

    def test_the_row_that_was_held_back_comes_before_what_ends_the_search(self):
        output = io.StringIO()
        with Progress(console_to(output), 240, config(generations=240)) as progress:
            for number in range(6):
                progress.show(record(number, 1.0))
            progress.note("limit")
            progress.say("Validation and test ...")
            progress.end()
        lines = output.getvalue().splitlines()[1:]
        assert [line.split()[0] for line in lines] == ["0", "5", "limit", "Validation"]

    def test_before_the_first_step_kernels_compile(self, clock):
        output = io.StringIO()
        settings = config(generations=10)
        with Progress(console_to(output), 10, settings, compiles=True) as progress:
            for steps in (0, 1_500):
                clock.now += 7.0
                progress.beat(steps)
        assert output.getvalue().splitlines()[1:] == [
            "generation 0, compiling kernels ... 0:07",
            "generation 0, 1,500 steps of the environment in 0:14",
        ]

    def test_a_long_run_says_less_often_but_shows_its_slow_generations(self, clock):
        output = io.StringIO()
        with Progress(console_to(output), 240, config(generations=240)) as progress:
            clock.now += 1000.0
            progress.show(record(1, 1.0))
            clock.now += 40.0
            progress.beat(1)
            progress.show(record(2, 1.0))
            clock.now += 20.0
            progress.show(record(3, 1.0))
        assert [line.split()[0] for line in output.getvalue().splitlines()[1:]] == ["1", "3"]


class TestTerminal:
    def test_it_gets_a_live_table_that_ends_with_the_last_generation(self):
        text = shown([record(g, float(g // 10)) for g in range(50)], 100, terminal=True)
        # The last drawing overwrites the earlier ones.
        final = text[text.rindex("generation ") - 600 :]
        assert "49" in final
        assert "50 of 100 generations" in final

    def test_all_columns_fit_a_narrow_terminal(self):
        output = io.StringIO()
        settings = config("GE+PPO+polish", generations=1000)
        large = {"best_decision_nodes": 15, "refined": 12_345, "polished": 123_456}
        with Progress(console_to(output, terminal=True, width=72), 1000, settings) as progress:
            progress.show(record(998, -1234.56, median_fitness=-1234.56, elapsed_seconds=4e6, **large))
        shown_cells = (
            "gen ",
            "splits",
            "refined",
            "polished",
            "steps/s",
            "left",
            "998",
            "-1234.56",
            "123,456",
        )
        assert all(text in output.getvalue() for text in shown_cells)
        assert "…" not in output.getvalue()

    def test_lines_are_wrapped_between_words(self):
        output = io.StringIO()
        print_line(console_to(output, terminal=True, width=20), "MountainCar-v0, seed 3: 50 generations")
        assert output.getvalue() == "MountainCar-v0, seed\n3: 50 generations\n"
        print_line(console_to(output, width=20), "MountainCar-v0, seed 3: 50 generations")
        assert output.getvalue().endswith("\nMountainCar-v0, seed 3: 50 generations\n")

    def test_it_is_alive_before_the_first_generation_ends(self, clock):
        output = io.StringIO()
        with Progress(console_to(output, terminal=True), 10, config(generations=10)) as progress:
            clock.now += 3.0
            progress.beat(1234)
            assert "generation 0, 1,234 steps of the environment in 0:03" in output.getvalue()

    def test_the_best_kept_tree_of_each_size_stands_below_it(self):
        output = io.StringIO()
        with Progress(console_to(output, terminal=True), 10, config(generations=10)) as progress:
            progress.show(record(0, 1.0), {0: 9.36, 1: 199.18, 2: 500.0})
        assert "best by decision nodes  0: 9.36  1: 199.18  2: 500.00" in output.getvalue()

    def test_a_phase_stands_below_the_table(self):
        output = io.StringIO()
        with Progress(console_to(output, terminal=True), 1, config(generations=1)) as progress:
            progress.show(record(0, 1.0))
            progress.say("Validating")
            assert "Validating, 1,000,000 steps" in output.getvalue()

    def test_on_an_ascii_terminal_nothing_is_drawn_that_it_has_not(self):
        raw = io.BytesIO()
        stream = io.TextIOWrapper(raw, encoding="ascii")
        with Progress(console_to(stream, terminal=True), 10, config(generations=10)) as progress:
            progress.show(record(0, 1.0))
        stream.flush()
        assert b"1 of 10 generations" in raw.getvalue()


BROKEN = refinement(40, outcome="failed", failure="the loss is not finite in update 3", new_best=False)


class TestRefinements:
    def test_they_are_short_lines_named_after_their_method(self):
        records = [
            refinement(40, decision_nodes=2, again=10.04, after=10.14, new_best=False, refine_seconds=10.04),
            refinement(80, chosen="best", decision_nodes=1, again=500.0, after=480.0, new_best=False),
            refinement(120, again=-115.7, after=-110.14, new_best=True),
            proposal(120, origin="neighbour", again=-115.7, after=-110.14),
            proposal(120, origin="archive", again=-115.7, after=-110.14),
            BROKEN,
            skipped(160),
        ]
        assert told(records, config("GE+PPO")) == [
            "generation 40  PPO: random tree of 2 nodes, 10.04 -> 10.14 on unseen episodes, improved, 10.0 s",
            "generation 80  PPO: best tree of 1 node, 500.00 -> 480.00 on unseen episodes, not improved, 1.0 s",
            "generation 120  PPO: random tree of 3 nodes, -115.70 -> -110.14 on unseen episodes, new best, 1.0 s",
            "generation 120  PPO: neighbour of 3 nodes, -115.70 -> -110.14 on unseen episodes, improved, 1.0 s",
            "generation 120  PPO: kept tree of 3 nodes, -115.70 -> -110.14 on unseen episodes, improved, 1.0 s",
            "generation 40  PPO: random tree of 3 nodes kept as it was, the loss is not finite in update 3, 1.0 s",
            "generation 160  PPO: skipped, no tree could be a candidate in 20 redraws",
        ]
        (line,) = told([replace(skipped(160), redraws=0)], config("GE+PPO"))
        assert line == "generation 160  PPO: skipped, no tree could be a candidate"
        (line,) = told(records[:1], config("GE+CMA-ES"))
        assert line.startswith("generation 40  CMA-ES: ")

    @pytest.mark.parametrize(
        ("changes", "shows_all"),
        [
            ({"every": 15}, False),  # 13 generations are due in 200, the last being 195.
            ({"every": 16}, True),
            ({"every": 40, "candidates": 4}, False),
            ({"every": 40, "archive": replace(KEEPING, neighbours=2)}, True),
            ({"every": 40, "archive": replace(KEEPING, neighbours=2, revisit_factor=5)}, False),
        ],
    )
    def test_of_many_only_new_bests_and_failures_are_shown(self, changes, shows_all):
        news = [refinement(15, new_best=True), BROKEN]
        settings = config("GE+PPO", **changes)
        shown_lines = told([*news, refinement(30, new_best=False), skipped(45)], settings)
        assert len(shown_lines) == (4 if shows_all else 2)


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize(
    ("method", "titles"),
    [
        ("GE", []),
        ("GE+PPO", ["refined"]),
        ("GE+polish", ["polished"]),
        ("GE+PPO+polish", ["refined", "polished"]),
    ],
)
def test_trees_are_counted_where_there_will_be_any(method, titles, terminal):
    counted = record(0, 1.0, refined=1111, polished=2222)
    text = shown([counted], 1, terminal=terminal, settings=config(method, generations=1))
    for title, number in (("refined", "1,111"), ("polished", "2,222")):
        assert (title in text) == (number in text) == (title in titles)
