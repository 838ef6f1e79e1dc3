# SPDX-License-Identifier: MIT
"""Messages that are not what their type says: counted and left out, whatever the bytes are."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from memory_recording import MemoryContainer
from test_adapters import MEASUREMENTS

from slamcli.recordings.adapters import ADAPTERS, encoder_for, message_factory
from slamcli.recordings.diagnosis import diagnose
from slamcli.recordings.raw import RawMessage, Topic
from slamcli.recordings.summary import summarise

SAMPLES = [
    (encoding, msgtype, bytes(factory.serialise(encoder_for(m, msgtype).encode(m, factory), msgtype)))
    for encoding in ("ros1", "cdr")
    for factory in [message_factory(encoding)]
    for msgtype, m in MEASUREMENTS
]


def _container(encoding: str, msgtype: str, messages: list[bytes]) -> MemoryContainer:
    container = MemoryContainer(encoding)
    for topic in ("/topic", "/tf_static"):
        container.add_topic(Topic(name=topic, msgtype=msgtype, count=None, encoding=encoding))
        container.stored += [RawMessage(topic, 10**9 + i, data) for i, data in enumerate(messages)]
    return container


def _read_everything(container: MemoryContainer) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = container.recording()
        decoded = sum(1 for _ in recording.measurements(["/topic"]))
        summarise(recording)
        diagnose(recording)
        return decoded


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_mutated_messages(data: Any) -> None:
    encoding, msgtype, sound = data.draw(st.sampled_from(SAMPLES))
    mutated = bytearray(sound)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(mutated) - 1))
        what = data.draw(st.sampled_from(["byte", "ones", "zero", "nan", "cut", "more"]))
        patch = {
            "byte": bytes([data.draw(st.integers(0, 255))]),
            "ones": b"\xff" * 4,
            "zero": bytes(8),
            "nan": np.float64(np.nan).tobytes(),
        }.get(what, b"")
        if what == "cut":
            del mutated[max(at, 1) :]
        elif what == "more":
            mutated += b"\x01" * 16
        else:
            mutated[at : at + len(patch)] = patch
    assert _read_everything(_container(encoding, msgtype, [sound, bytes(mutated), sound])) >= 2


@settings(max_examples=60, deadline=None)
@given(
    msgtype=st.sampled_from([adapter.msgtypes[0] for adapter in ADAPTERS]),
    encoding=st.sampled_from(["ros1", "cdr"]),
    garbage=st.lists(st.binary(max_size=200), min_size=1, max_size=4),
)
def test_any_bytes(msgtype: str, encoding: str, garbage: list[bytes]) -> None:
    prefix = b"\x00\x01\x00\x00" if encoding == "cdr" else b""
    most = sum(1 + len(data) for data in garbage)  # a message cannot hold more measurements than it has bytes
    assert _read_everything(_container(encoding, msgtype, [prefix + data for data in garbage])) <= most


def test_two_types_under_one_name() -> None:
    container = MemoryContainer()
    samples = {msgtype: data for encoding, msgtype, data in SAMPLES if encoding == "cdr"}
    scan, odometry = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
    container.add_topic(Topic(name="/topic", msgtype=scan, count=None))
    container.stored = [RawMessage("/topic", i, samples[scan], 0 if i % 2 else 5) for i in range(1, 11)]
    recording = container.recording()
    assert len(list(recording.measurements(["/topic"]))) == 5
    assert recording.log.counts["/topic: messages of another type"] == 5
    assert any("two types under one name" in finding.message for finding in diagnose(recording).findings)
    assert odometry in samples


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_empty_messages(encoding: str) -> None:
    for adapter in ADAPTERS:
        container = _container(encoding, adapter.msgtypes[0], [b"", b"\x00", b"\x00\x01\x00\x00"])
        assert _read_everything(container) == 0, adapter.msgtypes[0]
