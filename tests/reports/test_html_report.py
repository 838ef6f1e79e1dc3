# SPDX-License-Identifier: MIT
"""The report page: one file, no network, everything escaped, the same text twice."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.parameters import Declaration
from slamcli.reports.figures import map_png
from slamcli.reports.html import report
from slamcli.reports.run_sections import parameter_table
from slamcli.trajectory import Trajectory

EVIL = "/scan<script>alert('x')</script>\"&"
VOID = {"meta", "img", "br", "link", "hr", "input"}


class Strict(HTMLParser):
    """Collects text and attributes and checks that every element is closed in order."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.open, self.text, self.tags, self.links = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href", "xlink:href", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.text.append(data)


def parse(markup):
    parser = Strict()
    parser.feed(markup)
    parser.close()
    assert parser.open == []
    return parser


@pytest.fixture(scope="module")
def material():
    n = 3000
    rng = np.random.default_rng(0)
    stamps = (np.arange(n) * 200_000_000).astype(np.int64) + 1_100_000_000_000_000_000
    turn = np.arange(n) / 200
    trajectory = Trajectory.from_se2(stamps, np.column_stack([4 * np.cos(turn), 3 * np.sin(turn), turn]))
    truth = Trajectory.from_se2(stamps, trajectory.poses_se2 + np.array([0.05, 0.0, 0.0]))
    grid = OccupancyGrid(rng.choice(np.array([-1, 0, 100], dtype=np.int8), (120, 120)), 0.1, (-6.0, -6.0, 0.0))
    steps = dict(
        stamp_ns=stamps,
        neff=rng.uniform(5, 30, n),
        num_particles=np.full(n, 30),
        resampled=(rng.random(n) > 0.97).astype(np.int64),
        best_score=rng.normal(100, 5, n),
        log_likelihood=rng.normal(-100, 5, n),
        fallbacks=np.zeros(n, dtype=np.int64),
        odometry_disagreement=rng.exponential(0.2, n),
        processed_index=np.arange(n),
    )
    errors = dict(stamp_ns=stamps, translation_m=np.full(n, 0.05), rotation_rad=np.abs(rng.normal(0, 0.01, n)))
    run = dict(
        slamcli="0.1.0",
        command=["slamcli", "map", f"bag{EVIL}.mcap"],
        algo="gmapping",
        parameters={"particles": 30, "minimumScore": 200.0, "flag": True, "time_offset": None},
        seed=3,
        versions={"numpy": "2.4"},
        inputs=[{"name": f"dir/bag{EVIL}.mcap", "size_bytes": 12345, "sha256": "ab" * 32}],
        topics={"scan": EVIL},
        frames={"base": "base_link"},
        counts={"stamps_backwards": 631},
        warnings=[f"topic {EVIL} is odd"] * 300,
        notes=["took /scan"],
        timing={"read": 1.0, "match": 3.0, "total_s": 4.5, "realtime_factor": 133.3},
        peak_memory_bytes=300_000_000,
        summary={"nested": {"a": [1, 2]}, "many": list(range(1000))},
        outputs=["map.pgm"],
    )
    declared = [
        Declaration("particles", "particles", int, 30, "", "How many <b>.", 1, None, (), True, False),
        Declaration("minimumScore", "minimumScore", float, 50.0, "m", "Least score.", None, None, (), True, False),
    ]
    image = map_png(grid, trajectory=trajectory)
    return run, dict(
        map_image=image, steps=steps, trajectory=trajectory, truth=truth, errors=errors, grid=grid, declared=declared
    )


@pytest.fixture(scope="module")
def markup(material):
    return report(material[0], **material[1])


def test_it_is_one_file_that_loads_nothing(markup):
    parser = parse(markup)
    assert all(link.startswith("data:") for link in parser.links)
    assert not re.search(r"https?:|@import|url\(", re.sub(r"base64,[^\"]*", "", markup))
    assert len(markup) < 2_000_000
    assert parser.tags.count("script") == 1


def test_everything_is_escaped(markup):
    assert "<script>alert" not in markup
    assert f"topic {EVIL} is odd" in "".join(parse(markup).text)


def test_same_text_twice(material, markup):
    assert report(material[0], **material[1]) == markup


def test_figures_are_told(markup):
    told = " ".join(parse(markup).text)
    for figure in (
        "12.0 × 12.0 m",
        "3,000",
        "0.050 m",
        "133.3 ×",
        "300 MB",
        "minimumScore",
        "631",
        "took /scan",
        "ab" * 32,
    ):
        assert figure in told, figure
    assert "and 100 more" in told
    assert "2 changed from the default" not in told
    assert "1 changed from the default" in told
    assert "fallbacks = 0" in told
    assert "rotation error in °" in told


def test_inner_figures_stand_under_their_path():
    told = parse(report({"summary": {"truth": {"ate": {"rmse_m": 0.125}}, "empty": {}}})).text
    assert "truth ate rmse m" in told
    assert "0.125" in told


def test_changed_parameters_come_first(markup):
    assert markup.index("<code>minimumScore") < markup.index("<code>particles")
    assert "How many &lt;b&gt;." in markup


def test_what_a_file_says_and_holds_anyway_is_not_changed():
    declared = [Declaration("sizes", "sizes", str, (1, 2), "", "Two.", None, None, (), True, False)]
    run = {"parameters": {"sizes": [1, 2]}, "changed": {"sizes": [1, 2]}}
    assert "0 changed from the default" in parameter_table(run, declared)
    assert "1 changed from the default" in parameter_table({"parameters": {"sizes": [1, 3]}}, declared)


@pytest.mark.parametrize("missing", [True, False])
def test_little_is_enough(missing):
    parser = parse(report({} if missing else {"warnings": [], "timing": {}, "parameters": {}, "inputs": []}))
    assert "0" in " ".join(parser.text)
    assert "img" not in parser.tags


def test_empty_and_odd_columns():
    empty = Trajectory.from_se2(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    steps = dict(stamp_ns=np.zeros(0, dtype=np.int64), neff=np.zeros(0))
    nothing = parse(
        report(
            {}, steps=steps, trajectory=empty, truth=empty, errors=dict(stamp_ns=np.zeros(0), translation_m=np.zeros(0))
        )
    )
    assert "img" not in nothing.tags
    stamps = np.array([5, 3, 9], dtype=np.int64)
    odd = dict(
        stamp_ns=stamps,
        a=np.array([np.nan, np.nan, np.nan]),
        b=np.array([1.0, np.nan, 2.0]),
        c=np.array(["x", "y", "z"]),
    )
    assert "3 steps" in " ".join(parse(report({}, steps=odd)).text)


def test_stages_may_stand_in_a_mapping_of_their_own():
    markup = report(
        {"timing": {"stages_s": {"read <1>": 1.0, "match": 3.0}, "total_s": 4.0, "recording_s": 9.9, "jobs": 2}}
    )
    assert "9.9" not in markup.split("</style>")[1].split("<script>")[0]
    assert "read &lt;1&gt;" in markup
    assert "75.0 %" in markup
