# SPDX-License-Identifier: MIT
"""From what a loop tells to its story."""

from __future__ import annotations

import numpy as np
from scripted_loop import play

from slamcli.evaluation.drive_story import Event
from slamcli.measurements import Odometry
from slamcli.pipelines.story_teller import StoryTeller


def test_the_story_of_a_scripted_drive():
    teller = StoryTeller()
    simulation = play([teller], seconds=3.0)
    story = teller.story([], [Event(time_s=1.0, kind="collision", message="wall")])
    assert story.grid is not None
    assert len(story.times_s) == 60  # the first odometry comes before the first truth
    truth = simulation.ride.at(story.times_s)[0][:, :2]
    np.testing.assert_allclose(story.truth[:, :2], truth, atol=0.02)
    # off by the scripted 2 cm and by what truth and odometry, told at their own times, are apart
    assert np.nanmax(story.errors()[0]) < 0.06
    assert [e.kind for e in story.events] == ["goal", "planning", "controlling", "collision", "succeeded"]
    assert len(story.people) == 16
    assert len(story.people_ways()) == 2
    assert story.commands[:, 0].tolist() == [0.4] * len(story.commands)


def test_recoveries_are_events_of_their_own_and_repeated_states_one():
    teller = StoryTeller()
    for state, message in (("clearing", "recovery: rotate_recovery"), ("controlling", ""), ("controlling", "")):
        teller.on_status(2.0, state, message)
    events = teller.story([]).events
    assert [(e.kind, e.message) for e in events] == [("recovery", "rotate_recovery"), ("controlling", "")]


def test_nothing_told_is_an_empty_story():
    story = StoryTeller().story([])
    assert story.grid is None
    assert story.truth.shape == story.estimate.shape == story.commands.shape == (0, 3)


def test_before_the_localisers_first_word_there_is_no_estimate():
    teller = StoryTeller()
    for time_s in (0.0, 0.1):
        teller.on_truth(time_s, np.array([1.0, 2.0, 0.0]), np.zeros(3))
        teller.on_odometry(
            time_s, Odometry(stamp_ns=0, frame_id="odom", position_m=np.zeros(3), quat_xyzw=np.array([0, 0, 0, 1.0]))
        )
        teller.on_localisation(time_s, np.array([1.0, 2.5, 0.0]), np.eye(3), np.zeros((0, 3)))
    position, _ = teller.story([]).errors()
    np.testing.assert_allclose(position, [np.nan, 0.5])
