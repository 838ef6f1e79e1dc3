# SPDX-License-Identifier: MIT
"""Sessions of the rtabmap tier: joined maps and localisation against the uncut recording, and a circuit driven ten times.

    python benchmarks/rtabmap_sessions.py cut --data /tmp/synth --real ../shared/data [name ...]
    python benchmarks/rtabmap_sessions.py laps --laps 10 --set Rtabmap/MemoryThr=50

`cut`: a recording is mapped whole, in two sessions with a gap, and its second part is localised in the map of the first. Errors are
those of the nodes (of both sessions in the joined map) and of the second part's frames, aligned. `laps`: nodes with features of a
generated street that is driven again and again, fed into a session without odometry or images; CPU time of this process.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

import numpy as np

ROOT = pathlib.Path(__file__).parents[1]


@dataclass(frozen=True)
class Cut:
    """A recording, its truth, and where it is cut (seconds after its start)."""

    path: str
    truth: str
    first_s: float
    second_s: float
    real: bool = False
    options: tuple[str, ...] = ()


CUTS = {
    "room_rgbd": Cut("room_rgbd.mcap", "room_rgbd.truth.tum", 12.0, 16.0),
    "loop_rgbd": Cut("loop_rgbd.mcap", "loop_rgbd.truth.tum", 26.0, 29.0),
    "street_stereo": Cut("street_stereo.mcap", "street_stereo.truth.tum", 15.0, 17.0),
    "redkitchen": Cut("visual/redkitchen", "visual/redkitchen/groundtruth.tum", 12.0, 14.0, True, ("--mode", "rgbd")),
    "court": Cut("court.mcap", "court.truth.tum", 900.0, 1000.0),
}


def mapped(recording: str, out: pathlib.Path, *words: str) -> dict[str, float]:
    """Map; return seconds and what run.json says of it."""
    began = time.perf_counter()
    run = subprocess.run(
        [sys.executable, "-m", "slamcli", "map", "--algo", "rtabmap", recording, "-o", str(out), *words],
        capture_output=True,
        text=True,
    )
    if run.returncode:
        print(run.stderr.strip().splitlines()[-1], flush=True)
        return {}
    for line in run.stderr.splitlines():
        if "nodes" in line:
            print("   ", line)
    return {"seconds": time.perf_counter() - began, **json.loads((out / "run.json").read_text())["summary"]}


def error(estimate: pathlib.Path, truth: pathlib.Path) -> float:
    """RMSE of positions after alignment, metres."""
    run = subprocess.run(
        [sys.executable, "-m", "slamcli", "evaluate", str(estimate), str(truth), "--align-type", "se3", "--json"],
        capture_output=True,
        text=True,
    )
    return float(json.loads(run.stdout)["ate"]["rmse"]) if run.returncode == 0 else float("nan")


def cut(args: argparse.Namespace) -> None:
    """Compare joined maps and localisation with the uncut recording."""
    print("recording, uncut nodes/frames m, joined nodes/frames m, ratio of nodes, localised frames m (share placed)")
    for name in args.names or CUTS:
        one = CUTS[name]
        base = args.real if one.real else args.data
        recording, truth = str(base / one.path), base / one.truth
        with tempfile.TemporaryDirectory(dir=args.work) as folder:
            out = pathlib.Path(folder)
            mapped(recording, out / "whole", *one.options)
            mapped(recording, out / "a", "--duration", str(one.first_s), "--database", str(out / "m.db"), *one.options)
            (out / "fixed.db").write_bytes((out / "m.db").read_bytes())
            second = ["--start", str(one.second_s), *one.options]
            both = mapped(recording, out / "b", "--database", str(out / "m.db"), *second)
            found = mapped(recording, out / "l", "--database", str(out / "fixed.db"), "--localise-only", *second)
            rows = [
                (error(out / part / "keyframes.tum", truth), error(out / part / "trajectory.tum", truth))
                for part in ("whole", "b", "l")
                if (out / part).exists()
            ]
            same = (out / "fixed.db").stat().st_size
            ratio = rows[1][0] / rows[0][0] if len(rows) > 1 else float("nan")
            print(name, rows, both.get("sessions joined"), both.get("nodes in the map"), ratio)
            print("   localised", found.get("frames"), found.get("in other maps"), same, flush=True)


class Ring:
    """Two walls along a circle; a robot drives between them and sees those points that are near."""

    def __init__(self, *, places: int, per_place: int = 1000) -> None:
        sys.path.insert(0, str(ROOT / "tests" / "rtabmap"))
        import visual_worlds

        self.motion_world, self._rng = visual_worlds, np.random.default_rng(0)
        self.radius_m, self.places = 2.0 * places / (2.0 * np.pi), places
        count = places * per_place
        angle = self._rng.uniform(0.0, 2.0 * np.pi, count)
        radius = self.radius_m + self._rng.choice([-3.0, 3.0], count)
        height = self._rng.uniform(-1.0, 2.5, count)
        self.points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
        self.descriptors = self._rng.integers(0, 256, (count, 32), dtype=np.uint8)

    def pose(self, step: int) -> np.ndarray:
        """Where the robot is at a step, float64 (4, 4); laps differ a little."""
        angle = 2.0 * np.pi * step / self.places
        radius = self.radius_m + 0.3 * np.sin(step / self.places)
        place = (radius * np.cos(angle), radius * np.sin(angle), 0.0)
        return self.motion_world.motion(*place, rotvec=(0.0, 0.0, angle + 0.5 * np.pi))

    def look(self, pose: np.ndarray) -> tuple:
        """Features and points that are seen from a pose."""
        near = np.linalg.norm(self.points - pose[:3, 3], axis=1) < 12.0
        seen = self.motion_world.signature(
            1, pose, self.points[near], self.descriptors[near], rng=self._rng, noise_px=0.5, flips=0.04, unknown=0.2
        )
        return seen.features, seen.points


def memory_mb() -> float:
    """What this process holds now."""
    pages = int(pathlib.Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def laps(args: argparse.Namespace) -> None:
    """Drive a circuit again and again; print what each lap took."""
    sys.path.insert(0, str(ROOT / "tests" / "rtabmap"))
    from session_worlds import opened

    from slamcli.pipelines.config import load_native
    from slamcli.rtabmap.links import CLOSURES
    from slamcli.rtabmap.node_input import NodeInput
    from slamcli.runtime import RunLog

    parameters = load_native("rtabmap", [], args.sets, RunLog(), []).parameters
    world, gone = Ring(places=args.places), set[int]()
    rng = np.random.default_rng(1)
    print(
        "lap  nodes  CPU per update: mean, 95 %, most (ms)  RSS MB  closures  with places that had been transferred  words"
    )
    with tempfile.TemporaryDirectory(dir=args.work) as folder:
        session = opened(pathlib.Path(folder) / "laps.db", parameters)
        T_odom = world.pose(0)
        for lap in range(args.laps):
            times: list[float] = []
            back = 0
            for step in range(lap * args.places, (lap + 1) * args.places):
                if step:
                    noise = np.concatenate([rng.normal(0.0, 0.01, 3), rng.normal(0.0, 0.002, 3)])
                    moved = np.linalg.inv(world.pose(step - 1)) @ world.pose(step)
                    T_odom = T_odom @ moved @ world.motion_world.motion(*noise[:3], rotvec=noise[3:])
                features, points = world.look(world.pose(step))
                node = NodeInput(
                    stamp_ns=10**18 + step * 10**9, T_odom_base=T_odom, covariance=np.diag([4e-4] * 3 + [1.6e-5] * 3),
                    began_anew=step == 0, features=features, points=points,
                )  # fmt: skip
                began = time.process_time()
                session.update(node)
                times.append(1e3 * (time.process_time() - began))
                tied = [
                    link.from_id for link in session.graph.links_of(session.records[-1].node) if link.kind in CLOSURES
                ]
                back += any(old in gone for old in tied)
                gone.update(session.graph.nodes.keys() - {*session.memory.short_term, *session.memory.working})
            records = session.records[lap * args.places :]
            closed = [one.loop_closure for one in records if one.loop_closure]
            near = sum(one.proximity_closures for one in records)
            print(
                lap + 1, len(session.graph.nodes), *(f"{v:.0f}" for v in (np.mean(times), np.quantile(times, 0.95), max(times))),
                f"{memory_mb():.0f}", len(closed), back, len(session.memory.dictionary), f"near {near}",
                f"retrieved {sum(one.retrieved for one in records)} transferred {sum(one.transferred for one in records)}",
                f"working {records[-1].working} optimised {records[-1].optimised}", flush=True,
            )  # fmt: skip
        for when in ("as it ran", "with everything optimised"):
            off = [
                np.linalg.norm(session.graph.T_map_base[k + 1][:3, 3] - world.pose(k)[:3, 3]) for k in range(step + 1)
            ]
            print(f"{when}: errors of nodes {np.sqrt(np.mean(np.square(off))):.3f} m RMS, {max(off):.3f} m at most")
            session._optimise_all()  # noqa: SLF001 - as `finish` does, without looking for more closures
        session.keeping.database.close()


def main() -> None:
    """Run one of the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(required=True)
    one = kinds.add_parser("cut")
    one.add_argument("names", nargs="*")
    one.add_argument("--data", type=pathlib.Path, default=pathlib.Path("/tmp/synth"))
    one.add_argument("--real", type=pathlib.Path, default=ROOT.parent / "shared/data")
    one.add_argument("--work", type=pathlib.Path, default=None)
    one.set_defaults(run=cut)
    two = kinds.add_parser("laps")
    two.add_argument("--laps", type=int, default=10)
    two.add_argument("--places", type=int, default=100, help="nodes of a lap")
    two.add_argument("--set", dest="sets", action="append", default=[])
    two.add_argument("--work", type=pathlib.Path, default=None)
    two.set_defaults(run=laps)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
