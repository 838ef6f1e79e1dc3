# SPDX-License-Identifier: MIT
"""Tables for the terminal."""

import subprocess
import sys

from slamcli.reports.tables import facts_text, table_text


def test_columns_line_up_and_nothing_is_wrapped_in_a_pipe():
    text = table_text(["topic", "count"], [["/scan", 958], ["/a" * 60, 2]], numeric=[1])
    lines = text.splitlines()
    assert lines[0].split() == ["topic", "count"]
    assert lines[2].startswith("/scan ")
    assert {line[-3:] for line in lines[2:]} == {"958", "  2"}
    assert "/a" * 60 in text


def test_markup_is_not_read_and_control_characters_are_not_printed():
    text = table_text(["a"], [["[red]x[/red]"], ["\x1b[31mboo\n\x07"], ["[/]"]])
    assert "[red]x[/red]" in text
    assert "[/]" in text
    assert "\x1b" not in text
    assert "\x07" not in text


def test_width_is_kept():
    text = table_text(["name", "value"], [["x" * 100, "y " * 80]], width=40)
    assert max(len(line) for line in text.splitlines()) <= 40


def test_values_of_any_kind():
    text = table_text(["v"], [[None], [True], [1234567], [0.1234567891], [[1, 2]], [{"a": 1}]], title="Kinds")
    assert text.splitlines()[0] == "Kinds"
    for shown in ("–", "true", "1,234,567", "0.123457", "[1, 2]", '{"a": 1}'):
        assert shown in text


def test_facts():
    assert facts_text({}) == ""
    assert facts_text({"size": "3 m", "cells": 12}).splitlines() == ["size   3 m", "cells  12"]


def test_rich_is_loaded_only_when_a_table_is_made():
    code = "import sys, slamcli.reports.tables; print('rich' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
