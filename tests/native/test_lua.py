# SPDX-License-Identifier: MIT
"""Lua files: what they may do, what they may not, and what comes out."""

from __future__ import annotations

import math
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import ConfigError
from slamcli.native._lua_places import LuaPlaces, assignments
from slamcli.native.lua import evaluate

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def write(folder: Path, text: str, name: str = "x.lua") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def message(folder: Path, text: str) -> str:
    """Return the error of a file without the folder's name."""
    with pytest.raises(ConfigError) as caught:
        evaluate(write(folder, text))
    assert "\n" not in str(caught.value)
    return str(caught.value).replace(f"{folder}/", "")


def test_the_language_is_there(tmp_path):
    write(tmp_path, "INNER = {a = 1}\nreturn 'from inside', 2", "inner.lua")
    path = write(
        tmp_path,
        """
        local text, number = include "inner.lua"
        local function twice(x) return 2 * x end
        INNER.a = INNER.a + 1
        for _, key in ipairs({"p", "q"}) do INNER[key] = twice(3) end
        print("nothing is printed", INNER)
        return {
          rad = math.rad(90.), exponent = 1e1, whole = 7 // 2, name = string.format("%s_%d", text, number),
          choice = choose(1 < 2, "yes", "no"), inner = INNER, joined = table.concat({"a", "b"}, "-"),
        }, "ignored"
        """,
    )
    result = evaluate(path, names=["INNER", "NOT_SET"])
    assert result.returned == {
        "rad": math.pi / 2, "exponent": 10.0, "whole": 3, "name": "from inside_2", "choice": "yes",
        "inner": {"a": 2, "p": 6, "q": 6}, "joined": "a-b",
    }  # fmt: skip
    assert result.tables["INNER"] is result.returned["inner"]
    assert result.tables["NOT_SET"] is None
    assert list(result.returned) == sorted(result.returned)
    assert [Path(file).name for file, _ in result.files] == ["x.lua", "inner.lua"]
    assert isinstance(result.returned["whole"], int)
    assert isinstance(result.returned["exponent"], float)


@pytest.mark.parametrize("name", ["io", "os", "package", "debug", "coroutine", "utf8", "python"])
def test_libraries_that_reach_out_are_gone(tmp_path, name):
    assert evaluate(write(tmp_path, f"return {{gone = {name} == nil, also = _G['{name}'] == nil}}")).returned == {
        "gone": True,
        "also": True,
    }


@pytest.mark.parametrize(
    "name",
    [
        "require", "load", "loadfile", "dofile", "loadstring", "pcall", "xpcall", "setmetatable", "getmetatable",
        "rawset", "rawget", "rawequal", "collectgarbage", "warn", "math.random", "math.randomseed", "string.rep",
        "string.find", "string.gsub", "string.dump", "string.pack", "('x').rep", "table.move", "table.sort",
    ],
)  # fmt: skip
def test_functions_that_reach_out_or_run_long_are_gone(tmp_path, name):
    assert evaluate(write(tmp_path, f"return {{gone = {name} == nil}}")).returned == {"gone": True}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("while true do end", "x.lua:1: it does not end"),
        ("local function f() return f() end\nf()", "it does not end"),
        ("::a:: goto a", "x.lua:1: it does not end"),
        ("local s = 'x' while true do s = s .. s end", "x.lua: takes more than 32 MB"),
        ("local t = {} while true do t[#t + 1] = {} end", "x.lua: takes more than 32 MB"),
        ("local function f() return 1 + f() end f()", "x.lua: "),
        ("return " + "(" * 5000 + "1" + ")" * 5000, "x.lua: C stack overflow"),
        ("return " + "{a=" * 100 + "1" + "}" * 100, "nested more than 16 deep"),
        ("t = {} t.t = t return t", "what it returns.t is a table that holds itself"),
        ("local t = {} for i = 1, 30000 do t['k' .. i] = i end return t", "more than 20000 values"),
        ("local s = '' for i = 1, 20000 do s = s .. 'x' end return {a = s}", "text of 20000 bytes"),
        ("local s = {} for i = 1, 3e6 do s[i] = 'xxxxxxxx' end return table.concat(s)", "x.lua: "),
        ("return string.format('%99999d', 1)", "x.lua:1: invalid conversion"),
        ("return {a = print}", "what it returns.a is a function, not a value"),
        ("return {1, 2}", "holds a value without a name"),
        ("return {[true] = 1}", "holds a value without a name"),
        ("return {[{}] = 1}", "holds a value without a name"),
        ("return {a = '\\xff\\xfe'}", "what it returns.a is not UTF-8"),
        ("return {a = 'x\\0y'}", "characters that cannot be printed"),
        ("return {['a\\nb'] = 1}", "characters that cannot be printed"),
        ("x = = 3", "x.lua:1: unexpected symbol near '='"),
        ("\n\nx.y = 3", "x.lua:3: attempt to index a nil value (global 'x')"),
        ("error('boom')", "x.lua:1: boom"),
        ("error('a\\nb\\27[31m')", "x.lua:1: a b?[31m"),
        ("error({})", "x.lua: stopped by an error without a message"),
        ("error(nil)", "x.lua: stopped by an error without a message"),
        ("error('99:1: elsewhere', 0)", "x.lua: 99:1: elsewhere"),
        ("assert(false, 'not so')", "x.lua:1: not so"),
        ("choose(1, 2, 3)", "x.lua:1: choose(condition, a, b): the condition is no truth value"),
        ("include(5)", "x.lua:1: include takes the name of one file"),
        ("include.x = 1", "x.lua:1: attempt to index a function value"),
        ("for k in pairs(_G) do _G[k] = nil end include 'y.lua'", "x.lua:1: attempt to "),
        ("#!/usr/bin/lua\nreturn {}", "x.lua:1: unexpected symbol"),
        ("\x1bLua", "x.lua: attempt to load a binary chunk"),
        ("return table.unpack({}, 1, 1e7)", "too many results to unpack"),
        ("return table.concat({}, '', 1, 2^53)", "invalid value"),
        ("local x <close> = 5", "x.lua:1: variable 'x' got a non-closable value"),
    ],
)  # fmt: skip
def test_hostile_files_end_in_one_line(tmp_path, text, expected):
    began = time.perf_counter()
    assert expected in message(tmp_path, text)
    assert time.perf_counter() - began < 4


def test_time_is_limited_where_each_instruction_is_slow(tmp_path):
    slow = "local s = 'x' for i = 1, 22 do s = s .. s end local t while true do t = s .. 'a' end"
    assert "it does not end" in message(tmp_path, slow) or "32 MB" in message(tmp_path, slow)


def test_one_table_in_two_places_does_not_multiply(tmp_path):
    text = "local t = {x = 1} for i = 1, 14 do t = {a = t, b = t} end return t"
    result = evaluate(write(tmp_path, text)).returned
    assert result["a"] is result["b"]


@pytest.mark.parametrize("content", [b"a = 1\x00", b"\xff\xfe", b"x" * 1_000_001])
def test_what_is_no_text_is_refused(tmp_path, content):
    path = tmp_path / "x.lua"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"x\.lua"):
        evaluate(path)


def test_includes_are_looked_for_beside_the_file_and_then_in_the_folders(tmp_path):
    beside, shipped = tmp_path / "robot", tmp_path / "shipped"
    (beside / "parts").mkdir(parents=True)
    shipped.mkdir()
    write(shipped, "A = 'shipped'", "a.lua")
    write(shipped, "B = 'shipped'", "b.lua")
    write(beside, "A = 'own'", "a.lua")
    write(beside / "parts", 'include "d.lua"', "c.lua")
    write(beside / "parts", "C = 'part'", "d.lua")
    path = write(beside, 'include "a.lua" include "b.lua" include "parts/c.lua" return {a = A, b = B, c = C}')
    assert evaluate(path, [shipped]).returned == {"a": "own", "b": "shipped", "c": "part"}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("nowhere.lua", "x.lua:2: include 'nowhere.lua': not found in "),
        ("/etc/passwd", "x.lua:2: include '/etc/passwd': name a .lua file, relative to this one"),
        ("/etc/x.lua", "name a .lua file, relative to this one"),
        ("../secret.txt", "name a .lua file"),
        ("a\\0.lua", "name a .lua file"),
        ("\\xff.lua", "include "),
        ("x.lua", "x.lua:2: x.lua is included a second time (first: x.lua)"),
        ("twice.lua", "twice.lua:3: inner.lua is included a second time (first: twice.lua:2); Cartographer aborts here"),
        ("wrong.lua", "wrong.lua:3: attempt to call a nil value (global 'foo')"),
        ("folder.lua", "not found in"),
    ],
)  # fmt: skip
def test_includes_that_fail_say_where(tmp_path, name, expected):
    write(tmp_path, "X = 1", "inner.lua")
    write(tmp_path, '--\ninclude "inner.lua"\ninclude "inner.lua"', "twice.lua")
    write(tmp_path, "\n\nfoo()", "wrong.lua")
    (tmp_path / "folder.lua").mkdir()
    assert expected in message(tmp_path, f'-- one\ninclude "{name}"')


def test_a_chain_of_includes_is_limited(tmp_path):
    for i in range(60):
        write(tmp_path, f'include "f{i + 1}.lua"', f"f{i}.lua")
    with pytest.raises(ConfigError, match=r"f49\.lua:1: more than 50 files are included"):
        evaluate(tmp_path / "f0.lua")


def test_assignments_are_found_by_their_text():
    text = (
        "-- A.no = 1\nA = {\n  b = 1., c = { d = 'x = 3', ['e'] = 2 },\n  [[ z = 4 ]], f = g(h == 1, {i = 2}),\n}\n"
        "--[==[ k = 5\n]==] A.c.d = math.rad(3.) A['c'].e = 0x1p4\nB.x = 5.\nC.y = 1e-3\nif a == b then D = 7 end"
    )
    assert list(assignments(text)) == [
        ("A", 2), ("A.b", 3), ("A.c", 3), ("A.c.d", 3), ("A.c.e", 3), ("A.f", 4), ("A.c.d", 7), ("A.c.e", 7),
        ("B.x", 8), ("C.y", 9), ("D", 10),
    ]  # fmt: skip


def test_the_including_file_goes_before_the_included_and_presets_come_last():
    files = [("main.lua", "A.x = 1\nlocal t = A\nt.y = 2"), ("preset.lua", "A = {x = 0, y = 0, z = 0}")]
    places = LuaPlaces(files)
    assert places.find(["A.x"], ["A"], ["preset.lua"]) == ("main.lua", 1)
    assert places.find(["A.y"], ["A"], ["preset.lua"]) == ("main.lua", 3)  # through another variable
    assert places.find(["A.z"], ["A"], ["preset.lua"]) == ("preset.lua", 1)
    assert places.find(["A.q"], ["A"], ["preset.lua"]) is None


WORDS = st.sampled_from(
    [
        "include", "'pose_graph.lua'", "=", "==", "{", "}", "(", ")", ".", ",", "[", "]", "A", "B", "x", "1", "1e1", "0x",
        "'", '"', "--", "--[[", "]]", "[[", "\\", "function", "end", "for", "while", "true", "do", "return", "nil", "..",
        "options", "error", "choose", "math.rad", "print", "_G", "local", "if", "then", "\n", " ", "#", "~", "//", "<close>",
    ]
)  # fmt: skip


def refusal(path: Path) -> str:
    """Return the message with which a file is refused, "" for one that is not."""
    try:
        evaluate(path, [CONFIGS])
    except ConfigError as error:
        return str(error)
    return ""


@settings(max_examples=150, deadline=None)
@given(st.one_of(st.lists(WORDS, max_size=40).map(" ".join), st.text(max_size=60)))
def test_random_text_is_evaluated_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "random.lua"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    list(assignments(text))
    assert "\n" not in refusal(path)


def test_mutated_configurations_are_evaluated_or_refused(tmp_path):
    source = (CONFIGS / "backpack_3d.lua").read_text()
    choice = random.Random(3)
    refused = 0
    for _ in range(150):
        letters = list(source)
        for _ in range(choice.randint(1, 6)):
            i = choice.randrange(len(letters))
            letters[i : i + choice.randint(0, 3)] = choice.choice(["", "{", "}", "=", "nil", "\n", "'", "\0", ".", "é"])
        path = write(tmp_path, "".join(letters))
        told = refusal(path)
        refused += bool(told)
        assert "\n" not in told
    assert 50 < refused < 150


FILL = """
import sys
from pathlib import Path
from slamcli.errors import ConfigError
from slamcli.native.lua import evaluate

path = Path(sys.argv[1])
path.with_name("inner.lua").write_text("-- " + "x" * 900_000)
ends = ("include 'inner.lua'", "return {a = 1, b = 'x' .. 2}", "error(5)", "include 'nowhere.lua'")
told = [0] * len(ends)
for blocks in range(6500, 8500, 60):  # of 4 kB
    for i, end in enumerate(ends):
        path.write_text(
            "local s = 'x' for i = 1, 12 do s = s .. s end local t = {} "
            f"for i = 1, {blocks} do t[i] = s .. i end for i = 1, {blocks % 37} do t['k' .. i] = 'a' .. i end {end}"
        )
        try:
            evaluate(path)
        except ConfigError as error:
            told[i] += "32 MB" in str(error)
print(*told)
"""


def test_memory_may_end_anywhere(tmp_path):
    """Where Lua jumps out of a call to Python the process hangs or dies: so it must not call."""
    command = [sys.executable, "-c", FILL, str(tmp_path / "x.lua")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    told = [int(word) for word in done.stdout.split()]
    assert len(told) == 4
    assert all(8 < count < 32 for count in told), told
