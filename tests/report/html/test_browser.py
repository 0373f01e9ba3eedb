"""Pages in a real browser: nothing is complained of, the player plays, and what is chosen is what is shown."""

import json
import shlex
from base64 import b64encode
from dataclasses import replace

import numpy as np
import pytest
from browser_for_tests import CONTRASTS, chromium, opened
from page_runs_for_tests import N_STEPS, write_played_run
from sweeps_for_tests import CARTPOLE, PRUNED, write_run

from ge_torchrl.environments.pictures import png_of
from ge_torchrl.report.html.writing import write_pages, write_run_page
from ge_torchrl.report.runs import read_runs
from ge_torchrl.trees.controller import Names
from ge_torchrl.trees.tree import DecisionTree

Keys = pytest.importorskip("selenium.webdriver.common.keys").Keys
EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def browser():
    driver = chromium()
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = write_played_run(tmp_path_factory.mktemp("pages") / "run")
    return write_run_page(folder.path)


def names_of(environment):
    features = {
        "Acrobot-v1": "cos_theta1 sin_theta1 cos_theta2 sin_theta2 omega1 omega2",
        "MountainCar-v0": "position velocity",
        "LunarLander-v3": "x y x_dot y_dot theta theta_dot left_leg right_leg",
        "Pendulum-v1": "cos_theta sin_theta theta_dot",
        "MountainCarContinuous-v0": "position velocity",
        "LunarLanderContinuous-v3": "x y x_dot y_dot theta theta_dot left_leg right_leg",
        "Other-v0": f"{EVIL.replace(' ', '')} b c",
    }[environment].split()
    bounds = {"Pendulum-v1": 1, "MountainCarContinuous-v0": 1, "LunarLanderContinuous-v3": 2}.get(
        environment, 0
    )
    actions = tuple("abcd") if not bounds else tuple("uv"[:bounds])
    return Names(
        environment, tuple(features), ("",) * len(features), actions, action_bounds=((-1, 1),) * bounds
    )


def tree_of(names):
    n = len(names.action_bounds)
    if not n:
        return DecisionTree.split(
            0,
            0.1,
            DecisionTree.leaf(0),
            DecisionTree.split(1, 0.0, DecisionTree.leaf(2), DecisionTree.leaf(3)),
        )
    low = DecisionTree.value_leaf([0.5] * n, {1: [-2.0] * n})
    return DecisionTree.weighted_split([0, 1], [1.0, -0.5], 0.1, low, DecisionTree.value_leaf([-0.3] * n))


def text(browser, selector):
    return browser.execute_script("return document.querySelector(arguments[0]).textContent", selector)


def click(browser, selector):
    browser.execute_script(
        "document.querySelector(arguments[0]).dispatchEvent(new MouseEvent('click', {bubbles: true}))",
        selector,
    )


def choose(browser, selector, value):
    browser.execute_script(
        "const s = document.querySelector(arguments[0]); s.value = arguments[1]; s.dispatchEvent(new Event('change'))",
        selector, value,
    )  # fmt: skip


def complaints(browser):
    return [entry for entry in browser.get_log("browser") if entry["level"] != "INFO"]


class TestRun:
    def test_nothing_is_complained_of_and_nothing_is_global(self, browser, page):
        opened(browser, page)
        assert complaints(browser) == []
        assert page.stat().st_size < 300_000
        assert (
            browser.execute_script("return typeof view + typeof watchers + typeof chooseTree")
            == "undefined" * 3
        )

    def test_the_player_steps_as_the_tree_decides(self, browser, page):
        opened(browser, page)
        assert "step 0 of 12" in text(browser, "#moment")
        folder = page.parent
        recorded = json.loads((folder / "episodes.json").read_text())["recorded"]
        (median,) = (one for one in recorded if (one["tree"], one["rank"]) == ("champion", "median"))
        for step in range(N_STEPS):
            answer = CARTPOLE.actions[
                int(PRUNED.decide(np.array([median["observations"][step]], np.float32))[0])
            ]
            assert f"step {step} of 12" in text(browser, "#moment")
            assert answer in text(browser, "#moment")
            assert answer in text(browser, ".node.answer.lit .question")
            click(browser, "#forward")
        assert "the task ended the episode" in text(browser, "#moment")
        assert browser.execute_script("return document.getElementById('forward').disabled")
        click(browser, "#back")
        assert "step 11 of 12" in text(browser, "#moment")
        click(browser, "#to-start")
        assert "step 0 of 12" in text(browser, "#moment")

    def test_it_plays_to_the_end_and_pauses(self, browser, page):
        opened(browser, page)
        label = "return document.getElementById('play').getAttribute('aria-label')"
        choose(browser, "#speed", "0.25")
        click(browser, "#play")
        assert browser.execute_script(label) == "Pause" or "step 12 of 12" in text(browser, "#moment")
        choose(browser, "#speed", "4")
        waited = """const [done] = arguments;
            const look = () => (document.getElementById("forward").disabled ? done(true) : setTimeout(look, 20));
            look();"""
        assert browser.execute_async_script(waited)
        assert "step 12 of 12" in text(browser, "#moment")
        assert browser.execute_script(label) == "Play"

    def test_the_scrubber_goes_to_a_step(self, browser, page):
        opened(browser, page)
        browser.execute_script(
            "const s = document.getElementById('scrub'); s.value = 7; s.dispatchEvent(new Event('input'))"
        )
        assert "step 7 of 12" in text(browser, "#moment")
        assert browser.execute_script("return document.querySelector('.cursor').style.left").startswith(
            "58.3"
        )

    def test_another_episode_is_another_return(self, browser, page):
        opened(browser, page)
        shown = set()
        for button in (1, 2, 3):
            click(browser, f"#episodes button:nth-child({button})")
            shown.add((text(browser, '#episodes [aria-checked="true"]'), text(browser, ".strips .name b")))
        assert {rank for rank, _ in shown} == {"best500.00", "median490.00", "worst100.00"}
        assert len({first for _, first in shown}) == 3

    def test_another_tree_is_drawn_told_and_played(self, browser, page):
        opened(browser, page)
        before = text(browser, "#tree"), text(browser, "#rule"), text(browser, "#tree-told")
        choose(browser, "#tree-choice", "1")
        unpruned = text(browser, "#tree"), text(browser, "#rule"), text(browser, "#tree-told")
        assert "x < 4.8 m ?" in unpruned[0]
        click(
            browser,
            '.point[data-tree="3"]'
            if browser.find_elements("css selector", '.point[data-tree="3"]')
            else ".point",
        )
        by_dot = text(browser, "#tree"), text(browser, "#rule"), text(browser, "#tree-told")
        assert len({before, unpruned, by_dot}) == 3
        assert all(len(set(parts)) == 3 for parts in zip(before, unpruned, by_dot, strict=True))
        assert "median101.00" in text(browser, "#episodes")
        assert complaints(browser) == []

    def test_the_keyboard_does_all_of_it(self, browser, page):
        opened(browser, page)
        body = browser.find_element("tag name", "body")
        body.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
        assert "step 1 of 12" in text(browser, "#moment")
        choose(browser, "#speed", "0.25")
        body.send_keys(Keys.SPACE)
        label = "return document.getElementById('play').getAttribute('aria-label')"
        # A machine that is busy may be slower than the episode.
        assert browser.execute_script(label) == "Pause" or "step 12 of 12" in text(browser, "#moment")
        body.send_keys(Keys.HOME)
        browser.find_element("css selector", '#episodes [aria-checked="true"]').send_keys(Keys.ARROW_RIGHT)
        assert "worst" in text(browser, '#episodes [aria-checked="true"]')
        assert browser.execute_script("return document.activeElement.getAttribute('aria-checked')") == "true"
        point = browser.find_element("css selector", '.point[aria-pressed="false"]')
        point.send_keys(Keys.ENTER)
        assert point.get_attribute("aria-pressed") == "true"
        # Whatever can be clicked can be reached, and has a name.
        nameless = """return [...document.querySelectorAll("button, select, input, [role=button], [role=radio]")]
            .filter((node) => node.tabIndex < 0 && node.getAttribute("role") !== "radio"
                || !(node.getAttribute("aria-label") || node.textContent.trim() || node.closest("label")))
            .map((node) => node.outerHTML)"""
        assert browser.execute_script(nameless) == []

    def test_the_plane_of_two_features_follows_the_choice(self, browser, page):
        opened(browser, page)
        picture = "return document.querySelector('#partition canvas').toDataURL()"
        browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        before = browser.execute_script(picture), text(browser, "#partition-told")
        choose(browser, "#across", "0")
        after = browser.execute_script(picture), text(browser, "#partition-told")
        assert before[0] != after[0]
        assert "whole of it" in before[1]
        assert "theta = " in after[1]

    @pytest.mark.parametrize("colours", ["light", "dark"])
    def test_every_text_can_be_read(self, browser, page, colours):
        opened(browser, page, colours=colours)
        browser.execute_script("document.querySelectorAll('details').forEach((one) => (one.open = true))")
        browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        found = browser.execute_script(CONTRASTS)
        assert len(found) > 100
        assert [one for one in found if one[0] < 4.5] == []

    def test_a_phone_needs_no_scrolling_to_the_side(self, browser, page):
        opened(browser, page, width=360)
        browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 360
        assert complaints(browser) == []


@pytest.mark.parametrize(
    "environment",
    ["Acrobot-v1", "MountainCar-v0", "LunarLander-v3", "Pendulum-v1", "MountainCarContinuous-v0",
     "LunarLanderContinuous-v3", "Other-v0"],
)  # fmt: skip
def test_every_environment_is_drawn_and_moves(browser, tmp_path, environment):
    names = names_of(environment)
    tree = tree_of(names)
    folder = write_played_run(tmp_path / "run", names=names, pruned=tree, full=tree)
    opened(browser, write_run_page(folder.path))
    scene = "return document.querySelector('#scene').innerHTML"
    before = browser.execute_script(scene)
    click(browser, "#forward")
    assert browser.execute_script(scene) != before
    assert "NaN" not in browser.execute_script("return document.body.innerHTML")
    assert complaints(browser) == []
    has_formula = bool(names.action_bounds)
    assert browser.execute_script("return !document.getElementById('formula').hidden") == has_formula
    if environment == "Other-v0":
        assert "<img" in text(browser, "#rule")
        assert browser.execute_script("return [...document.images].map((image) => image.hidden)") == [True]
        assert "drew no picture" in text(browser, "#scene .note")


NUMBERS = Names(
    "plant.py:Cart", ("speed", "current", "load"), ("rad/s", "A", ""), ("u",), action_bounds=((-1, 1),)
)


@pytest.mark.parametrize(
    ("tree", "strips"),
    [
        (DecisionTree.value_leaf([0.5], {1: [-2.0]}), ["current", "u", "reward", "seconds"]),
        (DecisionTree.value_leaf([0.5]), ["speed", "current", "load", "u", "reward", "seconds"]),
    ],
)
def test_strips_show_what_the_rule_reads_and_seconds(browser, tmp_path, tree, strips):
    folder = write_played_run(tmp_path / "run", names=NUMBERS, pruned=tree, full=tree)
    folder.write_episodes(replace(folder.read_episodes(), step_seconds=0.01))
    opened(browser, write_run_page(folder.path))
    shown = "return [...document.querySelectorAll('.strips .name')].map((one) => one.firstChild.textContent)"
    assert browser.execute_script(shown) == strips
    click(browser, "#forward")
    assert "step 1 of 12 (0.01 s)" in text(browser, "#moment")
    ticks = browser.execute_script(
        "return [...document.querySelectorAll('.ticks span')].map((one) => one.textContent)"
    )
    assert ticks[0] == "0"
    assert 0 < float(ticks[-1]) <= 0.12
    # A lone leaf has its dot.
    assert browser.execute_script("return document.querySelectorAll('#archive .dot').length") == 1
    assert complaints(browser) == []


def test_a_lone_leaf_has_a_dot_beside_others(browser, page):
    opened(browser, page)
    point = browser.find_element("css selector", '#archive .point[aria-label^="best with 0 nodes"]')
    inside = """const [dot, svg] = [arguments[0].querySelector(".dot"), document.querySelector("#archive svg")];
        return dot.cx.baseVal.value > 60 && dot.cy.baseVal.value < svg.height.baseVal.value - 44"""
    assert browser.execute_script(inside, point)
    browser.execute_script("arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))", point)
    assert "best with 0 nodes" in text(browser, '#tree-choice option[value="2"]')
    assert point.get_attribute("aria-pressed") == "true"


def test_a_run_that_goes_on_is_shown_without_a_word_of_a_test(browser, tmp_path):
    folder = write_played_run(tmp_path / "run")
    for name in ("summary.json", "episodes.json"):
        (folder.path / name).unlink()
    # Without a checkpoint nothing could go on.
    (folder.path / "checkpoints").mkdir()
    (folder.path / "checkpoints" / "00000003.checkpoint").write_bytes(b"")
    opened(browser, write_run_page(folder.path))
    assert complaints(browser) == []
    assert "Episodes are recorded at the end" in text(browser, "#no-episodes")
    assert "test return" not in text(browser, "main")
    assert "resume" in text(browser, "header")
    assert str(folder.path) in text(browser, "header")


def test_what_is_printed_is_drawn_as_wide_as_paper(browser, page):
    opened(browser, page)
    widths = "return [...document.querySelectorAll('svg.chart')].map((chart) => chart.getAttribute('width'))"
    fire = "dispatchEvent(new Event(arguments[0]))"
    before = browser.execute_script(widths)
    browser.execute_script(fire, "beforeprint")
    assert set(browser.execute_script(widths)) == {"660"}
    browser.execute_script(fire, "afterprint")
    assert browser.execute_script(widths) == before
    assert complaints(browser) == []


def test_pictures_of_an_episode_are_shown_at_their_steps(browser, tmp_path):
    names = names_of("Other-v0")
    folder = write_played_run(tmp_path / "run", names=names, pruned=tree_of(names), full=tree_of(names))
    colours = (np.full((2, 3, 3), shade, np.uint8) for shade in (0, 255))
    first, second = (b64encode(png_of(picture)).decode() for picture in colours)
    episodes = folder.read_episodes()
    drawn = [replace(one, pictures=((0, first), (5, second))) for one in episodes.recorded]
    folder.write_episodes(replace(episodes, recorded=tuple(drawn)))
    opened(browser, write_run_page(folder.path))
    source = "return document.querySelector('#scene img').src"
    shown = []
    for _ in range(7):
        shown.append(browser.execute_script(source).partition("base64,")[2])
        click(browser, "#forward")
    assert shown == [first] * 5 + [second] * 2
    assert browser.execute_script("return document.querySelector('#scene .note').hidden")
    assert complaints(browser) == []


def test_a_run_without_episodes_says_so(browser, tmp_path):
    opened(browser, write_run_page(write_run(tmp_path / "run")))
    assert complaints(browser) == []
    assert "recorded no episodes" in text(browser, "#no-episodes")
    assert browser.execute_script("return document.getElementById('player').hidden")
    assert "theta < 0.0154 rad ?" in text(browser, "#tree")


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_a_sweep_can_be_read_and_leads_to_its_runs(browser, tmp_path, colours):
    for seed in (0, 1):
        write_run(tmp_path / f"{seed}_a", seed=seed, test_mean=480.0 + seed)
    (write_run(tmp_path / "2_b") / "summary.json").unlink()
    opened(browser, write_pages(tmp_path, read_runs(tmp_path)).written, colours=colours)
    assert complaints(browser) == []
    assert [one for one in browser.execute_script(CONTRASTS) if one[0] < 4.5] == []
    click(browser, ".lane a.dot")
    assert "seed 0" in browser.title


def test_long_names_of_runs_widen_no_table(browser, tmp_path):
    for seed in (0, 1):
        name = (
            f"{seed}_env=acrobot,ge.generations=66,grammar.splits=oblique,evaluation.episodes=40,seed={seed}"
        )
        write_run(tmp_path / name, seed=seed)
    page = write_pages(tmp_path, read_runs(tmp_path)).written
    narrow = (
        "return [...document.querySelectorAll('.scroll')].every((one) => one.scrollWidth <= one.clientWidth)"
    )
    assert opened(browser, page).execute_script(narrow)
    opened(browser, page, width=390)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    names = "[...document.querySelectorAll('td .folder, caption span')]"
    assert browser.execute_script(f"return Math.max(...{names}.map((one) => one.clientWidth))") <= 390


def test_the_command_that_runs_it_again_names_the_folder_of_the_page(browser, tmp_path):
    folder = tmp_path / "it's 3_env=cartpole,seed=3"
    opened(browser, write_run_page(write_run(folder, seed=3)))
    told = text(browser, "#again")
    assert shlex.split(told) == [
        "python", "-m", "ge_torchrl", "--config-path", str(folder), "--config-name", "config",
    ]  # fmt: skip
    assert "RUN_FOLDER" not in text(browser, "main")
