# SPDX-License-Identifier: MIT
"""What recording, film and report of a run cost, beside the run itself: CPU time of a drive through the built-in office.

python benchmarks/navigation_outputs.py [--people 3]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from slamcli.formats.maps import write_map
from slamcli.pipelines.animation import Animation
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigation_recording import NavigationRecording
from slamcli.pipelines.story_teller import StoryTeller
from slamcli.simulation import Simulation, resolve_settings

START, GOALS = (2.0, 8.75, 0.0), ((14.0, 8.8), (18.5, 12.5))


def drive(map_path: Path, people: int, listeners: list[LoopListener]) -> tuple[float, float]:
    """Return simulated seconds and CPU seconds."""
    robot = Navigator(map_path, start=START, people=people)
    for listener in listeners:
        robot.listen(listener)
    began = time.process_time()
    for goal in GOALS:
        robot.go_to(*goal)
    return robot.time_s, time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=3)
    people = parser.parse_args().people
    with tempfile.TemporaryDirectory() as folder:
        map_path = Path(folder) / "office.yaml"
        write_map(map_path, Simulation(open_world("office"), resolve_settings({}, {}), duration_s=1.0).true_map())
        drive(map_path, people, [])  # compiles
        simulated, bare = drive(map_path, people, [])
        print(f"the run alone            {bare:6.2f} s for {simulated:.1f} s: {simulated / bare:.0f} x real time")
        story = drive(map_path, people, [StoryTeller()])[1]
        print(f"what the report needs    {story - bare:+6.2f} s")
        animation, film = Animation(np.zeros(3)), Path(folder) / "run.gif"
        print(f"keeping what is filmed   {drive(map_path, people, [animation])[1] - bare:+6.2f} s")
        began = time.process_time()
        frames = animation.write(film)
        print(
            f"painting the film        {time.process_time() - began:+6.2f} s, {frames} frames, {film.stat().st_size / 1e6:.1f} MB"
        )
        target = Path(folder) / "run.mcap"
        with NavigationRecording(target, start_ns=10**18, T_base_laser=np.zeros(3)) as recording:
            recorded = drive(map_path, people, [recording])[1]
            began = time.process_time()
        closing = time.process_time() - began
        print(f"recording                {recorded - bare + closing:+6.2f} s, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
