# SPDX-License-Identifier: MIT
from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from slamcli.reports.junit import JunitCase, junit_xml

# Jenkins' junit-10.xsd and the older Ant schema, as far as both allow: children in order, attributes (required first).
CHILDREN = {
    "testsuites": ("testsuite",),
    "testsuite": ("properties", "testcase", "system-out", "system-err"),
    "properties": ("property",),
    "testcase": ("skipped", "failure", "error", "system-out", "system-err"),
}
ATTRIBUTES = {
    "testsuites": ({"name", "tests", "failures", "errors", "time"}, set()),
    "testsuite": ({"name", "tests", "failures", "errors", "time"}, {"skipped"}),
    "property": ({"name", "value"}, set()),
    "testcase": ({"name", "classname", "time"}, set()),
    "failure": ({"message", "type"}, set()),
    "error": ({"message", "type"}, set()),
}


def read(text: str | bytes) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 - our own


def check(element: ET.Element) -> None:
    """Hold an element against the schema."""
    required, optional = ATTRIBUTES.get(element.tag, (set(), set()))
    assert required <= set(element.attrib) <= required | optional, element.tag
    order = [CHILDREN.get(element.tag, ()).index(child.tag) for child in element]
    assert order == sorted(order), element.tag
    for child in element:
        check(child)


def test_counts_and_texts_are_those_of_the_cases():
    text = junit_xml(
        "slamcli evaluate",
        [
            JunitCase(name="kept", classname="slamcli.evaluate", seconds=1.25, output="ate.rmse = 1"),
            JunitCase(name="missed", classname="slamcli.evaluate", failure="first\nsecond"),
            JunitCase(name="broken", classname="slamcli.evaluate", seconds=0.5, error="no such file"),
        ],
        {"slamcli": "1.2"},
    )
    root = read(text)
    check(root)
    suite = root[0]
    assert suite.attrib == {
        "name": "slamcli evaluate", "tests": "3", "failures": "1", "errors": "1", "skipped": "0", "time": "1.750",
    }  # fmt: skip
    assert {key: root.get(key) for key in ("tests", "failures", "errors")} == {
        "tests": "3",
        "failures": "1",
        "errors": "1",
    }
    assert [case.get("name") for case in suite.iter("testcase")] == ["kept", "missed", "broken"]
    failure = suite.find("testcase/failure")
    assert (failure.get("message"), failure.text) == ("first", "first\nsecond")
    assert suite.findtext("testcase/error") == "no such file"
    assert suite.findtext("testcase/system-out") == "ate.rmse = 1"
    assert suite.find("properties/property").attrib == {"name": "slamcli", "value": "1.2"}


def test_what_xml_cannot_hold_is_escaped():
    nasty = "a\x00\x1b[31m<&>\"'\udcff\ufffe ü 地图 \U0001f916\r\nb"
    root = read(junit_xml(nasty, [JunitCase(name=nasty, classname=nasty, failure=nasty, output=nasty)]).encode())
    check(root)
    clean = "a\\x00\\x1b[31m<&>\"'\\udcff\\ufffe ü 地图 \U0001f916\nb"
    assert root.find("testsuite/testcase").get("name") == clean
    assert root.findtext("testsuite/testcase/failure") == clean
    assert root.findtext("testsuite/testcase/system-out") == clean


def test_an_empty_message_is_still_a_failure():
    root = read(junit_xml("s", [JunitCase(name="n", classname="c", failure="")]))
    assert root.find("testsuite/testcase/failure").get("message") == ""
    assert root.find("testsuite").get("failures") == "1"


@pytest.mark.parametrize("cases", [[], [JunitCase(name="n", classname="c", failure="f", error="e")]])
def test_a_suite_without_cases_and_a_case_of_two_minds_are_refused(cases):
    with pytest.raises(ValueError, match="case"):
        junit_xml("s", cases)
