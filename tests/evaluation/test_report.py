"""The page: self-contained, escaped, complete; the tracks it draws are the ones it names."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from aquaquad_envs.tasks.rollout import EpisodeResults
from evaluation import figures, markup
from evaluation.benchmark import Benchmark, SuiteRun
from evaluation.report import render, write_report
from evaluation.suites import find_suites

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Checker(HTMLParser):
    """Notes tags that do not close, and everything that would be fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.faults, self.fetched, self.ids, self.links = [], [], [], set(), set()

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        if tag not in VOID:
            self.open.append(tag)
        if "id" in found:
            self.ids.add(found["id"])
        if found.get("href", "").startswith("#"):
            self.links.add(found["href"][1:])
        for name in ("src", "href"):
            target = found.get(name, "#")
            if not target.startswith(("#", "data:")):
                self.fetched.append(target)
        if tag in {"script", "link", "iframe"}:
            self.fetched.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)


@pytest.fixture(scope="module")
def run(tmp_path_factory, quick_bound):
    made = Benchmark(
        task="drift-hop", suites=find_suites("drift-hop", ["vortex", "gyres"]),
        policies=["random", "drift", "direct-flight", "own_policies:Worse", "own_policies:Crash"], seed=0,
        output=tmp_path_factory.mktemp("report"), arguments=["--episodes", "3", "<&>"], episodes=3,
    )  # fmt: skip
    made.run()
    return made


@pytest.fixture(scope="module")
def text(run):
    return write_report(run).read_text(encoding="utf-8")


def test_the_page_is_well_formed_and_fetches_nothing(text):
    checker = Checker()
    checker.feed(text)
    assert not checker.faults and not checker.open
    assert checker.fetched == []
    assert checker.links <= checker.ids
    assert "url(" not in text and "@import" not in text
    assert len(text) < 5_000_000


def test_the_page_says_what_it_must(run, text):
    assert "&lt;b&gt;nothing&lt;/b&gt; &amp; more" in text, "what a policy knew, escaped"
    assert "<b>nothing</b>" not in text and "&lt;&amp;&gt;" in text
    for needed in (
        "the third decision is too much", run.machine["cpu"], run.machine["packages"]["numba"], run.manifest["started"],
        "Paired differences", "By difficulty", "python evaluate.py --episodes 3", "vortex", "gyres",
    ):  # fmt: skip
        assert markup.escape(needed) in text, needed
    for part in run.runs:
        assert " ".join(map(str, part.seeds)) in text
    assert text.count('src="data:image/png;base64,') == 4
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))


def test_bold_goes_to_the_best_that_arrives(run, text):
    table = text[text.index('id="vortex"') : text.index('id="gyres"')]
    rows = {
        name: re.search(rf"</i>{name}</td>.*?</tr>", table, re.DOTALL)[0]
        for name in ("drift", "direct-flight")
    }
    worse = re.search(r"</i>own_policies:Worse</td>.*?</tr>", table, re.DOTALL)[0]
    energy = run.runs[0].entries[2]["metrics"]["flight_energy_wh"]["mean"]
    assert f'<span class="best">{energy:.2f}</span>' in rows["direct-flight"]
    # Worse arrives as often, and flies more: its only bold is its share of arrivals.
    assert worse.count("best") == 1
    assert "–" in rows["drift"]


def test_an_unfinished_run_and_a_suite_that_cannot_run_have_a_page(run, tmp_path):
    broken = Benchmark(
        task="drift-hop", suites=find_suites("drift-hop", ["vortex"]), policies=["drift"], seed=0, output=tmp_path,
        arguments=[], episodes=2,
    )  # fmt: skip
    assert "Not complete" in render(broken)
    broken.runs = [
        SuiteRun(suite=broken.suites[0], seeds=np.arange(2), strata=np.array(["", ""]), error="no <sea>")
    ]
    assert "could not run: no &lt;sea&gt;" in render(broken)


def test_best_and_median_are_ranked_by_saving_with_failures_last(run):
    part = run.runs[0]
    fake = SuiteRun(suite=part.suite, seeds=np.arange(5), strata=np.repeat("", 5))
    fake.metrics["p"] = {"saving_vs_direct": np.array([0.1, np.nan, 0.5, 0.3, np.nan])}
    assert figures.best_and_median(fake, "p") == (2, 0)


def test_pictures_are_png_and_differ_with_the_tracks(run):
    part = run.runs[0]
    pictures = [figures.distributions(part), figures.tracks(part)]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    moved = SuiteRun(
        suite=part.suite, seeds=part.seeds, strata=part.strata, metrics=part.metrics, scores=part.scores,
        runs={name: shifted(results) for name, results in part.runs.items()},
    )  # fmt: skip
    assert figures.tracks(moved) != pictures[1]
    assert figures.tracks(part) == pictures[1]


def shifted(results):
    values = {name: getattr(results, name) for name in EpisodeResults.__dataclass_fields__}
    return EpisodeResults(**{**values, "track": results.track + 300.0})


@pytest.mark.parametrize(
    "value, digits, text",
    [
        (1.234, 2, "1.23"),
        (-1.5, 1, "−1.5"),
        (-0.001, 2, "0.00"),
        (None, 2, "–"),
        (float("nan"), 2, "–"),
        (-10.0, 0, "−10"),
    ],
)
def test_numbers(value, digits, text):
    assert markup.number(value, digits) == text
