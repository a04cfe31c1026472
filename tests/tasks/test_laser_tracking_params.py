"""Parameters of laser tracking: bounds, combinations, defaults that depend on others."""

import numpy as np
import pytest

from aquaquad_envs import make_world_batch
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.laser_tracking_params import _BOUNDS, Params


@pytest.mark.parametrize("name, low, high, open_low", _BOUNDS)
def test_bounds(name, low, high, open_low):
    for bad in (np.nextafter(low, -np.inf), np.nextafter(high, np.inf), float("nan"), "1", None):
        if bad is None and name in ("start_altitude_m", "full_scale_w_m2"):
            continue
        if isinstance(low, int) and name in ("axes", "sub_steps", "adc_bits") and isinstance(bad, float):
            bad = low - 1
        with pytest.raises(InvalidParameterError, match=name):
            Params(**{name: bad})
    if open_low:
        with pytest.raises(InvalidParameterError, match=name):
            Params(**{name: low})


@pytest.mark.parametrize(
    "values, words",
    [
        ({"scenario": "move"}, "Did you mean 'moving'"), ({"profile": "flattop"}, "Did you mean 'flat-top'"),
        ({"rov_velocity": "known"}, "Did you mean 'unknown'"), ({"axes": 2.0}, "axes: got 2.0, expected a whole"),
        ({"sub_steps": True}, "sub_steps"), ({"order": 3}, "order: got 3, expected an even"),
        ({"profile": "gaussian", "order": 10}, "order"), ({"sub_steps": 3}, "at least 5.*50 Hz"),
    ],
)  # fmt: skip
def test_what_does_not_go_together(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        Params(**values)


def test_defaults_that_follow_others():
    assert Params(altitude_m=7.0).start_altitude_m == 7.0
    assert Params(altitude_m=7.0, start_altitude_m=0.0).start_altitude_m == 0.0
    bright = make_world_batch("laser-tracking", 1, ambient_w_m2=0.01).constants
    assert bright.full_scale == pytest.approx(1.5 * (bright.peak + 0.01))
    # Finer sub-steps with a longer period are fine.
    batch = make_world_batch("laser-tracking", 1, action_period_s=0.2, sub_steps=20, horizon_s=2.0)
    batch.reset(0)
    for _ in range(10):
        batch.step(np.full((1, 2), 0.5))
    assert batch.truncated[0] and batch.worlds["u"][0] == pytest.approx(0.5, abs=0.1)


def test_water_dims_and_bends_the_light():
    """Options that the paper neglects: attenuation takes light, refraction moves the edge of what is seen."""
    plain, dim, bent = (
        make_world_batch("laser-tracking", 1, **values).constants
        for values in ({}, {"attenuation_per_m": 0.2}, {"refractive_index": 1.34})
    )
    assert dim.peak == pytest.approx(plain.peak * np.exp(-0.2 * 4.0)) and dim.radius == plain.radius
    assert bent.radius < plain.radius
