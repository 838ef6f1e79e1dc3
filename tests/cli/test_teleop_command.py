# SPDX-License-Identifier: MIT
"""``slamcli teleop``: with a script, and by keys in a pseudo-terminal."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.cli.teleop_screen import Pace, drive_by_keys
from slamcli.pipelines.teleop import Teleop
from slamcli.pipelines.teleop_request import TeleopRequest
from slamcli.recordings import open_recording

ENTER, LEAVE = b"\x1b[?1049h", b"\x1b[?25h\x1b[?1049l"


def test_without_a_terminal_one_line_names_the_script(tmp_path, capsys):
    assert run(["teleop", "office", str(tmp_path / "o.mcap")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "give --script FILE" in said
    assert list(tmp_path.iterdir()) == []


def test_a_scripted_drive_can_be_mapped(tmp_path, capsys):
    script, out = tmp_path / "s.csv", tmp_path / "o.mcap"
    script.write_text("duration,vx,wz\n6,0.5,0\n2,0,0.8\n")
    truth = tmp_path / "t.tum"
    options = ["--set", "laser.beams=91", "--set", "laser.fov=270", "--seed", "5", "--people", "1", "--json"]
    assert run(["teleop", "office", str(out), "--script", str(script), "--truth", str(truth), *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["seed"] == 5
    assert document["settings"]["people.count"] == 1
    assert document["duration_s"] == 8.0
    assert document["length_m"] == pytest.approx(3.0, abs=0.05)
    assert document["collisions"] == []
    assert run(["map", "--algo", "gmapping", str(out), "-o", str(tmp_path / "room"), "-q"]) == 0
    capsys.readouterr()
    assert (tmp_path / "room" / "map.yaml").exists()
    assert run(["evaluate", str(tmp_path / "room" / "trajectory.tum"), str(truth), "--json"]) == 0
    scores = capsys.readouterr().out
    assert '"rmse"' in scores


def test_a_person_reads_one_line(tmp_path, capsys):
    script = tmp_path / "s.csv"
    script.write_text("2,5,0\n")
    arguments = [
        "teleop",
        "office",
        str(tmp_path / "o.bag"),
        "--script",
        str(script),
        "--start",
        "2,8.8,-90deg",
        "--max-time",
        "1.9",
    ]
    assert run(arguments) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert "office: 1.9 s" in said.err
    assert "1 contact, seed 0 -> " in said.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--speed", "2"], "--speed and --key-timeout are for the keyboard"),
        (["--start", "1"], "--start 1: write it as X,Y"),
        (["--set", "robot.speedy=1"], "unknown parameter 'robot.speedy'"),
        (["--set", "nonsense"], "write it as KEY=VALUE"),
        (["--max-time", "-1"], "--max-time -1 s"),
        (["--slam", "gmapping", "--slam-set", "particles=nan"], "particles"),
    ],
)
def test_wrong_usage(tmp_path, capsys, options, message):
    script = tmp_path / "s.csv"
    script.write_text("1,0,0\n")
    assert run(["teleop", "office", str(tmp_path / "o.mcap"), "--script", str(script), *options]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["s.csv"]


@pytest.mark.parametrize("options", [["--speed", "0"], ["--speed", "nan"], ["--key-timeout", "-1"]])
def test_wrong_pace(tmp_path, capsys, options):
    assert run(["teleop", "office", str(tmp_path / "o.mcap"), *options]) == 2
    assert options[0] in capsys.readouterr().err


class Person:
    """A terminal at which somebody types at given times of a clock that runs 10 ms a look."""

    def __init__(self, typed):
        self.typed, self.now, self.ended, self.size, self.shown = dict(typed), 0.0, False, (60, 20), []

    def clock(self):
        self.now += 0.001
        return self.now

    def read(self, seconds):
        self.now += seconds
        due = [at for at in self.typed if at <= self.now]
        return "".join(self.typed.pop(at) for at in due)

    def show(self, text):
        self.shown.append(text)


def by_keys(tmp_path, typed, **pace):
    teleop = Teleop(TeleopRequest(world="office", path=tmp_path / "o.mcap", settings={"laser.beams": 31}))
    person = Person(typed)
    with teleop.driving() as robot:
        drive_by_keys(robot, person, Pace(**pace), teleop.true_map(), person.clock)
    return teleop, person


def test_a_key_holds_until_the_next_and_ctrl_c_ends(tmp_path):
    teleop, person = by_keys(tmp_path, {0.5: "i", 2.5: "k", 3.0: "\x03"})
    assert teleop.driven.duration_s == pytest.approx(3.0, abs=0.15)
    assert teleop.driven.length_m == pytest.approx(1.0, abs=0.08)
    assert 25 <= len(person.shown) <= 40
    assert "0.50 m/s" in person.shown[15]
    assert "saving" in person.shown[-1]


def test_the_pace_of_the_clock_and_its_end(tmp_path):
    teleop, person = by_keys(tmp_path, {0.0: "l"}, speed=3.0, max_time_s=4.0)
    assert teleop.driven.duration_s == 4.0
    assert person.now == pytest.approx(4.0 / 3.0, abs=0.1)
    assert teleop.robot.plant.pose[2] - teleop.robot.start[2] == pytest.approx(-4.0 + 2 * np.pi, abs=0.3)


def test_the_robot_stops_after_the_last_key_if_asked_to(tmp_path):
    teleop, _ = by_keys(tmp_path, {0.0: "i", 3.0: "\x03"}, key_timeout_s=0.6)
    assert teleop.driven.length_m == pytest.approx(0.33, abs=0.08)


def test_a_machine_that_is_too_slow_does_not_jump(tmp_path):
    class Slow(Person):
        def show(self, text):
            super().show(text)
            self.now += 2.0

    teleop = Teleop(TeleopRequest(world="office", path=tmp_path / "o.mcap", settings={"laser.beams": 31}))
    person = Slow({7.0: "\x03"})
    with teleop.driving() as robot:
        drive_by_keys(robot, person, Pace(), teleop.true_map(), person.clock)
    assert teleop.driven.duration_s == pytest.approx(0.5 * (len(person.shown) - 1), abs=0.3)


@contextlib.contextmanager
def session(tmp_path, *options):
    """Give a running teleop in a pseudo-terminal of 24 lines of 70 characters: process, what it wrote, and a way to type."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 70, 0, 0))
    before = termios.tcgetattr(slave)
    process = subprocess.Popen(
        [sys.executable, "-m", "slamcli", "teleop", "office", str(tmp_path / "o.mcap"), *options],
        stdin=slave, stdout=subprocess.PIPE, stderr=slave, env={**os.environ, "TERM": "xterm-256color"},
    )  # fmt: skip
    written = bytearray()

    def pump(until, seconds=300.0):  # kernels may have to be compiled first
        end = time.monotonic() + seconds
        while not until() and time.monotonic() < end:
            if select.select([master], [], [], 0.05)[0]:
                written.extend(os.read(master, 65536))

    try:
        pump(lambda: written.count(b"\x1b[H") > 2 or process.poll() is not None)
        yield process, written, pump, master
        pump(lambda: process.poll() is not None)
        pump(lambda: False, 0.2)
        assert process.returncode == 0, written[-2000:]
        assert termios.tcgetattr(slave) == before
        assert written.count(ENTER) == written.count(LEAVE) == 1
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
        os.close(master)
        os.close(slave)


def test_a_drive_in_a_terminal(tmp_path):
    with session(tmp_path, "--speed", "2", "--set", "laser.beams=61", "--json") as (process, written, pump, master):
        os.write(master, b"i")
        frames = written.count(b"\x1b[H")
        pump(lambda: written.count(b"\x1b[H") >= frames + 10 or process.poll() is not None)
        os.write(master, b"\x1a")  # CTRL-Z is a key like any other: it stops the robot
        pump(lambda: written.count(b"\x1b[H") >= frames + 14 or process.poll() is not None)
        os.write(master, b"\x03")
        pump(lambda: process.poll() is not None)
        document = json.loads(process.stdout.read())
    assert document["length_m"] > 0.3
    assert document["messages"]["/cmd_vel"] > 20
    screen = written.split(b"\x1b[H")[5].decode()
    lines = screen.split("\r\n")
    assert len(lines) == 24
    assert "▀" in screen
    assert "CTRL-C: end and save" in screen
    with open_recording([tmp_path / "o.mcap"]) as recording:
        odometry = list(recording.measurements(["/odom"]))
    assert odometry[-1].position_m[0] > 0.3
    assert odometry[-1].linear_m_s[0] == pytest.approx(0.0, abs=1e-6)


def test_a_signal_ends_and_saves_and_the_terminal_is_restored(tmp_path):
    with session(tmp_path, "--set", "laser.beams=31") as (process, written, _pump, _master):
        process.send_signal(signal.SIGTERM)
    assert b"-> " in written
    assert sorted(p.name for p in tmp_path.iterdir()) == ["o.mcap", "o.run.json"]


def test_a_terminal_that_goes_away_ends_the_drive_and_saves_it(tmp_path):
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "slamcli", "teleop", "office", str(tmp_path / "o.mcap"), "--set", "laser.beams=31"],
        stdin=slave, stdout=subprocess.PIPE, stderr=slave, env={**os.environ, "TERM": "xterm-256color"},
    )  # fmt: skip
    os.close(slave)
    written = b""
    while written.count(b"\x1b[H") < 5:
        written += os.read(master, 65536)
    os.close(master)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["o.mcap", "o.run.json"]


def test_the_terminal_is_restored_after_an_error(tmp_path):
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    code = (
        "from slamcli.cli.terminal import Terminal\nwith Terminal() as t:\n    t.show('x')\n    raise ZeroDivisionError"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], stdin=slave, stderr=slave, check=False, timeout=60,
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    said = os.read(master, 65536)
    assert done.returncode == 1
    assert termios.tcgetattr(slave) == before
    assert said.index(ENTER) < said.index(LEAVE) < said.index(b"ZeroDivisionError")
    os.close(master)
    os.close(slave)
