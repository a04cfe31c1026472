"""Filters of filterpy set to the same models, and scenarios, for tests of our compiled ones."""

import numpy as np
import scipy.linalg

from aquaquad_envs.estimation.kalman_motion import CONSTANT_ACCELERATION, PUBLISHED, states_of
from aquaquad_envs.sensing.measurements import BEARING, RANGE

C = 1500.0


def transition(motion, dt):
    """Φ = exp(A dt) by scipy; for the published model its own matrix."""
    n = states_of(motion)
    a = np.zeros((n, n))
    a[0, 2] = a[1, 3] = 1.0
    if motion.model == PUBLISHED:
        return np.eye(n) + dt * a
    if motion.model == CONSTANT_ACCELERATION:
        a[2, 4] = a[3, 5] = 1.0
    return scipy.linalg.expm(a * dt)


def process_noise(motion, dt):
    """Q by Van Loan's matrix exponential (IEEE Trans. Automatic Control 23, 1978) plus the variances a step."""
    n = states_of(motion)
    steps = (
        [motion.position_variance] * 2 + [motion.velocity_variance] * 2 + [motion.acceleration_variance] * 2
    )
    q = np.diag(steps[:n])
    if motion.density:
        a = np.zeros((n, n))
        a[0, 2] = a[1, 3] = 1.0
        if n == 6:
            a[2, 4] = a[3, 5] = 1.0
        g = np.zeros((n, n))
        g[n - 2, n - 2] = g[n - 1, n - 1] = motion.density
        block = scipy.linalg.expm(np.block([[-a, g], [np.zeros((n, n)), a.T]]) * dt)
        q = q + block[n:, n:].T @ block[:n, n:]
    return q


def wrapped(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def measure(kinds, sensors, others, x, y):
    """Exact measurements by numpy."""
    d = np.array([x, y]) - sensors
    e = np.array([x, y]) - others
    r = np.hypot(*d.T)
    tdoa = (r - np.hypot(*e.T)) / C
    return np.where(kinds == BEARING, np.arctan2(d[:, 1], d[:, 0]), np.where(kinds == RANGE, r, tdoa))


class Reference:
    """filterpy's UKF or EKF behind one interface: ``step(dt, rows)`` predicts and updates."""

    def __init__(self, motion, state, covariance, *, method, wrap=True, **sigma):
        import filterpy.kalman

        self.motion, self.method, self.wrap = motion, method, wrap
        n = states_of(motion)
        if method == "ukf":
            points = filterpy.kalman.MerweScaledSigmaPoints(n, **sigma)
            self.filter = filterpy.kalman.UnscentedKalmanFilter(
                n, 1, 1.0, hx=None, fx=lambda x, dt: transition(motion, dt) @ x, points=points
            )
        else:
            self.filter = filterpy.kalman.ExtendedKalmanFilter(n, 1)
        self.filter.x = np.array(state, dtype=float)
        self.filter.P = np.array(covariance, dtype=float)

    def step(self, dt, kinds, sensors, others, values, stds):
        bearing = (kinds == BEARING) & self.wrap

        def difference(a, b):
            return np.where(bearing, wrapped(np.subtract(a, b)), np.subtract(a, b))

        def h(x):
            return measure(kinds, sensors, others, x[0], x[1])

        f = self.filter
        f.Q = process_noise(self.motion, dt)
        if self.method == "ukf":
            f.residual_z = difference
            # The mean about the centre point: the plain weighted sum where no bearing crosses the seam.
            f.z_mean = lambda z, w: z[0] + w @ np.array([difference(one, z[0]) for one in z])
            f.predict(dt)
            f._dim_z = len(kinds)
            f.update(values, R=np.diag(stds**2), hx=h)
        else:
            f.F = transition(self.motion, dt)
            f.predict()

            def jacobian(x):
                d = x[:2] - sensors
                e = x[:2] - others
                r = np.hypot(*d.T)[:, None]
                rows = {
                    0: np.stack([-d[:, 1], d[:, 0]], -1) / r**2,
                    1: d / r,
                    2: (d / r - e / np.hypot(*e.T)[:, None]) / C,
                }
                out = np.zeros((len(kinds), f.dim_x))
                out[:, :2] = np.choose(kinds[:, None], [rows[0], rows[1], rows[2]])
                return out

            f.update(values, jacobian, h, R=np.diag(stds**2), residual=difference)
        return f.x, f.P


PUBLISHED_PAIRS = ((0, 1), (1, 2), (0, 2))
STDS = np.array([0.02, 3.0, 1e-3])


def rows_of(sensors, kinds="all"):
    """Measurement rows of three sensors: (kinds, sensors, others, stds). "all" is one of each kind and sensor."""
    sensors = np.asarray(sensors, dtype=float)
    first = np.array([pair[0] for pair in PUBLISHED_PAIRS])
    second = np.array([pair[1] for pair in PUBLISHED_PAIRS])
    codes = {"bearing": [0] * 3, "range": [1] * 3, "tdoa": [2] * 3, "all": [0, 1, 2]}[kinds]
    kinds = np.array(codes)
    return kinds, sensors[first], sensors[second], STDS[kinds]


TRIANGLE = np.array([[1000.0, 50.0], [-500.0, 800.0], [-450.0, -900.0]])
PRIOR = np.diag([100.0**2, 80.0**2, 4.0, 4.0, 1e-4, 1e-4])


def simulate(motion, state, steps, dt, rng, rows):
    """True states (steps, n) of a matched target, and its noisy measurements (steps, m); bearings wrapped."""
    kinds, sensors, others, stds = rows
    phi = transition(motion, dt)
    root = np.linalg.cholesky(process_noise(motion, dt) + 1e-18 * np.eye(len(state)))
    states, values = [], []
    for _ in range(steps):
        state = phi @ state + root @ rng.standard_normal(len(state))
        z = measure(kinds, sensors, others, *state[:2]) + stds * rng.standard_normal(len(kinds))
        states.append(state)
        values.append(np.where(kinds == BEARING, wrapped(z), z))
    return np.array(states), np.array(values)
