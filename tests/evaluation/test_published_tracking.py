"""Published tracking, HDOP maps and their tables: the scenarios are as published, the numbers computed."""

import json

import numpy as np
import pytest

import evaluate
from aquaquad_envs.estimation.hdop import hdop
from aquaquad_envs.estimation.kalman import TrackerBatch
from evaluation import (
    published,
    published_filters,
    published_maps,
    published_sensor_placement,
    published_tracking,
)
from evaluation.published_filters import Setting, measurements, run_filterpy, run_ours, settled_s
from evaluation.published_laboratory import laboratory_track, shared_peaks, y_sensors
from evaluation.published_maps import reproduce_maps
from evaluation.published_tracking import comparison_track
from evaluation.published_values import FILTERS, LABORATORY, PLACEMENT


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """All of it, with few runs and little of filterpy."""
    output = tmp_path_factory.mktemp("published")
    ticks = []
    some = dict(list(published_tracking.variations().items())[1:3])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(published_tracking, "FILTERPY_S", 0.5)
        patch.setattr(published_tracking, "variations", lambda: some)
        patch.setattr(published_maps, "CELLS", 20)
        patch.setitem(PLACEMENT, "tries", 2)
        table = published.reproduce(
            1, 0, output, ["published"], lambda: ticks.append(1), tasks=("sensor-placement",), tracking_runs=2
        )
        assert (
            len(ticks) == published.steps(1, 2, ("sensor-placement",)) == published_sensor_placement.steps(2)
        )
    return table["sensor_placement"], output


@pytest.mark.parametrize("perimeter", published_tracking.PERIMETERS)
def test_the_comparison_is_the_published_one(perimeter):
    track = comparison_track(perimeter)
    assert track.times[-1] == pytest.approx(FILTERS["duration_s"])
    assert np.hypot(*track.truth[-1, :2]) == pytest.approx(FILTERS["reach_m"], rel=0.01)
    assert np.hypot(*track.truth[0, :2]) < 1.0
    np.testing.assert_allclose(
        np.diff(track.truth[:, :2], axis=0)[::7000] / track.dt_s, track.truth[1::7000, 2:]
    )
    assert np.ptp(np.hypot(*track.sensors.T)) < 1e-6
    speed = np.hypot(*(np.diff(track.sensors, axis=0) / track.dt_s).T).max()
    assert speed < 0.1 * np.hypot(*track.truth[0, 2:])  # "substantially less"
    assert track.noise_std == pytest.approx(0.1414, abs=1e-4)


def test_only_one_perimeter_looks_across_the_seam():
    for perimeter, across in (("diagonal", False), ("axes", True)):
        values = measurements(comparison_track(perimeter), 0)
        assert bool((np.abs(np.diff(values, axis=0)) > np.pi).any()) == across


def test_measurements_have_the_published_noise():
    track = comparison_track()
    arms = track.truth[:, None, :2] - track.sensors
    errors = measurements(track, 5) - np.arctan2(arms[..., 1], arms[..., 0])
    assert np.std(errors) == pytest.approx(track.noise_std, rel=0.01)
    assert abs(np.mean(errors)) < 5 * track.noise_std / np.sqrt(errors.size)
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 0.02
    np.testing.assert_array_equal(measurements(track, 5), measurements(track, 5))
    assert not np.array_equal(measurements(track, 5), measurements(track, 6))


@pytest.mark.parametrize(
    "setting", [*published_tracking.settings(), Setting("ukf", "published", False, True)]
)
def test_the_loop_is_that_of_the_tracker(setting):
    track = comparison_track("axes")
    values = measurements(track, 1)[:200]
    tracker = TrackerBatch(
        1, setting.motion, method=setting.method, wrap=setting.wrap, carry_sigma_points=setting.carried
    )
    tracker.place(track.start, np.diag(track.prior))
    errors = np.empty((200, 4))
    for k, value in enumerate(values):
        tracker.cycle(track.dt_s, "bearing", track.sensors[k], value, track.assumed_std)
        errors[k] = tracker.states[0, 0, :4] - track.truth[k]
    ours = run_ours(track, setting, values)
    np.testing.assert_array_equal(ours.errors, errors)
    np.testing.assert_allclose(ours.mse, (errors**2).mean(axis=0))
    np.testing.assert_array_equal(run_ours(track, setting, values, every=50).errors, errors[49::50])


@pytest.mark.parametrize("setting", list(published_tracking.settings()))
@pytest.mark.parametrize("perimeter", published_tracking.PERIMETERS)
def test_filterpy_agrees(setting, perimeter):
    pytest.importorskip("filterpy")
    track = comparison_track(perimeter)
    values = measurements(track, 2)[:60]
    apart = np.abs(run_filterpy(track, setting, values).errors - run_ours(track, setting, values).errors)
    # Plain bearings at the seam blow up whatever digits filterpy's sigma points lose.
    assert apart[:, :2].max() < (1e-4 if setting.wrap or perimeter == "diagonal" else 1.0)


def test_without_filterpy_its_rows_are_left_out(monkeypatch):
    monkeypatch.setattr(published_tracking, "filterpy_version", lambda: None)
    ticks = []
    table = published_tracking._filterpy_rows(0, lambda: ticks.append(1))
    assert table["rows"] == [] and len(ticks) == 16
    assert "not installed" in published_sensor_placement._peer_note({"filterpy": table})
    monkeypatch.undo()

    def absent(name):
        raise published_filters.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(published_filters.metadata, "version", absent)
    assert published_filters.filterpy_version() is None


def test_settling_is_that_of_the_mean():
    times = np.arange(1, 101) * 0.1
    first = np.array([3.0, 4.0])
    decay = np.exp(-times / 2.0)[None, :, None] * first
    noise = np.array([1.0, -1.0])[:, None, None] * np.ones((1, 100, 2))  # cancels in the mean
    assert settled_s(decay + 50 * noise, times, first) == pytest.approx(2.0 * np.log(10), abs=0.1)
    assert np.isnan(settled_s(np.ones((2, 100, 2)), times, first))


def test_the_laboratory_is_the_published_one():
    track = laboratory_track(4)
    places, times = track.truth[:, :2], track.times
    assert times[-1] == pytest.approx(LABORATORY["duration_s"])
    resting = places[times <= LABORATORY["rests_until_s"]]
    np.testing.assert_allclose(resting, np.broadcast_to(LABORATORY["target"], resting.shape))
    assert np.hypot(*places[np.searchsorted(times, LABORATORY["centre_at_s"])]) < 0.01
    assert np.abs(places).max() < LABORATORY["room_m"] / 2
    assert np.abs(y_sensors()).max() < LABORATORY["room_m"] / 2
    # Speeds are those of the places.
    np.testing.assert_allclose(
        np.cumsum(track.truth[:, 2:], axis=0) * track.dt_s + places[0], places, atol=1e-9
    )
    assert not np.array_equal(laboratory_track(5).truth, track.truth)
    # The centre has the least HDOP, as the source observes.
    sample = hdop("tdoa", y_sensors(), places[::100])
    assert sample.min() >= hdop("tdoa", y_sensors(), [0.0, 0.0]) * (1 - 1e-9)


def test_peaks_that_follow_are_told_from_those_that_do_not():
    times = np.arange(1200) * 0.1
    bumps = sum(np.exp(-0.5 * ((times - at) / 1.0) ** 2) for at in (15.0, 48.0, 70.0, 101.0))
    dilution = 1000.0 * (1.0 + 20.0 * bumps)
    follows = shared_peaks(dilution, 0.1 + np.roll(bumps, 8))
    assert follows["peaks"] == 4 and follows["at_high_hdop"] == 1.0 and follows["rank_correlation"] > 0.5
    apart = shared_peaks(dilution, 0.1 + np.roll(bumps, 150))
    assert apart["at_high_hdop"] <= 0.25 and apart["by_chance"] < 0.6
    assert np.isnan(shared_peaks(dilution, np.ones(1200) + 1e-3 * times)["at_high_hdop"])


def test_the_maps_show_what_the_source_saw():
    table, drawn = reproduce_maps()
    tdoa, bearing = table["tdoa"], table["bearing"]
    # Least opposite the two fixed sensors, a lesser dip between them, singular along both.
    assert tdoa["least_towards_deg"] == 270 and tdoa["north_is_a_dip"] and tdoa["south"] < tdoa["north"]
    assert {45, 135} <= set(tdoa["greatest_towards_deg"]) and tdoa["range_free"] < 1e-9
    middle = len(drawn["axis"]) // 2
    assert np.isinf(drawn["bearing"][middle, middle])  # on the target
    assert bearing["ridge"]["centre"]["from_north_east_deg"] < 1.0
    # A fourth vehicle never hurts; the source assumes 9000 as the greatest.
    assert bearing["greatest"] <= bearing["without_it"] <= bearing["published_greatest"]
    assert drawn["distance"][-1, 0] == pytest.approx(np.hypot(8000, 8000))


def test_the_tables_hold_what_was_run(made):
    table, _ = made
    rows = table["filters"]["rows"]
    assert len(rows) == 16 and all(row["mse"]["x"]["n"] == 2 for row in rows)
    by_name = {(row["perimeter"], row["model"], row["wrap"], row["method"]): row for row in rows}

    def error(*name):
        return by_name[name]["mse"]["x"]["mean"]

    for model in published_tracking.MODELS:
        # With equal inputs the two filters do not differ, against what was published.
        assert error("axes", model, True, "ukf") == pytest.approx(error("axes", model, True, "ekf"), rel=1e-3)
        # Where no bearing crosses the seam wrapping changes nothing, where one does it is needed.
        assert error("diagonal", model, False, "ekf") == pytest.approx(
            error("diagonal", model, True, "ekf"), rel=1e-6
        )
        assert error("axes", model, False, "ukf") > 100 * error("axes", model, True, "ukf")
    assert published_sensor_placement.filters_apart(table["filters"])["wrapped"] < 1e-3
    laboratory = table["laboratory"]
    assert laboratory["noise_mean_abs_s"] == pytest.approx(LABORATORY["mean_noise_s"], rel=0.05)
    assert laboratory["converged_s"] <= LABORATORY["converged_s"]
    assert laboratory["least_hdop"] == pytest.approx(laboratory["centre_hdop"], rel=1e-3)


def test_the_files_hold_tables_and_figures(made):
    table, output = made
    names = {path.name for path in output.iterdir()}
    assert names == {"published.json", "published.html"} | {
        f"published-{name}.png" for name in published_sensor_placement.CAPTIONS
    }
    content = json.loads((output / "published.json").read_text())["sensor_placement"]
    assert content["placement"]["rows"][0]["end"] == table["placement"]["rows"][0]["end"]
    page = (output / "published.html").read_text()
    assert page.count("data:image/png;base64,") == len(published_sensor_placement.CAPTIONS)
    assert "http" not in page and "765.7" in page and "DR-RRT*" not in page
    for name in published_sensor_placement.CAPTIONS:
        assert (output / f"published-{name}.png").read_bytes().startswith(b"\x89PNG")
    # A later report shows the tables from the file, without the figures.
    again = published.section_in(output)
    assert again is not None and "data:image" not in again
    assert published_sensor_placement.section(table) in again


def test_the_terminal_shows_them(made):
    from rich.console import Console

    console = Console(width=120, record=True)
    published.print_table({"sensor_placement": made[0]}, console)
    text = console.export_text()
    for piece in ("765.7", "diagonal, App. B, wrapped", "within 2", "range, clustered", "a ridge from"):
        assert piece in text, piece


def test_the_command_knows_the_tasks(capsys):
    assert evaluate.main(["published", "--task", "sensor-placment"]) == evaluate.WRONG_INPUT
    assert "Did you mean 'sensor-placement'" in capsys.readouterr().err
    assert evaluate.main(["published", "--tracking-runs", "1"]) == evaluate.WRONG_INPUT
    assert "tracking-runs: got 1" in capsys.readouterr().err
    assert evaluate.PublishedOptions().tracking_runs == published_sensor_placement.RUNS
