# SPDX-License-Identifier: MIT
"""The memory of RTAB-Map: how fast words are found and how many of them, what an update costs, and whether places are known again.

    python benchmarks/appearance_memory.py words ../shared/data/visual/redkitchen/*.color.jpg [--words 200000]
    python benchmarks/appearance_memory.py nodes [--words 200000] [--counts 100 1000 5000]
    python benchmarks/appearance_memory.py places ../shared/data/visual/redkitchen/*.color.jpg [--every 8]
    python benchmarks/appearance_memory.py laps ../shared/data/visual/redkitchen/*.color.jpg [--every 8] [--memory-thr 30] [--count 6]

`words` makes a dictionary of the pictures' descriptors, all but every 100th picture's, and compares the index with brute force for
the others. `nodes` fills a memory with made-up places that show words of one pool and measures updates. `places` goes through the
pictures twice, the second time between those of the first, and prints the posterior of being where it was the first time. `laps` goes
through them again and again with a bound on working memory; accepted hypotheses within 16 pictures become closures.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.formats.pictures import read_grey
from slamcli.rtabmap.dictionary import Dictionary
from slamcli.rtabmap.hypothesis import LoopDetector
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature
from slamcli.vision.binary_index import BinaryIndex
from slamcli.vision.features import Features
from slamcli.vision.orb import OrbSettings, extract_orb

FEATURES = 500


def strongest(picture: Path, number: int) -> Features:
    found = extract_orb(read_grey(picture), OrbSettings(num_features=number)).features
    order = np.argsort(-found.responses, kind="stable")
    return Features(**{name: getattr(found, name)[order] for name in Features.__dataclass_fields__})


def made_up(descriptors: np.ndarray) -> Features:
    column = np.zeros(len(descriptors))
    pixels = np.zeros((len(descriptors), 2))
    return Features(
        pixels=pixels, octaves=np.zeros(len(column), np.int64), angles=column, responses=column, descriptors=descriptors,
        sigmas=column, right=column, depth=column, raw_pixels=pixels,
    )  # fmt: skip


class Robot:
    """A memory and a graph that grows by a node a metre."""

    def __init__(self, memory_thr: int = 0) -> None:
        parameters = RtabmapParameters()
        parameters = replace(parameters, rtabmap=replace(parameters.rtabmap, memory_thr=memory_thr))
        self.nodes: dict[int, Signature] = {}
        self.words: dict[int, np.ndarray] = {}
        self.memory, self.graph = Memory(parameters, self), MapGraph()
        self.detector = LoopDetector(parameters, self.memory, seed=0)
        self.count = 0
        self.seconds: dict[str, float] = {}

    def read_signature(self, node_id: int) -> Signature:
        return self.nodes[node_id]

    def read_words(self, ids: np.ndarray):
        return ids, np.array([self.words[word] for word in ids.tolist()], np.uint8).reshape(-1, 32)

    def see(self, features: Features, words: np.ndarray | None = None, x: float | None = None):
        """Return the hypothesis; `seconds` says what took how long. With the words given, the node is only added."""
        start = time.perf_counter()
        given = self.memory.words_of(features) if words is None else words
        self.seconds = {"words": time.perf_counter() - start}
        self.count += 1
        pose = np.eye(4)
        pose[0, 3] = self.count if x is None else x
        signature = Signature(
            id=self.count, map_id=0, stamp_ns=self.count, T_odom_base=pose, features=features,
            points=np.zeros((len(features), 3)), word_ids=given,
        )  # fmt: skip
        self.graph.add_node(GraphNode(id=self.count, map_id=0, stamp_ns=self.count, T_odom_base=pose), pose)
        if self.count > 1:
            self.tie(self.count - 1, self.count, LinkKind.NEIGHBOR)
        start = time.perf_counter()
        self.memory.add(signature, self.graph)
        self.seconds["add"] = time.perf_counter() - start
        if words is not None:
            return None
        start = time.perf_counter()
        found = self.detector.hypothesis(signature, self.graph)
        self.seconds["hypothesis"] = time.perf_counter() - start
        return found

    def tie(self, a: int, b: int, kind: LinkKind) -> None:
        self.graph.add_link(Link(from_id=a, to_id=b, kind=kind, T_from_to=np.eye(4), information=np.eye(6)))


def words(pictures: list[Path], number: int) -> None:
    dictionary, queries = Dictionary(), []
    for row, picture in enumerate(pictures):
        descriptors = strongest(picture, 1000).descriptors
        if row % 100 == 50:
            queries.append(descriptors[:FEATURES])
        elif len(dictionary) < number:
            dictionary.quantise(descriptors)
    index, (_, found) = BinaryIndex(), dictionary.take_made()
    index.add(found[:number])
    for _ in range(2):  # the first search builds the tables
        index.nearest_two(queries[0])
    print(f"{len(index)} words")
    for query in queries:
        start = time.perf_counter()
        near = index.nearest_two(query)
        taken = time.perf_counter() - start
        start = time.perf_counter()
        all_ = index.nearest_two(query, exact=True)
        exact = time.perf_counter() - start
        same = np.mean(near.distances == all_.distances, axis=0)
        matched = [one.distances[:, 0] <= 0.8 * one.distances[:, 1] for one in (near, all_)]
        print(
            f"{len(query)} descriptors: {1e3 * taken:.1f} ms, brute force {1e3 * exact:.1f} ms; nearest {same[0]:.3f}, second "
            f"{same[1]:.3f}, decision {np.mean(matched[0] == matched[1]):.4f} as by brute force"
        )


def nodes(number: int, counts: list[int]) -> None:
    rng = np.random.default_rng(0)
    pool = rng.integers(0, 256, (number, 32), dtype=np.uint8)

    def chosen(place: int) -> np.ndarray:
        """400 words of the pool, of which the next place shares three quarters."""
        return np.concatenate([np.random.default_rng((place + k) // 4).permutation(number)[:100] for k in range(4)])

    def image(place: int) -> Features:
        """Those words, and 100 key points that are new."""
        noise = np.packbits(rng.random((400, 256)) < 0.05, axis=1)
        return made_up(np.concatenate([pool[chosen(place)] ^ noise, rng.integers(0, 256, (100, 32), dtype=np.uint8)]))

    robot = Robot()
    robot.memory.dictionary.add_words(np.arange(1, number + 1), pool)
    robot.memory.dictionary.refer(np.arange(1, number + 1))
    taken: dict[str, list[float]] = {}
    for place in range(max(counts) + 20):
        since = min((robot.count - count for count in counts if robot.count >= count), default=-1)
        if 0 <= since < 20:
            robot.see(image(place))
            for name, seconds in robot.seconds.items():
                taken.setdefault(name, []).append(1e3 * seconds)
        else:
            robot.see(made_up(np.zeros((400, 32), np.uint8)), chosen(place) + 1)
        if since == 19:
            text = ", ".join(f"{name} {np.median(value[1:]):.1f}" for name, value in taken.items())
            print(f"{robot.count} nodes, {len(robot.memory.dictionary)} words: {text} ms")
            taken = {}
        if robot.count > 100 and robot.count % 2 == 0:  # a loop of 100 m, again and again
            robot.tie(robot.count - 100, robot.count, LinkKind.GLOBAL_CLOSURE)


def places(pictures: list[Path], every: int) -> None:
    first = list(range(0, len(pictures), every))
    second = [row + every // 2 for row in first if row + every // 2 < len(pictures)]
    robot, seen, right, taken = Robot(), {}, 0, []
    for row in first + second:
        features = strongest(pictures[row], FEATURES)
        found = robot.see(features)
        taken.append(1e3 * sum(robot.seconds.values()))
        seen[robot.count] = row
        again = robot.count > len(first)
        near = found.node > 0 and abs(seen[found.node] - row) <= every
        right += again and near and found.accepted
        if again or found.accepted:
            known = pictures[seen[found.node]].name if found.node else "a new place"
            verdict = "accepted" if found.accepted else found.reason
            print(f"{pictures[row].name}: {known}, {found.posterior:.3f}, {verdict}")
    print(f"{right} of {len(second)} places known again, {np.median(taken):.1f} ms an update")


def laps(pictures: list[Path], every: int, memory_thr: int, count: int) -> None:
    robot, seen = Robot(memory_thr), {}
    for lap in range(count):
        right, retrieved, sizes, taken = 0, 0, [], []
        for row in range(lap % every, len(pictures), every):
            features = strongest(pictures[row], FEATURES)
            start = time.process_time()
            found = robot.see(features, x=0.05 * row)
            node = robot.count
            robot.nodes[node], seen[node] = robot.memory.recall(node), row
            retrieved += len(robot.memory.retrieve(found.node, robot.graph, here=node))
            if found.accepted and abs(seen[found.node] - row) <= 16:
                right += 1
                if not robot.graph.are_linked(found.node, node):
                    robot.tie(found.node, node, LinkKind.GLOBAL_CLOSURE)
                    robot.memory.closed(found.node, node)
            robot.memory.transfer(robot.graph)
            taken.append(1e3 * (time.process_time() - start))
            made, descriptors = robot.memory.dictionary.take_made()
            robot.words.update(zip(made.tolist(), descriptors, strict=True))
            sizes.append(robot.memory.sizes())
        print(
            f"lap {lap + 1}: {right} of {len(taken)} places known again, {retrieved} nodes retrieved, at most "
            f"{max(size.working for size in sizes)} in working memory and {max(size.words for size in sizes)} words, "
            f"{sizes[-1].long_term} in long-term memory; {np.median(taken):.1f} ms CPU an update"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("words", "nodes", "places", "laps"))
    parser.add_argument("pictures", nargs="*", type=Path)
    parser.add_argument("--words", type=int, default=200_000)
    parser.add_argument("--counts", type=int, nargs="+", default=[100, 1000, 5000])
    parser.add_argument("--every", type=int, default=8)
    parser.add_argument("--memory-thr", type=int, default=30)
    parser.add_argument("--count", type=int, default=6)
    options = parser.parse_args()
    if options.what == "nodes":
        nodes(options.words, sorted(options.counts))
    elif not options.pictures:
        parser.error("name the pictures")
    elif options.what == "words":
        words(options.pictures, options.words)
    elif options.what == "laps":
        laps(options.pictures, options.every, options.memory_thr, options.count)
    else:
        places(options.pictures, options.every)


if __name__ == "__main__":
    main()
