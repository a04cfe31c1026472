"""Rendering through Gymnasium: checkers, videos, windows, pickles, and what is refused."""

import copy
import pickle
import sys
import time
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

pytest.importorskip("pygame")

import pygame
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.rendering import make_renderer

ID = "AquaQuad/DriftHop-v0"


@pytest.fixture
def screen(monkeypatch):
    """A screen that nobody looks at."""
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def batch_of_one():
    batch = aquaquad_envs.make_world_batch("drift-hop", 1)
    batch.reset(0)
    return batch


def test_arrays_need_no_screen():
    pygame.quit()
    env = gymnasium.make(ID, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (720, 640, 3)
    assert not pygame.display.get_init()
    env.close()


def test_gymnasiums_checker(screen):
    env = gymnasium.make(ID, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


def test_record_video(tmp_path):
    pytest.importorskip("moviepy")
    env = RecordVideo(
        gymnasium.make(ID, render_mode="rgb_array", horizon_s=7200.0), str(tmp_path), disable_logger=True
    )
    env.reset(seed=0)
    done = False
    while not done:
        _, _, terminated, truncated, _ = env.step(np.zeros(2, dtype=np.float32))
        done = terminated or truncated
    env.close()
    [video] = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 5000


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copied_env_renders_on_its_own(clone):
    env = gymnasium.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    env.render()
    twin = clone(env)
    for each in (env, twin):
        each.step(np.array([0.0, 0.0], dtype=np.float32))
    fresh = make_renderer(env.batch, "rgb_array", 10).draw(env.batch.worlds[0])
    np.testing.assert_array_equal(twin.render(), fresh)
    assert (env.render() != fresh).any(), "the original still knows where it came from"


def test_discrete_actions(screen):
    env = gymnasium.make(ID, render_mode="rgb_array", action_type="discrete")
    env.reset(seed=0)
    before = env.render()
    env.step(20)
    assert (env.render() != before).any()


def test_window_shows_the_same_picture_and_keeps_the_frame_rate(screen):
    batch = batch_of_one()
    renderer = make_renderer(batch, "human", 8)
    assert renderer.draw(batch.worlds[0]) is None
    began = time.perf_counter()
    for _ in range(4):
        assert renderer.draw(batch.worlds[0]) is None
    assert time.perf_counter() - began > 3.5 / 8
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, make_renderer(batch, "rgb_array", 20).draw(batch.worlds[0]))
    renderer.close()
    assert not pygame.display.get_init()
    renderer.close()


def test_human_env(screen):
    env = gymnasium.make(ID, render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(2, dtype=np.float32))
    assert pygame.display.get_surface().get_size() == (640, 720)
    assert "drift-hop" in pygame.display.get_caption()[0]
    env.close()


def test_closing_the_window_disturbs_nothing(screen):
    env = gymnasium.make(ID, render_mode="human")
    env.reset(seed=0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    for seed in range(3):
        env.step(np.zeros(2, dtype=np.float32))
        assert not pygame.display.get_init(), "a closed window stays closed"
        env.reset(seed=seed)
    env.close()


def test_a_display_that_something_else_quits_disturbs_nothing(screen):
    batch = batch_of_one()
    renderer = make_renderer(batch, "human", 1000)
    renderer.draw(batch.worlds[0])
    pygame.quit()
    assert renderer.draw(batch.worlds[0]) is None
    renderer.close()


def test_no_screen_is_said(monkeypatch):
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "no-such-driver")
    batch = batch_of_one()
    renderer = make_renderer(batch, "human", 10)
    with pytest.raises(InvalidParameterError, match="rgb_array"):
        renderer.draw(batch.worlds[0])
    pygame.display.quit()


def test_missing_pygame_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r"pip install \"aquaquad-envs\[render\]\""):
        make_renderer(batch_of_one(), "rgb_array", 10)


def test_unknown_modes_and_tasks_are_refused():
    with pytest.raises(InvalidParameterError, match="Did you mean 'rgb_array'"):
        make_renderer(batch_of_one(), "rgb_aray", 10)
    with pytest.raises(InvalidParameterError, match="no-such-task"):
        make_renderer(SimpleNamespace(task=SimpleNamespace(name="no-such-task")), "rgb_array", 10)
