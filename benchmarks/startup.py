"""Start-up: import and first step with an empty kernel cache, and again with a warm one.

Run it as ``python benchmarks/startup.py``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

PROGRAM = """
import gymnasium, aquaquad_envs
env = gymnasium.make("AquaQuad/DriftHop-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


def seconds(cache: str) -> float:
    """Wall time of a fresh interpreter that imports, makes, resets and steps once."""
    began = time.perf_counter()
    environment = {**os.environ, "AQUAQUAD_KERNEL_CACHE": cache}
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, env=environment)
    return time.perf_counter() - began


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        print(f"first compile:            {seconds(folder):6.2f} s")
        print(f"import + first step after: {min(seconds(folder) for _ in range(3)):5.2f} s")
