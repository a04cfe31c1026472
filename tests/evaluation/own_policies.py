"""Policies that tests hand to the benchmark by name, as users do with their own."""

import time

import numpy as np

from baselines.direct_flight import DirectFlight


class Crash:
    """Fails at its third decision."""

    information = "nothing"

    def __init__(self, batch):
        self.left = 3
        self.num_worlds = batch.num_worlds

    def reset(self, seeds):
        self.left = 3

    def act(self, observations, worlds):
        self.left -= 1
        if not self.left:
            raise RuntimeError("the third decision is too much")
        return np.zeros((self.num_worlds, 2), dtype=np.float32)


class WrongShape(Crash):
    """Forgets a world."""

    def act(self, observations, worlds):
        return np.zeros((self.num_worlds + 1, 2), dtype=np.float32)


class Interrupting(DirectFlight):
    """Presses Ctrl-C."""

    def act(self, observations, worlds):
        raise KeyboardInterrupt


class Sleepy(DirectFlight):
    """Takes a minute over its decision, except in the warm-up world."""

    def act(self, observations, worlds):
        if len(worlds) > 1:
            time.sleep(60)
        return super().act(observations, worlds)


class Worse(DirectFlight):
    """Direct flight with a needless hop there and back first."""

    information = "<b>nothing</b> & more"

    def reset(self, seeds):
        super().reset(seeds)
        self.turn = 0

    def act(self, observations, worlds):
        self.turn += 1
        if self.turn <= 2:
            hop = np.full((len(worlds), 2), 0.2 if self.turn == 1 else -0.2, dtype=np.float32)
            hop[:, 1] *= -1
            return hop
        return super().act(observations, worlds)
