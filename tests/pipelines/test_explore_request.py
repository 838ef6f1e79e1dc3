# SPDX-License-Identifier: MIT
"""What is said to the exploration, and what is left to navigation and SLAM."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.pipelines.explore_request import explore_request
from slamcli.pipelines.navigate_request import NavigateRequest

LAUNCH = """<launch>
  <node pkg="explore_lite" type="explore" name="explore">
    <param name="potential_scale" value="3.0"/>
    <param name="min_frontier_size" value="0.5"/>
  </node>
  {more}
</launch>
"""


def request(slam="cartographer", **given):
    return NavigateRequest(waypoints=(), world="office", slam=slam, **given)


def test_sets_of_the_exploration_are_its_own():
    found = explore_request(
        request(sets=("explore/goal_point=middle", "DWAPlannerROS/max_vel_x=0.4", "explore.gain=visible"))
    )
    assert (found.parameters.goal_point, found.parameters.gain) == ("middle", "visible")
    assert found.given == {"goal_point": "middle", "gain": "visible"}
    assert found.drive.sets == ("DWAPlannerROS/max_vel_x=0.4",)


def test_explore_lites_launch_file_is_read_and_set_goes_over_it(tmp_path):
    path = tmp_path / "explore.launch"
    path.write_text(LAUNCH.format(more=""))
    found = explore_request(request(config_files=(path,), sets=("explore/potential_scale=7",)))
    assert (found.parameters.potential_scale, found.parameters.min_frontier_size) == (7.0, 0.5)
    assert found.drive.config_files == ()


def test_a_launch_file_that_starts_others_too_is_left_to_them(tmp_path):
    path = tmp_path / "all.launch"
    path.write_text(LAUNCH.format(more='<node pkg="move_base" type="move_base" name="move_base"/>'))
    found = explore_request(request(config_files=(path, Path("move_base.launch"))))
    assert found.parameters.potential_scale == 3.0
    assert found.drive.config_files == (path, Path("move_base.launch"))


def test_gmapping_draws_its_map_every_second_unless_told_otherwise():
    assert explore_request(request("gmapping")).drive.slam_sets == ("map_update_interval=1",)
    given = ("particles=5", "map_update_interval=3")
    assert explore_request(request("gmapping", slam_sets=given)).drive.slam_sets == given
    assert explore_request(request()).drive.slam_sets == ()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("explore/potential_scal=1", "did you mean potential_scale"),
        ("explore/potential_scale=nan", "potential_scale"),
        ("explore/goal_point=corner", "goal_point"),
        ("explore/progress_timeout=-1", "progress_timeout"),
    ],
)
def test_wrong_parameters_are_refused(text, told):
    with pytest.raises(ConfigError, match=told):
        explore_request(request(sets=(text,)))


def test_a_world_and_slam_are_needed():
    with pytest.raises(UsageError, match="needs a world and SLAM"):
        explore_request(NavigateRequest(waypoints=(), world="office"))
