# SPDX-License-Identifier: MIT
"""JUnit XML, as Jenkins, GitLab and GitHub actions read it: one test case for each thing that was to hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to write, not even escaped (section 2.2, Char)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JunitCase:
    """One test case: passed unless it has a failure or an error."""

    name: str
    classname: str
    """Dotted, ``slamcli.evaluate``: what test viewers group by."""
    seconds: float = 0.0
    failure: str | None = None
    """What did not hold, first line first."""
    error: str | None = None
    """Why it could not be found out."""
    output: str = ""
    """What is worth reading besides."""


def junit_xml(suite: str, cases: Sequence[JunitCase], properties: Mapping[str, str] | None = None) -> str:
    """Return the document of one suite.

    Element and attribute order follow Jenkins' schema (junit-10.xsd), which GitLab and the usual GitHub actions read as well. There is
    no ``timestamp`` and no ``hostname``: when and where it ran is what the CI system knows best.

    Parameters
    ----------
    suite
        Its name.
    cases
        The test cases, at least one: viewers report an empty suite as a run without tests.
    properties
        Facts about the whole suite, by name.

    Raises
    ------
    ValueError
        If there is no case, or one both failed and erred.
    """
    if not cases:
        raise ValueError("a suite needs a case")
    if any(case.failure is not None and case.error is not None for case in cases):
        raise ValueError("a case fails or errs, not both")
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.failure is not None for case in cases)),
        "errors": str(sum(case.error is not None for case in cases)),
    }
    seconds = f"{sum(case.seconds for case in cases):.3f}"
    root = ET.Element("testsuites", {"name": _clean(suite), **counts, "time": seconds})
    element = ET.SubElement(root, "testsuite", {"name": _clean(suite), **counts, "skipped": "0", "time": seconds})
    if properties:
        within = ET.SubElement(element, "properties")
        for name, value in properties.items():
            ET.SubElement(within, "property", {"name": _clean(name), "value": _clean(value)})
    for case in cases:
        element.append(_case(case))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _case(case: JunitCase) -> ET.Element:
    names = {"name": _clean(case.name), "classname": _clean(case.classname), "time": f"{case.seconds:.3f}"}
    element = ET.Element("testcase", names)
    for kind, message in (("failure", case.failure), ("error", case.error)):
        if message is not None:
            text = _clean(message)
            found = ET.SubElement(element, kind, {"message": text.splitlines()[0] if text else "", "type": kind})
            found.text = text
    if case.output:
        ET.SubElement(element, "system-out").text = _clean(case.output)
    return element


def _clean(text: str) -> str:
    """Return the text with what XML cannot hold written as Python would escape it, and line ends as line feeds."""
    unix = text.replace("\r\n", "\n").replace("\r", "\n")
    return _NOT_XML.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), unix)
