"""Lines, colours, arrows and scales: geometry and colour, before any picture."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pygame")

from aquaquad_envs.rendering.canvas import Canvas, dashes, import_pygame
from aquaquad_envs.rendering.chart import View, arrows, round_up, speed_colors

speeds = st.floats(-3, 3).filter(lambda value: abs(value) > 1e-3)


def lightness(colors):
    """CIE L* of sRGB colours, 0 to 100."""
    share = np.asarray(colors, dtype=np.float64) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    luminance = linear @ (0.2126, 0.7152, 0.0722)
    return np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)


@settings(max_examples=50, deadline=None)
@given(u=speeds, v=speeds, scale=st.floats(1, 60))
def test_arrows_point_with_the_current_and_are_as_long_as_it_is_fast(u, v, scale):
    corners = arrows(np.array([(40.0, 70.0)]), np.array([(u, v)]), scale)[0]
    tip, tail = corners[0], (corners[3] + corners[4]) / 2
    # A picture's rows count downwards: north is minus y.
    np.testing.assert_allclose(tip - tail, (scale * u, -scale * v), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose((tip + tail) / 2, (40, 70))
    along = (tip - tail) / np.hypot(u, v)
    assert np.all((corners - tail) @ along <= (tip - tail) @ along + 1e-9), (
        "something sticks out past the tip"
    )


def test_arrows_of_no_current_have_no_length_and_no_nan():
    corners = arrows(np.array([(1.0, 2.0)]), np.zeros((1, 2)), 30.0)
    np.testing.assert_array_equal(corners, np.broadcast_to((1.0, 2.0), (1, 7, 2)))


def test_speed_colors_darken_evenly():
    steps = np.diff(lightness(speed_colors(np.linspace(0, 1, 21))))
    assert np.all(steps < 0)
    assert steps.min() / steps.max() < 1.6, (
        "lightness falls unevenly: the eye would see edges that are not there"
    )
    # Contrast of the arrows' ink with the darkest water, by WCAG at least 3 for graphics.
    ink, darkest = (
        np.asarray(lightness([color])[0]) for color in ((20, 33, 51), speed_colors(np.array(1.0)))
    )
    luminance = [((value + 16) / 116) ** 3 + 0.05 for value in (darkest, ink)]
    assert luminance[0] / luminance[1] > 3


def test_speed_colors_hold_outside_their_range():
    np.testing.assert_array_equal(speed_colors(np.array([-1.0, 7.0])), speed_colors(np.array([0.0, 1.0])))


@settings(max_examples=100, deadline=None)
@given(value=st.floats(1e-6, 1e7))
def test_round_up_is_round_and_close_above(value):
    rounded = round_up(value)
    assert value * (1 - 1e-6) <= rounded <= 1.5 * value * (1 + 1e-6)
    digits = f"{rounded:.9e}".partition("e")[0]
    assert float(digits) in (1, 1.5, 2, 3, 4, 5, 6, 8)


def test_view_has_north_up_and_east_right():
    view = View(left=10, top=20, side=200, half_width_m=1000)
    assert view.pixel(0, 0) == (110, 120)
    assert view.pixel(1000, 1000) == (210, 20)
    x, y = view.points(4)
    assert x[0, 0] == -750 and y[0, 0] == 750 and x[0, 3] == 750 and y[3, 0] == -750
    assert view.held((500.0, 0.0), 11) == (199, 31)


@settings(max_examples=50, deadline=None)
@given(
    corners=st.lists(st.tuples(st.floats(0, 300), st.floats(0, 300)), min_size=2, max_size=6),
    mark=st.floats(1, 20),
    gap=st.floats(1, 20),
)
def test_dashes_cover_their_share_of_the_line(corners, mark, gap):
    length = sum(np.hypot(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(corners))
    covered = sum(np.hypot(b[0] - a[0], b[1] - a[1]) for a, b in dashes(corners, mark, gap))
    whole, rest = divmod(length, mark + gap)
    assert covered == pytest.approx(whole * mark + min(rest, mark), abs=1e-6)


def test_lines_and_discs_have_the_width_and_place_asked_for():
    canvas = Canvas(60, 40)
    canvas.fill((255, 255, 255))
    canvas.lines([(10, 20), (50, 20)], (0, 0, 0), 6)
    canvas.circle((30.0, 34.0), 4, (255, 0, 0))
    picture = canvas.to_array()
    assert picture.shape == (40, 60, 3) and picture.dtype == np.uint8
    assert (255 - picture[:, 30, 1].astype(int))[:28].sum() / 255 == pytest.approx(6, abs=0.6)
    assert tuple(picture[34, 30]) == (255, 0, 0)


def test_images_keep_their_colors_and_their_way_up():
    canvas = Canvas(20, 20)
    canvas.fill((255, 255, 255))
    colors = np.zeros((2, 2, 4), dtype=np.uint8)
    colors[0, 0], colors[1, 1] = (200, 100, 50, 255), (0, 0, 0, 128)
    canvas.paste(canvas.image(np.kron(colors, np.ones((20, 20, 1), dtype=np.uint8)), 20, 20), 0, 0)
    picture = canvas.to_array()
    assert tuple(picture[4, 4]) == (200, 100, 50)
    assert tuple(picture[4, 15]) == (255, 255, 255)
    assert abs(int(picture[15, 15, 0]) - 127) <= 2


def test_text_survives_a_program_that_quits_pygame():
    canvas = Canvas(60, 20)
    canvas.text((2, 10), "7.5 h", 17, (255, 255, 255))
    first = canvas.to_array()
    import_pygame().quit()
    canvas.fill((0, 0, 0))
    canvas.text((2, 10), "7.5 h", 17, (255, 255, 255))
    np.testing.assert_array_equal(canvas.to_array(), first)
    assert first.max() > 200
