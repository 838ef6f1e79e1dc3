# SPDX-License-Identifier: MIT
"""Where the long-term memory lies while a map is made, and databases that are mapped once more."""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import RecordingError, UsageError
from slamcli.geometry import quaternion, se3
from slamcli.gmapping import TIER as GMAPPING
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import ImuSample, LaserScan, Measurement, Odometry, RgbdFrame, SessionStart
from slamcli.outputs import check_directory
from slamcli.pipelines.config import load_native
from slamcli.pipelines.database_facts import database_facts
from slamcli.pipelines.database_input import are_databases, open_databases
from slamcli.pipelines.database_poses import read_database_graph, read_database_poses
from slamcli.pipelines.databases import DatabaseRequest, running_file
from slamcli.pipelines.map import run_map
from slamcli.pipelines.map_request import MapRequest
from slamcli.pipelines.scan_cloud import cloud_of
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.pipelines.visual_places import AtlasChoices
from slamcli.recordings import create_recording
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.rtabmap import TIER, RtabmapTier
from slamcli.rtabmap.database import Database, is_database, is_in_use
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.signature import NodeImages, NodeScan, Signature, no_features
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.vision.pinhole import Pinhole

S = 1_000_000_000
START = 1_700_000_000 * S
T_BASE_CAMERA = se3.from_position_quaternion(np.array([0.1, 0.0, 0.4]), np.array([-0.5, 0.5, -0.5, 0.5]))


def pose(x: float) -> NDArray[np.float64]:
    T = np.eye(4)
    T[0, 3] = x
    return T


def images(value: int, fx: float = 30.0) -> NodeImages:
    camera = Pinhole(fx=fx, fy=30.0, cx=15.5, cy=11.5, width=32, height=24)
    return NodeImages(
        colour=np.full((24, 32, 3), value, np.uint8), camera=camera, T_base_camera=T_BASE_CAMERA,
        depth=np.full((24, 32), 2.0, np.float32),
    )  # fmt: skip


def flat_scan(i: int) -> NodeScan:
    points = np.column_stack([np.linspace(1.0, 3.0, 7), np.full(7, 0.1 * i), np.full(7, 0.3)]).astype(np.float32)
    return NodeScan(points=points, planar=True, T_base_sensor=se3.from_position_quaternion(np.array([0.2, 0.0, 0.3]), np.array([0.0, 0.0, 0.0, 1.0])), range_max_m=10.0)  # fmt: skip


def signature(i: int, map_id: int, scan: NodeScan | None, stamp_ns: int | None = None) -> Signature:
    return Signature(
        id=i, map_id=map_id, stamp_ns=START + i * S if stamp_ns is None else stamp_ns, T_odom_base=pose(0.1 * i), features=no_features(),
        points=np.zeros((0, 3)), word_ids=np.zeros(0, dtype=np.int64), scan=scan,
    )  # fmt: skip


def write(
    path: Path, maps: tuple[int, ...] = (0, 0, 0, 1, 1), *, fx: float = 30.0, optimised: bool = True, scans: bool = True,
    seen: bool = True, text: str = "Kp/MaxFeatures:300;Rtabmap/DetectionRate:2;Rtabmap/WorkingDirectory:/tmp",
) -> Path:  # fmt: skip
    """Write a database: a node for each entry of `maps`, a second apart; neighbours are 0.1 m apart, 0.01 m^2 uncertain."""
    with Database.create(path, text) as database:
        for i, map_id in enumerate(maps, start=1):
            database.add_node(
                signature(i, map_id, flat_scan(i) if scans else None), weight=0, images=images(10 * i, fx) if seen else None
            )  # fmt: skip
        pairs = [(i, i + 1) for i in range(1, len(maps)) if maps[i - 1] == maps[i]]
        database.add_links(
            Link(from_id=a, to_id=b, kind=LinkKind.NEIGHBOR, T_from_to=pose(0.1), information=np.eye(6) * 100.0)
            for a, b in pairs
        )
        database.add_links(
            [Link(from_id=1, to_id=len(maps), kind=LinkKind.GLOBAL_CLOSURE, T_from_to=pose(0.4), information=np.eye(6))]
        )
        if optimised:
            ids = np.arange(1, len(maps), dtype=np.int64)
            database.set_optimised(ids, np.array([pose(0.2 * i) for i in ids]), None)
    return path


class Opened:
    """What a database gives to rtabmap."""

    def __init__(self, *paths: Path, sets: tuple[str, ...] = (), **asked: Any) -> None:
        self.log = RunLog()
        config = load_native("rtabmap", (), sets, self.log)
        window = {key: asked.pop(key) for key in ("mode", "start_s", "duration_s") if key in asked}
        with open_databases(paths, TIER, config, SensorRequest(names=TopicNames(**asked), **window), self.log) as feed:
            self.feed = feed
            self.measurements = list(feed.measurements())
            self.length_s = feed.length_s
        self.kinds = Counter(type(m).__name__ for m in self.measurements)


def test_nodes_are_measured_once_more(tmp_path: Path) -> None:
    found = Opened(write(tmp_path / "a.db"))
    assert found.kinds == {"Odometry": 5, "LaserScan": 5, "RgbdFrame": 5, "SessionStart": 1}
    assert [type(m) for m in found.measurements[:3]] == [Odometry, LaserScan, RgbdFrame]
    start = next(i for i, m in enumerate(found.measurements) if isinstance(m, SessionStart))
    assert start == 9
    first, second = (m for m in found.measurements[:6] if isinstance(m, Odometry))
    assert (first.stamp_ns, first.covariance) == (START + S, None)
    np.testing.assert_allclose(second.position_m, [0.2, 0.0, 0.0], atol=1e-6)
    assert second.covariance is not None
    np.testing.assert_allclose(second.covariance, np.eye(6) * 0.01)
    scan = next(m for m in found.measurements if isinstance(m, LaserScan))
    back = cloud_of(scan).points_m  # by angle; the beams are finer than the points lie apart
    np.testing.assert_allclose(back[-1], [0.8, 0.1, 0.0], atol=2e-3)
    assert (len(back), scan.range_max_m) == (7, 10.0)
    np.testing.assert_allclose(found.feed.T_base_laser["/scan"][:3, 3], [0.2, 0.0, 0.3], atol=1e-6)
    frame = next(m for m in found.measurements if isinstance(m, RgbdFrame))
    assert (frame.colour.encoding, frame.colour.pixels.shape) == ("rgb8", (24, 32, 3))
    assert frame.depth.pixels[0, 0] == pytest.approx(2.0)
    rig = found.feed.rig
    assert rig is not None
    assert (rig.mode, rig.main.intrinsics[0, 0], rig.rate_hz) == ("rgbd", 30.0, 1.0)
    np.testing.assert_allclose(rig.T_base_main, T_BASE_CAMERA, atol=1e-6)
    assert found.length_s == pytest.approx(3.0)  # two sessions of 2 s and 1 s


def test_gravity_comes_along(tmp_path: Path) -> None:
    path = write(tmp_path / "a.db")
    tilted = se3.from_position_quaternion(np.zeros(3), quaternion.from_roll_pitch_yaw(0.1, -0.3, 0.0))
    with Database.append(path) as database:
        link = Link(from_id=2, to_id=2, kind=LinkKind.GRAVITY, T_from_to=tilted, information=np.eye(6))
        database.add_links([link])
    found = Opened(path)
    (sample,) = (m for m in found.measurements if isinstance(m, ImuSample))
    assert (sample.stamp_ns, sample.topic) == (START + 2 * S, "/imu")
    assert sample.quat_xyzw is not None
    np.testing.assert_allclose(quaternion.to_matrix(sample.quat_xyzw), tilted[:3, :3], atol=1e-6)
    np.testing.assert_allclose(tilted[:3, :3] @ sample.acceleration_m_s2, [0.0, 0.0, 9.81], atol=1e-5)
    np.testing.assert_array_equal(found.feed.T_base_sensor["/imu"], np.eye(4))
    assert "ImuSample" not in Opened(path, imu="none").kinds


def test_its_parameters_lie_beneath_those_of_the_user(tmp_path: Path) -> None:
    path = write(tmp_path / "a.db")
    parameters = Opened(path).feed.plan.parameters
    assert (parameters.kp.max_features, parameters.rtabmap.detection_rate) == (300, 0.0)
    asked = Opened(path, sets=("Kp/MaxFeatures=700", "Rtabmap/DetectionRate=1")).feed.plan.parameters
    assert (asked.kp.max_features, asked.rtabmap.detection_rate) == (700, 1.0)
    localised = write(tmp_path / "c.db", text="Mem/IncrementalMemory:false;Kp/MaxFeatures:300")
    mem = Opened(localised).feed.plan.parameters.mem
    assert mem.incremental_memory  # what its last session was for; this one maps
    found = Opened(write(tmp_path / "b.db", text="Kp/MaxFeatures:many"))
    assert any("values that slamcli has not are left out: Kp/MaxFeatures many" in line for line in found.log.warnings)
    assert found.feed.plan.parameters.kp.max_features == 500


def test_parts_of_it(tmp_path: Path) -> None:
    path = write(tmp_path / "a.db")
    assert set(Opened(path, odometry="none", scans=("none",)).kinds) == {"RgbdFrame", "SessionStart"}
    assert set(Opened(path, mode="scan").kinds) == {"Odometry", "LaserScan", "SessionStart"}
    assert Opened(path, start_s=1.0, duration_s=1.0).kinds["RgbdFrame"] == 2  # of each session
    two = Opened(path, write(tmp_path / "b.db", maps=(0, 0)))
    assert (two.kinds["RgbdFrame"], two.kinds["SessionStart"]) == (7, 2)
    assert [m.source for m in two.measurements if isinstance(m, SessionStart)] == ["a.db, map 1", "b.db, map 0"]
    assert set(Opened(write(tmp_path / "c.db", seen=False)).kinds) == {"Odometry", "LaserScan", "SessionStart"}


def test_what_does_not_fit(tmp_path: Path) -> None:
    path = write(tmp_path / "a.db")
    with pytest.raises(UsageError, match=r"--odom-topic /odom: a database has no topics"):
        Opened(path, odometry="/odom")
    with pytest.raises(UsageError, match="--mode mono: rtabmap has rgbd, stereo, scan"):
        Opened(path, mode="mono")
    with pytest.raises(UsageError, match="their cameras differ"):
        Opened(path, write(tmp_path / "b.db", fx=50.0))
    with pytest.raises(RecordingError, match="no node with images or a scan"):
        Opened(write(tmp_path / "c.db", seen=False, scans=False))
    other = tmp_path / "other.db"
    sqlite3.connect(other).execute("CREATE TABLE t (a)").connection.close()
    assert (is_database(path), is_database(other), is_database(tmp_path), is_database(tmp_path / "no")) == (
        True, False, False, False,
    )  # fmt: skip
    with pytest.raises(UsageError, match=r"is a database of RTAB-Map and .*other.db is not"):
        are_databases([path, other])


def test_facts_and_poses(tmp_path: Path) -> None:
    path = write(tmp_path / "a.db")
    facts = database_facts(path)
    assert (facts.nodes, facts.optimised, facts.counts.with_images, facts.counts.with_scans) == (5, 4, 5, 5)
    assert facts.links == {"neighbor": 3, "global_closure": 1}
    assert facts.closures_between_sessions == 1
    assert [(s.map_id, s.nodes, s.first_id, s.last_id) for s in facts.sessions] == [(0, 3, 1, 3), (1, 2, 4, 5)]
    assert facts.sensors == ("colour images of 32 x 24 pixels with depth", "planar scans of 7 points up to 10 m")
    assert facts.changed == {"Kp/MaxFeatures": "300", "Rtabmap/DetectionRate": "2"}
    optimised = read_database_poses(path)
    np.testing.assert_allclose(optimised.positions_m[:, 0], [0.2, 0.4, 0.6, 0.8], atol=1e-6)
    assert len(read_database_poses(path, "odometry")) == 5
    with pytest.raises(UsageError, match=r"no part 'x' in a database; give .*a.db:optimised"):
        read_database_poses(path, "x")
    graph = read_database_graph(path, RunLog())
    assert graph.ids.tolist() == [1, 2, 3, 4, 5]
    # Node 5 was not optimised: it follows node 4, of the same session, by odometry.
    np.testing.assert_allclose(graph.poses[:, 0], [0.2, 0.4, 0.6, 0.8, 0.9], atol=1e-6)
    assert sorted(zip(graph.first.tolist(), graph.second.tolist(), strict=True)) == [(1, 2), (1, 5), (2, 3), (4, 5)]
    log = RunLog()
    assert len(read_database_poses(write(tmp_path / "b.db", optimised=False), log=log)) == 5
    assert "the poses are those of odometry" in log.notes[0]


class Writing:
    """A mapper that writes a node for each frame, and fails where it is told to."""

    def __init__(self, setup: Setup, fail_at: int) -> None:
        assert setup.database is not None
        self.choice, self._fail_at, self.stamps = setup.database, fail_at, list[int]()
        path = self.choice.path
        self._database = Database.append(path) if self.choice.append else Database.create(path, "")
        self._first = len(self._database.nodes()) + 1

    def process(self, measurement: Measurement) -> None:
        if isinstance(measurement, LaserScan):
            if len(self.stamps) == self._fail_at:
                self._database.close()
                raise RecordingError("it breaks here")
            self._database.add_node(signature(self._first + len(self.stamps), 0, None, measurement.stamp_ns), weight=0)
            self._database.commit()
            self.stamps.append(measurement.stamp_ns)

    def finish(self) -> MappingResult:
        self._database.close()
        num = len(self.stamps)
        quats = np.tile([0.0, 0.0, 0.0, 1.0], (num, 1))
        stamps = np.array(self.stamps, dtype=np.int64)
        trajectory = Trajectory(stamps, np.zeros((num, 3)), quats, "map", "base_link")
        return MappingResult(trajectory=trajectory, database=self.choice.path)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        for i in range(4):
            writer.write("/scan", LaserScan(
                stamp_ns=START + i * S, frame_id="laser", angle_min_rad=-1.0, angle_increment_rad=0.5, range_min_m=0.1, range_max_m=9.0,
                ranges_m=np.ones(5, np.float32),
            ))  # fmt: skip
    return path


def mapped(
    monkeypatch: pytest.MonkeyPatch, bag: Path, output: Path, request: DatabaseRequest | None = None, fail_at: int = -1
) -> RunLog:
    monkeypatch.setattr(RtabmapTier, "build", lambda self, parameters, setup: Writing(setup, fail_at))
    log = RunLog()
    run_map(MapRequest(algo="rtabmap", inputs=[bag], output=output, database=request or DatabaseRequest()), log)
    return log


def num_nodes(path: Path) -> int:
    with Database.read(path) as database:
        return len(database.nodes())


def test_the_database_ends_in_the_folder(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = tmp_path / "out"
    mapped(monkeypatch, bag, output)
    assert num_nodes(output / "rtabmap.db") == 4
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "out"]
    assert "rtabmap.db" in json.loads((output / "run.json").read_text())["outputs"]
    first = (output / "rtabmap.db").read_bytes()
    mapped(monkeypatch, bag, output)  # an earlier run's goes away with it
    assert (output / "rtabmap.db").read_bytes() == first


def test_what_a_killed_run_left_is_moved_aside(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = tmp_path / "out"
    with pytest.raises(RecordingError, match="it breaks here"):
        mapped(monkeypatch, bag, output, fail_at=2)
    left = running_file(output)
    assert left == tmp_path / "out.running.db"
    assert num_nodes(left) == 2
    log = mapped(monkeypatch, bag, output)
    assert num_nodes(tmp_path / "out.interrupted-1.db") == 2
    assert any("out.interrupted-1.db now (--database goes on in it)" in note for note in log.notes)
    assert num_nodes(output / "rtabmap.db") == 4
    assert not left.exists()


def test_a_named_database_stays_and_is_gone_on_from(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "sub" / "home.db"
    request = DatabaseRequest(file=file)
    mapped(monkeypatch, bag, tmp_path / "one", request)
    assert num_nodes(file) == 4
    assert not (tmp_path / "one" / "rtabmap.db").exists()
    mapped(monkeypatch, bag, tmp_path / "two", request)
    assert num_nodes(file) == 8
    log = mapped(monkeypatch, bag, tmp_path / "two", DatabaseRequest(file=file, anew=True))
    assert num_nodes(file) == 4
    assert any("begun anew" in note for note in log.notes)


def test_nothing_is_left_where_nothing_was_read(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Any, parameters: Any, setup: Setup) -> Any:
        Writing(setup, -1)
        raise UsageError("no")

    monkeypatch.setattr(RtabmapTier, "build", broken)
    for request in (DatabaseRequest(), DatabaseRequest(file=tmp_path / "home.db")):
        with pytest.raises(UsageError, match="no"):
            run_map(MapRequest(algo="rtabmap", inputs=[bag], output=tmp_path / "out", database=request), RunLog())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap"]


def test_a_run_that_fails_says_where_its_nodes_are(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = RunLog()
    for fail_at, left in ((0, []), (2, ["out.running.db"])):  # without a node nothing stays, whatever was measured
        monkeypatch.setattr(RtabmapTier, "build", lambda self, parameters, setup, at=fail_at: Writing(setup, at))
        with pytest.raises(RecordingError, match="it breaks here"):
            run_map(MapRequest(algo="rtabmap", inputs=[bag], output=tmp_path / "out"), log)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", *left]
    assert [warning for warning in log.warnings if "2 nodes made so far" in warning] == log.warnings[-1:]


def test_an_interrupted_run_leaves_no_copy_of_a_map_that_stays_as_it_is(
    tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: Any, parameters: Any, setup: Setup) -> Any:
        assert setup.database is not None
        assert setup.database.path.is_file()
        raise KeyboardInterrupt

    file = write(tmp_path / "home.db", maps=(0, 0))
    monkeypatch.setattr(RtabmapTier, "build", interrupted)
    request = MapRequest(
        algo="rtabmap", inputs=[bag], output=tmp_path / "out", database=DatabaseRequest(file=file), atlas=AtlasChoices(localise_only=True),
    )  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        run_map(request, RunLog())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "home.db"]


def test_an_empty_one_that_was_left_is_no_loss(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Database.create(running_file(tmp_path / "out"), ""):
        pass
    log = mapped(monkeypatch, bag, tmp_path / "out")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "out"]
    assert not any("did not end" in note for note in log.notes)


def test_a_map_that_stays_as_it_is(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(tmp_path / "home.db", maps=(0, 0))
    seen: list[tuple[Setup, Any]] = []

    def build(self: Any, parameters: Any, setup: Setup) -> Any:
        seen.append((setup, parameters))
        raise UsageError("enough")

    monkeypatch.setattr(RtabmapTier, "build", build)
    for how in ({"atlas": AtlasChoices(localise_only=True)}, {"sets": ("Mem/IncrementalMemory=false",)}):
        request = MapRequest(
            algo="rtabmap", inputs=[bag], output=tmp_path / "out", database=DatabaseRequest(file=file), **how
        )  # type: ignore[arg-type]
        with pytest.raises(UsageError, match="enough"):
            run_map(request, RunLog())
        setup, parameters = seen[-1]
        assert setup.localise_only
        assert not parameters.mem.incremental_memory
        assert setup.database is not None
        assert (setup.database.append, setup.database.keep) == (True, False)  # a copy
        assert setup.database.path == running_file(tmp_path / "out")
        assert not setup.database.path.exists()
    with pytest.raises(UsageError, match="name the database to localise in"):
        run_map(MapRequest(algo="rtabmap", inputs=[bag], sets=("Mem/IncrementalMemory=false",)), RunLog())
    assert num_nodes(file) == 2
    bytes_before = file.read_bytes()
    monkeypatch.setattr(RtabmapTier, "build", lambda self, parameters, setup: Writing(setup, -1))
    atlas = AtlasChoices(localise_only=True)
    run_map(
        MapRequest(
            algo="rtabmap", inputs=[bag], output=tmp_path / "out", database=DatabaseRequest(file=file), atlas=atlas
        ),
        RunLog(),
    )
    assert file.read_bytes() == bytes_before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "home.db", "out"]
    assert not (tmp_path / "out" / "rtabmap.db").exists()


def test_a_database_in_use_is_left_alone(tmp_path: Path, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = write(running_file(tmp_path / "out"))
    assert not is_in_use(left)
    with Database.append(left):
        assert is_in_use(left)
        with pytest.raises(UsageError, match=r"out.running.db: another process uses this database"):
            mapped(monkeypatch, bag, tmp_path / "out")
    assert left.exists()


def test_options_that_cannot_be(tmp_path: Path, bag: Path) -> None:
    output, file = tmp_path / "out", write(tmp_path / "home.db")
    check_directory(output)

    def check(request: DatabaseRequest, tier: Any = TIER, *, localise_only: bool = False) -> None:
        request.check(tier, [bag], output, localise_only=localise_only)

    for request, tier, localise, why in (
        (DatabaseRequest(file=file), GMAPPING, False, "--database: gmapping keeps no database; --algo rtabmap does"),
        (DatabaseRequest(anew=True), TIER, False, "--delete-db-on-start: name the database with --database"),
        (DatabaseRequest(), TIER, True, "name the database to localise in with --database"),
        (DatabaseRequest(file=tmp_path), TIER, False, "a folder; name a file"),
        (DatabaseRequest(file=bag), TIER, False, "it is the recording as well"),
        (DatabaseRequest(file=output / "x.db"), TIER, False, "lies in the folder of the result"),
        (DatabaseRequest(file=tmp_path / "no.db"), TIER, True, "there is no database"),
        (DatabaseRequest(file=file, anew=True), TIER, True, "there would be no map to localise in"),
        (DatabaseRequest(file=bag / "x.db"), TIER, False, "is a file"),
    ):
        with pytest.raises(UsageError, match=why):
            check(request, tier, localise_only=localise)
    check(DatabaseRequest(file=file), localise_only=True)
    check(DatabaseRequest(file=tmp_path / "new" / "x.db"))
