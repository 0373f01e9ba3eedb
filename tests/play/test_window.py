"""The window, on SDL's driver without a display."""

import pytest
from documents_for_tests import CONTROLLER
from stages_for_tests import moment_of

from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import UserError
from ge_torchrl.play import playing, window
from ge_torchrl.play.frame import Stage
from ge_torchrl.play.window import check_window, show
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.tree import DecisionTree

pygame = pytest.importorskip("pygame")


@pytest.fixture(autouse=True)
def without_display(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(window.sys, "platform", "linux")


def press(key):
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))


def test_frames_are_shown_until_a_key_is_pressed():
    frame = Stage(CONTROLLER, 7, None).frame(moment_of(CONTROLLER))
    shown = []

    def frames():
        for i in range(3):
            shown.append(i)
            yield frame
        assert tuple(pygame.display.get_surface().get_at((2, 2)))[:3] == frame.getpixel((2, 2))
        press(pygame.K_ESCAPE)

    show(frames(), 1000, "CartPole-v1")
    assert shown == [0, 1, 2]
    assert not pygame.display.get_init()


def test_space_holds_and_closing_ends():
    frame = Stage(CONTROLLER, 7, None).frame(moment_of(CONTROLLER))
    shown = []

    def frames():
        while True:
            shown.append(len(shown))
            if len(shown) == 2:
                press(pygame.K_SPACE)
                pygame.time.set_timer(pygame.QUIT, 30, 1)
            yield frame

    show(frames(), 1000, "CartPole-v1")
    assert shown == [0, 1]


def test_an_environment_that_closes_pygame_does_not_take_the_window_with_it(monkeypatch):
    # Gymnasium's classic control does so at its end; the last frame stays until a key is pressed.
    spec = describe("CartPole-v1", ("x", "x_dot", "theta", "theta_dot"), ("",) * 4, ("left", "right"))
    monkeypatch.setenv("DISPLAY", ":0")
    falling = Controller(DecisionTree.leaf(0), spec.names)
    flips, flip = [], pygame.display.flip

    def counted_flip():
        flip()
        flips.append(None)
        if len(flips) == 40:  # The episode has some ten states.
            press(pygame.K_q)

    monkeypatch.setattr(pygame.display, "flip", counted_flip)
    played = playing.play(falling, spec, seed=7)
    assert played.ended == "ended by the task"
    assert len(flips) == 40


def test_no_display_is_told_with_what_to_type(monkeypatch):
    with pytest.raises(UserError, match=r"no display is there .* --out episode\.gif"):
        check_window()
    monkeypatch.setenv("DISPLAY", ":0")
    check_window()


def test_a_display_that_is_not_there_after_all_is_told(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    monkeypatch.setenv("DISPLAY", ":4711")
    pygame.display.quit()
    with pytest.raises(
        UserError, match=r"^(the window cannot be opened|no display)[^\n]*--out episode\.gif$"
    ):
        show(iter(()), 10, "CartPole-v1")
