"""Learned policies: recipes, training, checkpoints, loading; one file per concern."""
