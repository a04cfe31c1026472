"""The decision problems, one file each; a task is a pure, compiled, scalar world."""
