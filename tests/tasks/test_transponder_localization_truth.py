"""Information at the true positions, against NumPy."""

import numpy as np
import pytest

import aquaquad_envs
from baselines import make_policy


def true_log_det(w, params):
    total = 0.0
    for m in range(int(w["num_transponders"])):
        y = np.diag(1.0 / np.square(params.prior_std_m))
        for j in range(int(w["count"])):
            if np.isfinite(w["ranges"][m, j]):
                h = w["target"][m] - [w["place_x"][j], w["place_y"][j], 0.0]
                h /= np.linalg.norm(h)
                y += np.outer(h, h) / params.range_std_m**2
        total += np.linalg.slogdet(y)[1]
    return total


@pytest.mark.parametrize("params", [{}, {"miss_share": 0.4, "outlier_share": 0.2, "robust_threshold": 1.5}])
def test_it_counts_the_replies_at_the_true_positions(params):
    batch = aquaquad_envs.make_world_batch("transponder-localization", 5, scenario="random", **params)
    batch.reset(np.arange(5))
    policy = make_policy("random", batch)
    policy.reset(np.arange(5))
    for _ in range(12):
        batch.step(policy.act(batch.observations, batch.worlds))
    expected = [true_log_det(w, batch.params) for w in batch.worlds]
    assert batch.metrics()["log_det_true"] == pytest.approx(expected, rel=1e-9)
