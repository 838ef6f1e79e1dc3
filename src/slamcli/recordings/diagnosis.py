# SPDX-License-Identifier: MIT
"""What is wrong with a recording: every check over one pass."""

from __future__ import annotations

from dataclasses import dataclass, replace

from slamcli.recordings.checks import CHECKS, SEVERITIES, Finding
from slamcli.recordings.checks.evidence import Evidence, gather
from slamcli.recordings.raw import Contents
from slamcli.recordings.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """Everything that was found, the worst first."""

    contents: Contents
    findings: tuple[Finding, ...]
    checks: tuple[str, ...]
    """Names of the checks that were made."""

    def count(self, severity: str) -> int:
        """Return how many findings have a severity (error, warning, note)."""
        return sum(finding.severity == severity for finding in self.findings)


def diagnose(recording: Recording) -> Diagnosis:
    """Read a recording to its end, with its mends applied, and return what is wrong with it."""
    evidence = gather(recording)
    return Diagnosis(contents=evidence.contents, findings=judge(evidence), checks=tuple(CHECKS))


def judge(evidence: Evidence) -> tuple[Finding, ...]:
    """Return what every check finds in the evidence, the worst first, in the order of the checks."""
    found = [replace(finding, check=name) for name, check in CHECKS.items() for finding in check(evidence)]
    return tuple(sorted(found, key=lambda finding: SEVERITIES.index(finding.severity)))
