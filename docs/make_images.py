"""Draws the pictures of the documentation anew: ``python docs/make_images.py`` in the checkout.

Episodes are decided by seeds, so that the pictures change only when the worlds, the planners or
the renderer do.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from aquaquad_envs import make_world_batch  # noqa: E402
from aquaquad_envs.rendering import make_renderer  # noqa: E402
from baselines.optimal import Optimal  # noqa: E402


def draw_episode(path: Path, seed: int, **params: Any) -> str:
    """Save the last picture of an episode of the policy ``optimal``; returns its outcome in words."""
    import pygame

    batch = make_world_batch("drift-hop", 1, **params)
    policy = Optimal(batch)
    batch.reset(seed)
    policy.reset(np.array([seed]))
    renderer = make_renderer(batch, "rgb_array", fps=10)
    picture = renderer.draw(batch.worlds[0])
    while not (batch.terminated | batch.truncated)[0]:
        batch.step(policy.act(batch.observations, batch.worlds))
        picture = renderer.draw(batch.worlds[0])
    assert picture is not None
    pygame.image.save(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), path)
    world = batch.worlds[0]
    outcome = batch.task.outcomes[world["outcome"]]
    return f"{path.relative_to(ROOT)}: {outcome}, {world['flight_wh']:.1f} Wh, {world['time_s'] / 3600:.1f} h"


if __name__ == "__main__":
    folder = ROOT / "docs" / "images"
    folder.mkdir(exist_ok=True)
    print(draw_episode(folder / "vortex.png", seed=0, scenario="vortex"))
    print(draw_episode(folder / "gyres.png", seed=3, scenario="gyres"))
