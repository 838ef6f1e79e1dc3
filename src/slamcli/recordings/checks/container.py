# SPDX-License-Identifier: MIT
"""Checks of the container and of what its messages decode to."""

from __future__ import annotations

from collections.abc import Iterator

from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding


def damage(evidence: Evidence) -> Iterator[Finding]:
    """Say what of the container could not be read."""
    for what in evidence.contents.damage:
        yield Finding(severity="error", message=what, mend="slamcli convert writes what can be read to a sound file")


def empty_topics(evidence: Evidence) -> Iterator[Finding]:
    """Name topics without messages."""
    for name, found in evidence.surveys.items():
        if found.num == 0:
            yield Finding(severity="note", topic=name, message="the topic holds no messages")


def undecodable(evidence: Evidence) -> Iterator[Finding]:
    """Name topics whose messages are not what their type says, or of two types."""
    for name, found in evidence.surveys.items():
        if found.num_other:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"two types under one name: messages that are not {found.topic.msgtype} are left out",
                count=found.num_other,
            )
        if found.num_garbage:
            yield Finding(
                severity="error",
                topic=name,
                message=f"messages cannot be decoded: {found.garbage}",
                count=found.num_garbage,
            )


def unused_mends(evidence: Evidence) -> Iterator[Finding]:
    """Name mends that were given and changed nothing."""
    for mend in evidence.unused_mends:
        yield Finding(severity="warning", message=f"{mend} changes nothing: no message names that frame")
