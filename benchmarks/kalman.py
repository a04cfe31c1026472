"""How fast the compiled filters run, beside filterpy and Stone Soup in the same process.

``python benchmarks/kalman.py``. A cycle is one prediction and one update of a track of six states by three
TDOA (τ12, τ23, τ13), on one thread. The peers filter one track at a time; their rates and ours are the
best of repetitions that alternate, and all start from the same state, so that the estimates can be compared.
A peer that is not installed is left out. Other work on the machine lowers all rates.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from aquaquad_envs.estimation.kalman import TrackerBatch
from aquaquad_envs.estimation.kalman_motion import make_motion, states_of

SOUND_SPEED = 1500.0
DT = 1.0
DENSITY = 1e-4
SENSORS = np.array([[1000.0, 0.0], [-500.0, 800.0], [-500.0, -800.0]])
OTHERS = np.roll(SENSORS, -1, axis=0)
STDS = {"tdoa": 1e-3, "bearing": 0.02, "range": 5.0}
TARGET = np.array([100.0, -50.0])
START = np.array([120.0, -40.0, 0.0, 0.0, 0.0, 0.0])
PRIOR = np.diag([400.0, 400.0, 1.0, 1.0, 1e-4, 1e-4])
ALPHA = 1.0  # where every library keeps its digits; speed does not depend on it
CYCLES = 20


def exact(kind: str) -> np.ndarray:
    """Noise-free measurements of a target at rest."""
    arms = TARGET - SENSORS
    ranges = np.hypot(*arms.T)
    if kind == "bearing":
        return np.arctan2(arms[:, 1], arms[:, 0])
    return ranges if kind == "range" else (ranges - np.roll(ranges, -1)) / SOUND_SPEED


def tracker_run(
    num_worlds: int, model: str, method: str, kind: str
) -> tuple[Callable[[], int], TrackerBatch]:
    """A function that runs CYCLES cycles of a batch and returns how many tracks' cycles these were."""
    motion = make_motion(model, density=DENSITY)
    n = states_of(motion)
    tracker = TrackerBatch(num_worlds, motion, method=method, alpha=ALPHA, sound_speed_m_s=SOUND_SPEED)
    # As a world has them: each with its own sensors and measurements, already in place.
    sensors = np.tile(SENSORS, (num_worlds, 1, 1, 1))
    others = np.tile(OTHERS, (num_worlds, 1, 1, 1))
    values = np.tile(exact(kind), (num_worlds, 1, 1))

    def run() -> int:
        tracker.place(START[:n], PRIOR[:n, :n])
        for _ in range(CYCLES):
            tracker.cycle(DT, kind, sensors, values, STDS[kind], others=others)
        return CYCLES * num_worlds

    return run, tracker


def process_noise() -> np.ndarray:
    """White jerk of ``DENSITY`` in states (x, y, u, v, ax, ay)."""
    axis = DENSITY * np.array(
        [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    )
    return np.kron(axis, np.eye(2))


TRANSITION = np.kron(np.array([[1.0, DT, DT * DT / 2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]]), np.eye(2))


def tdoa(x: float, y: float) -> np.ndarray:
    ranges = np.hypot(x - SENSORS[:, 0], y - SENSORS[:, 1])
    return (ranges - np.roll(ranges, -1)) / SOUND_SPEED


def filterpy_run() -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """The same cycles by filterpy's UKF, and its last state."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    points = MerweScaledSigmaPoints(6, alpha=ALPHA, beta=2.0, kappa=0.0)
    filter_ = UnscentedKalmanFilter(
        6, 3, DT, hx=lambda x: tdoa(x[0], x[1]), fx=lambda x, dt: TRANSITION @ x, points=points
    )
    filter_.Q, filter_.R = process_noise(), np.diag(np.full(3, STDS["tdoa"] ** 2))
    values = exact("tdoa")

    def run() -> int:
        filter_.x, filter_.P = START.copy(), PRIOR.copy()
        for _ in range(CYCLES):
            filter_.predict()
            filter_.update(values)
        return CYCLES

    return run, lambda: filter_.x


def stone_soup_run() -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """The same cycles by Stone Soup's UKF, and its last state."""
    import datetime

    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor
    from stonesoup.types.array import StateVector, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    class Tdoa(NonLinearGaussianMeasurement):
        """Three TDOA of the position."""

        @property
        def ndim_meas(self) -> int:
            return 3

        def function(self, state: object, noise: object = False, **kwargs: object) -> StateVectors:
            # All sigma points come at once: the peer at its fastest.
            position = np.asarray(state.state_vector, dtype=float)[:2]
            ranges = np.hypot(*(position[:, None, :] - SENSORS.T[:, :, None]))
            return StateVectors((ranges - np.roll(ranges, -1, axis=0)) / SOUND_SPEED)

    transition = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=TRANSITION, covariance_matrix=process_noise()
    )
    model = Tdoa(ndim_state=6, mapping=(0, 1), noise_covar=np.diag(np.full(3, STDS["tdoa"] ** 2)))
    predictor = UnscentedKalmanPredictor(transition, alpha=ALPHA, beta=2.0, kappa=0.0)
    updater = UnscentedKalmanUpdater(model, alpha=ALPHA, beta=2.0, kappa=0.0)
    began = datetime.datetime(2026, 1, 1)
    values = StateVector(exact("tdoa"))
    last: list[GaussianState] = []

    def run() -> int:
        state = GaussianState(StateVector(START), PRIOR, timestamp=began)
        for k in range(1, CYCLES + 1):
            now = began + datetime.timedelta(seconds=k * DT)
            prediction = predictor.predict(state, timestamp=now)
            state = updater.update(SingleHypothesis(prediction, Detection(values, timestamp=now)))
        last[:] = [state]
        return CYCLES

    return run, lambda: np.asarray(last[0].state_vector, dtype=float).ravel()


def rate(run: Callable[[], int]) -> float:
    began = time.perf_counter()
    return run() / (time.perf_counter() - began)


def main() -> None:
    """Measure and print."""
    ours, tracker = tracker_run(1024, "constant-acceleration", "ukf", "tdoa")
    runs: dict[str, tuple[Callable[[], int], Callable[[], np.ndarray]]] = {
        "ours": (ours, lambda: tracker.states[0, 0])
    }
    for name, make in (("filterpy", filterpy_run), ("Stone Soup", stone_soup_run)):
        try:
            runs[name] = make()
        except ImportError as missing:
            print(f"{name}: left out, {missing}")
    best = dict.fromkeys(runs, 0.0)
    for run, _ in runs.values():
        run()
    for _ in range(25):
        for name, (run, _) in runs.items():
            best[name] = max(best[name], rate(run))
    print("UKF, 6 states, 3 TDOA, one thread (ours in batches of 1024):")
    for name, (_, state) in runs.items():
        apart = np.abs(state() - runs["ours"][1]()).max()
        ratio = "" if name == "ours" else f", ours is {best['ours'] / best[name]:,.0f} times as fast"
        print(f"  {name:10} {best[name]:12,.0f} cycles/s{ratio}; last estimate {apart:.1e} from ours")
    print("\nOurs, M cycles/s, batches of 1024:")
    for model in ("constant-velocity", "constant-acceleration"):
        for kind in STDS:
            cells = []
            for method in ("ukf", "ekf", "ekf-sequential"):
                run, _ = tracker_run(1024, model, method, kind)
                run()
                cells.append(f"{method} {max(rate(run) for _ in range(12)) / 1e6:5.2f}")
            print(f"  {model:22} 3 {kind:8} {'  '.join(cells)}")
    print("\nOurs, UKF, 6 states, 3 TDOA, by batch size (one Python call a cycle):")
    for num_worlds in (1, 16, 256, 4096):
        run, _ = tracker_run(num_worlds, "constant-acceleration", "ukf", "tdoa")
        run()
        print(f"  {num_worlds:5} worlds {max(rate(run) for _ in range(12)) / 1e6:6.3f} M cycles/s")


if __name__ == "__main__":
    main()
