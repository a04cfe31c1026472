"""Writes surveys of a known transponder, as a vehicle of any kind might have recorded them."""

import numpy as np

HEADER = "# time0_transmit N0 E0 U0 sigN0 sigE0 sigU0 time1_receive N1 E1 U1 sigN1 sigE1 sigU1 TWTT(s)"
TURN_AROUND_S = 0.2


def track(count, extent, shape, rng):
    """(count, 2) m: "circles" with a crossing, a nearly straight "line", or a "lawn" mown about the middle."""
    along = np.linspace(0.0, 1.0, count)
    if shape == "line":
        places = np.stack([2 * extent * (along - 0.5), 0.05 * extent * np.sin(5 * along)], axis=-1)
    elif shape == "lawn":
        leg = along * 6
        side = np.where(leg.astype(int) % 2, 1 - leg % 1, leg % 1)
        places = extent * np.stack([2 * side - 1, 2 * along - 1], axis=-1)
    else:
        angle = 4 * np.pi * along
        radius = extent * np.where(along < 0.45, 1.0, np.where(along < 0.9, 0.5, 10 * (1 - along) - 0.5))
        places = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return places + rng.normal(0, 0.002 * extent, places.shape)


def make_survey(
    rng, *, count=150, extent=150.0, shape="circles", transponder=(10.0, -20.0, 80.0), sound_speed=1495.0, noise_s=5e-5,
    fix_std=(0.02, 0.015, 0.03), speed=0.5, outliers=0.0, outlier_s=0.05, height=0.0,
):  # fmt: skip
    """Rows (count, 15) of the format. transponder: x, y and depth below the mean antenna, which is ``height`` up."""
    places = track(count, extent, shape, rng)
    heave = height + rng.normal(0, 0.3, count)
    sent = np.column_stack([places, heave])
    course = np.gradient(places, axis=0)
    course /= np.maximum(np.linalg.norm(course, axis=1), 1e-9)[:, None]
    target = np.array([transponder[0], transponder[1], height - transponder[2]])
    down = np.linalg.norm(sent - target, axis=1)
    received = sent + np.column_stack(
        [speed * (2 * down / sound_speed + TURN_AROUND_S)[:, None] * course, rng.normal(0, 0.05, count)]
    )
    times = (down + np.linalg.norm(received - target, axis=1)) / sound_speed + noise_s * rng.standard_normal(
        count
    )
    wrong = rng.random(count) < outliers
    times[wrong] += outlier_s * rng.uniform(-0.5, 1.0, wrong.sum())
    times = np.maximum(times, 1e-4)
    # What a receiver of positions gets wrong it gets wrong at both ends alike.
    slip = rng.normal(size=(count, 3)) * fix_std
    stds = np.tile(fix_std, (count, 1))[:, [1, 0, 2]]
    clock = 1000.0 + 10.0 * np.arange(count)
    swap = [1, 0, 2]  # north first
    return np.column_stack(
        [clock, (sent + slip)[:, swap], stds, clock + times + TURN_AROUND_S, (received + slip)[:, swap], stds, times]
    )  # fmt: skip


def write_survey_file(path, rows, header=HEADER):
    lines = [header] if header else []
    lines += [" ".join(f"{value:.7f}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path
