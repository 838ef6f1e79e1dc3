# SPDX-License-Identifier: MIT
"""Sentences on where a result failed: each at the threshold that docs/compare.md names, and not below it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.evaluation import compare_story as story
from slamcli.evaluation.figure_catalogue import ALL, BY_KEY
from slamcli.evaluation.sharpness import Sharpness

SECOND = 1_000_000_000
BEGIN = 1_700_000_000 * SECOND
STAMPS = BEGIN + np.arange(0, 1000) * SECOND // 10


@pytest.mark.parametrize(
    ("first", "after", "text"),
    [
        (410, 442, "lost track for 3.2 s at 41.0 s"),
        (0, 25, "no pose for the first 2.5 s"),
        (900, 1000, "lost track at 90.0 s and did not come back (9.9 s)"),
        (0, 1000, "no pose at any time"),
    ],
)
def test_a_spell_without_poses_is_told_with_its_time(first: int, after: int, text: str) -> None:
    known = np.ones(1000, dtype=np.bool_)
    known[first:after] = False
    (found,) = story.lost_spells(STAMPS, known, BEGIN)
    assert found.text == text
    assert found.at_s == pytest.approx(first / 10)


def test_short_spells_are_not_told_and_several_are_counted() -> None:
    known = np.ones(1000, dtype=np.bool_)
    known[100:109] = False
    assert story.lost_spells(STAMPS, known, BEGIN) == []
    known[200:220] = False
    known[500:550] = False
    (found,) = story.lost_spells(STAMPS, known, BEGIN)
    assert found.text == "lost track for 5.0 s at 50.0 s (1 shorter spell)"


def test_drift_is_told_from_when_it_is_three_times_the_best() -> None:
    errors = np.full(1000, 0.04)
    errors[600:] = np.linspace(0.04, 0.5, 400)
    (found,) = story.drift(STAMPS, errors, 0.05, BEGIN, "the truth")
    assert found.at_s == pytest.approx(60.0 + 0.1 * math.ceil((0.15 - 0.04) / 0.46 * 399), abs=0.11)
    assert found.text.startswith("up to 0.50 m off the truth, more than 0.15 m from 69.")
    assert story.drift(STAMPS, errors, 0.2, BEGIN, "the truth") == []
    assert story.drift(STAMPS, np.full(1000, 0.099), 0.0, BEGIN, "the truth") == []


def test_few_missed_relations_are_no_news() -> None:
    errors = np.full(1000, 0.02)
    errors[500:509] = 1.0
    assert story.missed_relations(STAMPS, errors, 0.02, BEGIN) == []
    errors[500:510] = 1.0
    (found,) = story.missed_relations(STAMPS, errors, 0.02, BEGIN)
    assert found.text == "misses 10 of 1000 true relations by more than 0.20 m, the first at 50.0 s"


def sharp(offsets: np.ndarray, places: np.ndarray) -> Sharpness:
    stamps = STAMPS[: len(offsets)]
    return Sharpness(
        mean_entropy=0.0, wall_thickness_m=np.zeros(0), thick_at_m=np.zeros((0, 3)), revisit_offset_m=offsets, revisit_at_m=places,
        revisit_stamps_ns=stamps, revisit_distance_m=0.0, revisited=1.0,
    )  # fmt: skip


def test_double_walls_are_told_with_their_place() -> None:
    offsets, places = np.full(600, 0.01), np.zeros((600, 3))
    places[:, 0] = np.repeat(np.arange(20) * 3.0, 30)
    offsets[300:330] = 0.21
    places[300:330, :2] = (30.2, 2.0)
    (found,) = story.double_walls(sharp(offsets, places), 0.6, 0.01, BEGIN)
    assert found.text.startswith(
        "the map has double walls around (30.2, 2.0): 0.21 m apart against 0.01 m in half of the map"
    )
    assert 30.0 <= found.at_s <= 33.0
    assert found.at_m == pytest.approx((30.2, 2.0))
    offsets[300:330] = 0.09
    assert story.double_walls(sharp(offsets, places), 0.6, 0.01, BEGIN) == []


def test_a_map_that_is_double_everywhere_does_not_hide_behind_itself() -> None:
    offsets, places = np.full(600, 0.35), np.zeros((600, 3))
    assert len(story.double_walls(sharp(offsets, places), 0.6, 0.35, BEGIN)) == 1
    assert story.double_walls(sharp(np.zeros(0), np.zeros((0, 3))), 0.6, 0.0, BEGIN) == []


def test_who_stands_alone_is_told_from_when_on() -> None:
    apart = np.where(np.arange(1000) < 300, 0.01, 0.25)
    (found,) = story.alone(STAMPS, apart, 0.21, 0.02, BEGIN)
    assert found.at_s == pytest.approx(30.0)
    assert found.text.startswith("stands alone: 0.21 m from the nearest of the others, two of which are within 0.02 m")
    assert story.alone(STAMPS, apart, 0.21, 0.08, BEGIN) == []


def test_scans_off_the_map_are_told_for_how_long() -> None:
    residuals = np.full(1000, 0.02)
    residuals[400:440] = 0.3
    (found,) = story.off_the_map(STAMPS, residuals, 0.02, BEGIN)
    assert found.text == "scans lie 0.30 m off the map's walls from 40.0 s for 4 s"
    residuals[410:440] = 0.02
    assert story.off_the_map(STAMPS, residuals, 0.02, BEGIN) == []  # one second is a moment
    assert story.off_the_map(STAMPS[:0], residuals[:0], 0.0, BEGIN) == []


def test_medians_of_seconds_as_numpy_has_them() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=1000)
    stamps, medians = story.medians_over_time(STAMPS, values)
    assert len(stamps) == 100
    assert stamps[7] == BEGIN + 7 * SECOND
    assert medians[7] == np.sort(values[70:80])[5]


def test_sentences_come_in_the_order_of_time() -> None:
    late, early = (story.Finding(kind="lost", at_s=t, text=f"at {t}") for t in (9.0, 2.0))
    assert story.sentence([late, early]) == "at 2.0; at 9.0"
    assert story.sentence([]) == "nothing stood out"


def test_every_figure_has_one_key() -> None:
    assert len(BY_KEY) == len(ALL)
    assert all(figure.about and figure.label for figure in ALL)
