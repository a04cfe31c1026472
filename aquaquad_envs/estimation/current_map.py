"""A forecast of the current, corrected online by what drifting vehicles measured.

A vehicle's own track measures the current that carries it; where that differs from the forecast, so will
its surroundings. Measurements of any number of vehicles go into one map: sharing is adding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.currents import CurrentAxes


class CurrentMap:
    """Objective analysis of the errors of a forecast (Bretherton, Davis and Fandry, Deep-Sea Research 23, 1976).

    The error e = measured - forecast of each velocity component is a Gaussian field of mean 0 and covariance

        C(d, τ) = error_std² exp(-d²/2L²) exp(-τ²/2T²),

    d the distance in m and τ the time in s apart, seen with noise of ``noise_std``. Its mean given the
    measurements, cᵀ (C + noise_std² I)⁻¹ e, corrects the forecast; far from them nothing changes. The
    components are taken as independent (the divergence of the correction is not held at 0).

    Parameters
    ----------
    length_scale_m: L. time_scale_s: T, infinite for errors that persist.
    error_std_m_s, noise_std_m_s: standard deviations a component. Only their ratio moves the mean.
    capacity: measurements kept, the latest; the work grows with its cube.

    Raises ``InvalidParameterError`` for parameters out of bounds and measurements that are not finite.
    """

    def __init__(
        self,
        *,
        length_scale_m: float,
        time_scale_s: float = np.inf,
        error_std_m_s: float = 0.2,
        noise_std_m_s: float = 0.05,
        capacity: int = 500,
    ) -> None:
        check_range("length_scale_m", length_scale_m, 0, 1e9, open_low=True)
        if time_scale_s != np.inf:
            check_range("time_scale_s", time_scale_s, 0, 1e12, open_low=True)
        check_range("error_std_m_s", error_std_m_s, 0, 100, open_low=True)
        # Without any noise two measurements at one place would be singular.
        check_range("noise_std_m_s", noise_std_m_s, 1e-6 * error_std_m_s, 100)
        check_range("capacity", capacity, 1, 100_000)
        self._length, self._time = float(length_scale_m), float(time_scale_s)
        self._error, self._noise = float(error_std_m_s), float(noise_std_m_s)
        self._capacity = int(capacity)
        self._places, self._errors = np.empty((0, 3)), np.empty((0, 2))

    def __len__(self) -> int:
        """Measurements held."""
        return len(self._places)

    def add(self, time_s: ArrayLike, x: ArrayLike, y: ArrayLike, errors: ArrayLike) -> None:
        """Take in measurements: times (n,) s, positions (n,) m, ``errors`` (n, 2) = measured - forecast, m/s."""
        places = np.stack(np.broadcast_arrays(*map(np.atleast_1d, (time_s, x, y))), -1).astype(np.float64)
        errors = np.asarray(errors, dtype=np.float64).reshape(-1, 2)
        if len(errors) != len(places) or not (np.isfinite(places).all() and np.isfinite(errors).all()):
            raise InvalidParameterError(
                "errors",
                errors.shape,
                f"finite measurements at finite places, {len(places)} of two components",
            )
        self._places = np.concatenate([self._places, places])[-self._capacity :]
        self._errors = np.concatenate([self._errors, errors])[-self._capacity :]

    def correction(self, time_s: ArrayLike, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """What to add to the forecast at times and positions (all of one shape): (..., 2) m/s, and its std (...)."""
        time_s, x, y = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (time_s, x, y)))
        if not len(self):
            return np.zeros((*x.shape, 2)), np.full(x.shape, self._error)
        from scipy.linalg import cho_factor, cho_solve

        asked = np.stack([time_s.ravel(), x.ravel(), y.ravel()], -1)
        among = self._covariance(self._places, self._places) + self._noise**2 * np.eye(len(self))
        across = self._covariance(asked, self._places)
        factor = cho_factor(among)
        mean = across @ cho_solve(factor, self._errors)
        explained = np.sum(across * cho_solve(factor, across.T).T, -1)
        std = np.sqrt(np.maximum(self._error**2 - explained, 0.0))
        return mean.reshape(*x.shape, 2), std.reshape(x.shape)

    def corrected(self, velocity: np.ndarray, axes: CurrentAxes) -> np.ndarray:
        """The gridded forecast (frames, rows, columns, 2), m/s, with the correction added at every node."""
        frames, rows, columns = velocity.shape[:3]
        time, y, x = np.meshgrid(
            axes.time0 + axes.time_step * np.arange(frames), axes.y0 + axes.spacing * np.arange(rows),
            axes.x0 + axes.spacing * np.arange(columns), indexing="ij",
        )  # fmt: skip
        return velocity + self.correction(time, x, y)[0]

    def _covariance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        apart = a[:, None, :] - b[None, :, :]
        square = (apart[..., 1] ** 2 + apart[..., 2] ** 2) / self._length**2 + (
            apart[..., 0] / self._time
        ) ** 2
        return self._error**2 * np.exp(-0.5 * square)
