"""Standard views of a batch of worlds: Gymnasium, vector, PettingZoo, Stable-Baselines3."""
