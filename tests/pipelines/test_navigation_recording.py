# SPDX-License-Identifier: MIT
"""What a closed loop leaves in a recording, read back."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from scripted_loop import START_NS, costmap, play

from slamcli.cli.main import run as main
from slamcli.errors import RecordingError
from slamcli.pipelines.convert import convert
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigation_recording import NavigationRecording, RecordingRates
from slamcli.recordings import open_recording

TYPES = {
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/goal": "geometry_msgs/msg/PoseStamped",
    "/move_base/status": "std_msgs/msg/String",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/ground_truth": "nav_msgs/msg/Odometry",
    "/people": "visualization_msgs/msg/MarkerArray",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/amcl_pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/particlecloud": "geometry_msgs/msg/PoseArray",
    "/move_base/local_costmap/costmap": "nav_msgs/msg/OccupancyGrid",
    "/move_base/global_costmap/costmap": "nav_msgs/msg/OccupancyGrid",
    "/plan": "nav_msgs/msg/Path",
    "/local_plan": "nav_msgs/msg/Path",
}


def recorded(path, **options) -> NavigationRecording:
    return NavigationRecording(path, start_ns=START_NS, T_base_laser=np.array([0.1, 0.0, 0.0]), **options)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a recording of four seconds, its simulation and what the listener counted."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    with recorded(path, laser_height_m=0.2) as listener:
        simulation = play([listener])
    return path, simulation, listener.counts


def read(path, topic):
    with open_recording(path) as recording:
        return list(recording.measurements([topic]))


def messages(path):
    with open_recording(path) as recording:
        return [(m.topic, m.log_time_ns, bytes(m.data)) for m in recording.raw.messages(None, None, None)]


def test_every_topic_is_there_with_the_type_that_viewers_expect(run):
    path, _, counts = run
    with open_recording(path) as recording:
        held = {topic.name: topic.msgtype for topic in recording.contents.topics}
        numbers = {topic.name: topic.count for topic in recording.contents.topics}
        latched = {topic.name for topic in recording.contents.topics if topic.latched}
    assert held == TYPES
    assert numbers == counts
    assert {"/tf_static", "/map", "/move_base/global_costmap/costmap"} <= latched


def test_log_times_are_simulated_time_and_never_run_backwards(run):
    times = [time for _, time, _ in messages(run[0])]
    assert times == sorted(times)
    assert times[0] == START_NS
    assert times[-1] == START_NS + 4_000_000_000


def test_frames_lead_from_the_map_to_the_scanner(run):
    path, simulation, _ = run
    with open_recording(path) as recording:
        tree = recording.frames()
        stamps = np.array([START_NS + 1_000_000_000, START_NS + 3_500_000_000])
        poses, known = tree.lookup_many("map", "laser", stamps)
    assert known.all()
    truth, turned = simulation.ride.at(np.array([1.0, 3.5]))
    mount = truth[:, :2] + turned[:, :2, 0] * 0.1
    np.testing.assert_allclose(poses[:, :2, 3], mount, atol=0.05)  # the scripted localiser is 2 cm off
    np.testing.assert_allclose(poses[:, 2, 3], 0.2, atol=1e-9)


def test_ground_truth_comes_twenty_times_a_second_in_step(run):
    stamps = [t.stamp_ns for t in read(run[0], "/ground_truth")]
    assert len(stamps) == 81
    assert all(abs(b - a - 50_000_000) <= 10_000_000 for a, b in pairwise(stamps))


def test_costs_become_occupancy_as_costmap_2d_publishes_them(run):
    (first, *_) = read(run[0], "/move_base/local_costmap/costmap")
    cells = first.grid.cells
    assert first.grid.frame_id == "odom"
    assert (cells[3, 4], cells[5, 6], cells[7, 8]) == (99, 100, -1)
    # 1 + 97 * (cost - 1) // 251 for costs 1 to 252, 0 for 0
    assert cells[0, :5].tolist() == [0, 1, 1, 1, 2]
    assert cells[0, 79] == 1 + 97 * 78 // 251


def test_a_costmap_that_does_not_change_is_written_once_and_a_large_one_rarely(tmp_path, run):
    assert run[2]["/move_base/global_costmap/costmap"] == 1
    with recorded(tmp_path / "r.mcap", rates=RecordingRates(costmaps_s={"global": 0.1})) as listener:
        for i in range(40):
            listener.on_costmap(i * 0.1, "global", costmap("global", centre=(i * 0.05, 0.0), size=700))
    # 490,000 cells: one in 1.96 s
    assert listener.counts["/move_base/global_costmap/costmap"] == 2


def test_particles_are_thinned_and_the_pose_has_its_covariance(run):
    clouds = read(run[0], "/particlecloud")
    assert {len(cloud) for cloud in clouds} == {350}
    pose = read(run[0], "/amcl_pose")[-1]
    assert pose.covariance[0, 0] == 0.01
    assert pose.covariance[1, 1] == 0.02
    assert pose.covariance[5, 5] == 0.03


def test_what_the_localiser_repeats_is_written_once(tmp_path):
    with recorded(tmp_path / "r.mcap") as listener:
        play([_Repeating(listener)], seconds=1.0)
    assert listener.counts["/particlecloud"] == 1
    assert listener.counts["/amcl_pose"] == 1


class _Repeating(LoopListener):
    """Passes odometry and the localiser's first word on, again and again."""

    def __init__(self, listener):
        self._listener, self._first = listener, None

    def on_odometry(self, time_s, odometry):
        self._listener.on_odometry(time_s, odometry)

    def on_localisation(self, time_s, *told):
        self._first = self._first or told
        self._listener.on_localisation(time_s, *self._first)


def test_commands_and_states_are_readable(run):
    command = read(run[0], "/cmd_vel")[5]
    assert command.linear_m_s.tolist() == [0.4, 0.0, 0.0]
    assert command.angular_rad_s.tolist() == [0.0, 0.0, 0.1]
    assert [said.text for said in (read(run[0], "/move_base/status")[i] for i in (0, 1, -1))] == [
        "planning", "controlling", "succeeded: goal reached",
    ]  # fmt: skip


def test_nobody_about_is_no_marker(tmp_path):
    with recorded(tmp_path / "r.mcap") as listener:
        listener.on_people(0.0, np.zeros((0, 5)))
    assert listener.counts["/people"] == 1


def test_the_same_run_gives_the_same_bytes(tmp_path, run):
    with recorded(tmp_path / "again.mcap", laser_height_m=0.2) as listener:
        play([listener])
    assert (tmp_path / "again.mcap").read_bytes() == run[0].read_bytes()


@pytest.mark.parametrize("name", ["run.bag", "run_folder"])
def test_other_containers_and_back_lose_nothing(tmp_path, run, name):
    convert([run[0]], tmp_path / name)
    convert([tmp_path / name], tmp_path / "back.mcap")
    assert messages(tmp_path / "back.mcap") == messages(run[0])


def test_a_bag_is_written_directly_too(tmp_path, run):
    with recorded(tmp_path / "run.bag") as listener:
        play([listener])
    assert listener.counts == run[2]


def test_a_map_is_built_from_it(tmp_path, run):
    assert main(["map", "--algo", "gmapping", str(run[0]), "-o", str(tmp_path / "map"), "-q"]) == 0
    assert (tmp_path / "map" / "map.yaml").is_file()
    assert main(["evaluate", f"{run[0]}:/odom", f"{run[0]}:/ground_truth"]) == 0


def test_a_run_that_fails_leaves_no_file(tmp_path):
    with pytest.raises(RecordingError), recorded(tmp_path / "r.mcap"):
        raise RecordingError("stop")
    assert not list(tmp_path.iterdir())


def test_a_goal_is_not_drawn_as_a_way_that_was_driven(tmp_path, run, capsys):
    assert main(["view", str(run[0]), "-o", str(tmp_path / "v.png"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert "/goal" in json.dumps(document["topics"])
    assert "/goal in map" not in json.dumps(document)


def test_a_costmap_that_is_not_published_is_not_written(tmp_path):
    with recorded(tmp_path / "r.mcap", rates=RecordingRates(costmaps_s={"local": math.inf})) as listener:
        listener.on_costmap(0.0, "local", costmap("local"))
        listener.on_costmap(0.0, "global", costmap("global"))
    assert set(listener.counts) == {"/tf_static", "/move_base/global_costmap/costmap"}
