# SPDX-License-Identifier: MIT
"""What ``--set`` of a sweep says, and what is refused before anything runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.pipelines.config import load_native
from slamcli.pipelines.sweep_axes import parse_axis, value_text
from slamcli.pipelines.sweep_sets import parameter_sets


def sets(*texts, algo="gmapping", draws=None, seed=0, base=()):
    axes = [parse_axis(text, algo) for text in texts]
    return parameter_sets(axes, load_native(algo, sets=base).parameters, algo, draws=draws, seed=seed)


@pytest.mark.parametrize(
    ("text", "algo", "values"),
    [
        ("particles=10,30,60", "gmapping", (10, 30, 60)),
        ("particles=10, 30,10", "gmapping", (10, 30)),
        ("scan_odometry=true,off", "gmapping", (True, False)),
        ("match=surface,'endpoints'", "gmapping", None),
        ("srr=0.1:0.5:/5", "gmapping", (0.1, 0.2, 0.3, 0.4, 0.5)),
        ("srr=0.001:1:log:/4", "gmapping", (0.001, 0.01, 0.1, 1.0)),
        ("particles=10:20:/3", "gmapping", (10, 15, 20)),
        ("particles=10:12:/9", "gmapping", (10, 11, 12)),
        ("srr=1:4:int:/4", "gmapping", (1.0, 2.0, 3.0, 4.0)),
        ("ORBextractor.nFeatures=500,1000", "orbslam3", (500, 1000)),
        ("slamcli.vocabulary=a:b,c", "orbslam3", ("a:b", "c")),
    ],
)
def test_values(text, algo, values):
    if values is None:
        with pytest.raises(ConfigError, match="choose one of"):
            parse_axis(text, algo)
        return
    axis = parse_axis(text, algo)
    assert axis.values == values
    assert [type(value) for value in axis.values] == [axis.declaration.kind] * len(values)


def test_a_comma_within_quotes_or_brackets_belongs_to_its_value():
    axis = parse_axis("LEFT.K='1 2, 3',[4, 5],\"6,7\"", "orbslam3")
    assert axis.values == ("1 2, 3", "[4, 5]", "6,7")


def test_names_of_older_versions_become_those_of_today():
    assert parse_axis("Camera.fx=500,510.5", "orbslam3").name == "Camera1.fx"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("particels=10,20", "did you mean particles"),
        ("particles=10,many", "not a whole number"),
        ("particles=10,-3", "must be"),
        ("particles=10,,20", "nothing between two commas"),
        ("particles=", "nothing between two commas"),
        ("particles", "write KEY=VALUE"),
        ("srr=0.5:0.1", "not below"),
        ("srr=0:0.1:log", "begins above 0"),
        ("srr=0.1:0.5:lin", "log, int or /STEPS"),
        ("srr=0.1:0.5:/1", "between 2 and"),
        ("srr=0.1:", "write a range as LOW:HIGH"),
        ("particles=0.2:0.8", "not a whole number"),
        ("srr=0.2:0.8:int", "no whole number between"),
        ("srr=-1:0.5", "must be"),
        ("LEFT.K=[1,2", "not closed"),
    ],
)
def test_what_is_wrong_is_said(text, message):
    algo = "orbslam3" if text.startswith("LEFT") else "gmapping"
    with pytest.raises(ConfigError, match=message):
        parse_axis(text, algo)


def test_an_axis_is_logarithmic_where_the_values_are():
    assert parse_axis("particles=10,30,90", "gmapping").log
    assert not parse_axis("particles=10,20,30,40", "gmapping").log
    assert parse_axis("srr=0.01:1:log", "gmapping").log


def test_draws_lie_in_the_range_and_have_few_digits():
    rng = np.random.default_rng(1)
    axis = parse_axis("srr=0.001:1:log", "gmapping")
    drawn = [axis.draw(rng) for _ in range(2000)]
    assert min(drawn) >= 0.001
    assert max(drawn) <= 1.0
    assert abs(np.mean(np.log10(drawn)) + 1.5) < 0.06
    assert all(value_text(value) == f"{value:.5g}" or float(f"{value:.5g}") == value for value in drawn)
    whole = parse_axis("particles=3:6", "gmapping")
    assert {whole.draw(rng) for _ in range(200)} == {3, 4, 5, 6}
    counts = np.bincount([whole.draw(rng) for _ in range(4000)])[3:]
    assert counts.min() > 850


def test_the_grid_has_every_combination_once_and_the_baseline_first():
    found = sets("particles=10,30,60", "srr=0.1,0.2")
    assert found[0].is_baseline
    assert found[0].values == {"particles": 30, "srr": 0.1}
    assert len(found) == 6  # the baseline is one of the combinations
    assert {tuple(one.values.values()) for one in found} == {(p, s) for p in (10, 30, 60) for s in (0.1, 0.2)}
    assert [one.label for one in found[:3]] == ["baseline", "particles=10", "particles=10, srr=0.2"]


def test_names_of_sets_do_not_depend_on_what_else_is_swept():
    alone = {one.name for one in sets("particles=10,60")}
    among = {one.name for one in sets("srr=0.1,0.2", "particles=60,10,90")}
    assert alone < among


def test_draws_differ_and_more_of_them_begin_with_the_same():
    few, many = sets("srr=0.01:1", "particles=5:50", draws=5), sets("particles=5:50", "srr=0.01:1", draws=12)
    assert len(few) == 6
    assert len({one.name for one in many}) == 13
    assert {one.name for one in few} <= {one.name for one in many}
    assert {one.name for one in sets("srr=0.01:1", draws=5, seed=1)} != {
        one.name for one in sets("srr=0.01:1", draws=5)
    }


def test_draws_from_few_values_end_with_all_of_them():
    assert len(sets("particles=5:8", draws=100)) == 1 + 4
    assert len(sets("particles=5,6,7,8", draws=3)) == 1 + 3


def test_a_range_in_a_grid_says_what_to_write():
    with pytest.raises(ConfigError, match=r"add --random N, or name steps: srr=0.1:0.5:/5"):
        sets("srr=0.1:0.5")


def test_too_many_sets_are_refused():
    with pytest.raises(UsageError, match="take --random"):
        sets("particles=1:2000:/2000", "srr=0.001:1:/200")


def test_values_come_back_from_their_text():
    for value in (0.1, 1e-300, 1 / 3, 12, True, "a b"):
        axis = {bool: "scan_odometry", int: "particles", float: "srr"}.get(type(value))
        if axis and not isinstance(value, str) and not (isinstance(value, float) and math.isinf(value)):
            assert parse_axis(f"{axis}={value_text(value)}", "gmapping").values == (value,)
