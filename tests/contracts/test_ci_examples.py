# SPDX-License-Identifier: MIT
"""docs/ci: the workflows can be read, the commands in them exist, and the image has what the wheels need."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from shell_examples import commands_in, wrong_in

ROOT = Path(__file__).resolve().parents[2]
CI = ROOT / "docs" / "ci"
FILES = sorted(path.name for path in CI.glob("*.yml"))


def load(name: str) -> dict[Any, Any]:
    document: dict[Any, Any] = yaml.safe_load((CI / name).read_text())
    return document


def scripts(document: Any) -> list[str]:
    """Return every shell script of a workflow: `run` of GitHub, `script` of GitLab."""
    if isinstance(document, list):
        return [script for item in document for script in scripts(item)]
    if not isinstance(document, dict):
        return []
    found = [document["run"]] if "run" in document else []
    found += ["\n".join(document["script"])] if "script" in document else []
    return found + [script for value in document.values() for script in scripts(value)]


def actions(document: Any) -> list[str]:
    if isinstance(document, list):
        return [name for item in document for name in actions(item)]
    if not isinstance(document, dict):
        return []
    return [value for key, value in document.items() if key == "uses"] + actions(list(document.values()))


def builder() -> Any:
    spec = importlib.util.spec_from_file_location("dockerfile", ROOT / ".ci" / "dockerfile.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


def libraries() -> set[str]:
    """Return the packages that .ci/setup installs for open3d's wheel."""
    return set(re.findall(r'"lib\S+ (lib\S+)"', (ROOT / ".ci" / "setup").read_text()))


def test_all_examples_are_there():
    assert FILES == ["action.yml", "github-action.yml", "gitlab-ci.yml"]
    assert {path.name for path in CI.iterdir()} == {*FILES, "Dockerfile", "Dockerfile.dockerignore"}


@pytest.mark.parametrize("name", FILES)
def test_the_commands_in_a_workflow_exist_and_its_scripts_are_shell(name):
    found = scripts(load(name))
    assert found
    for script in found:
        expanded = re.sub(r"\$\{\{.*?\}\}", "value", script)
        done = subprocess.run(["bash", "-n"], input=expanded, text=True, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
        assert wrong_in(expanded) == []


def test_the_workflow_maps_scores_compares_and_shows():
    workflow = load("github-action.yml")
    found = [command for script in scripts(workflow) for command, _ in commands_in(script)]
    assert found == ["doctor", "map", "schema", "evaluate", "map-tools", "compare"]
    assert set(workflow["jobs"]) == {"map", "release"}
    steps = workflow["jobs"]["map"]["steps"]
    judged = [step for step in steps if "evaluate" in step.get("run", "")]
    assert all("!cancelled()" in step["if"] for step in judged)
    assert [step["uses"] for step in steps[-2:]] == ["actions/upload-artifact@v4", "mikepenz/action-junit-report@v5"]
    for script in scripts(workflow):
        for report in re.findall(r"--junit (\S+)", script):
            assert report.startswith("junit/"), "where the last step looks"


@pytest.mark.parametrize("name", ["action.yml", "github-action.yml"])
def test_actions_are_pinned_to_a_version(name):
    found = actions(load(name))
    assert found
    assert [used for used in found if not re.fullmatch(r"[\w-]+/[\w-]+@v\d+|\./\.github/actions/slamcli", used)] == []


def test_inputs_of_the_action_are_explained_and_used():
    action = load("action.yml")
    text = (CI / "action.yml").read_text()
    assert action["runs"]["using"] == "composite"
    for name, entry in action["inputs"].items():
        assert entry["description"], name
        assert f"inputs.{name}" in text
    assert all("shell" in step for step in action["runs"]["steps"] if "run" in step)


def test_the_junit_of_a_gitlab_job_is_the_one_that_it_writes():
    for name, job in load("gitlab-ci.yml").items():
        if not (isinstance(job, dict) and "reports" in job.get("artifacts", {})):
            continue
        assert f"--junit {job['artifacts']['reports']['junit']}" in "\n".join(job["script"]), name


def test_the_image_has_the_libraries_an_entry_point_and_no_root():
    found = list(builder().instructions((CI / "Dockerfile").read_text()))
    names = [name for name, _ in found]
    assert names[0] == "FROM"
    assert [rest for name, rest in found if name == "USER"] == ["slamcli"]
    assert names.index("USER") > max(index for index, name in enumerate(names) if name in ("RUN", "COPY"))
    assert ("ENTRYPOINT", '["slamcli"]') in found
    runs = [rest for name, rest in found if name == "RUN"]
    assert libraries() <= set(runs[0].split())
    assert libraries() <= set((CI / "action.yml").read_text().split())
    assert "slamcli warmup --quiet" in "\n".join(runs)
    for run in runs:
        assert wrong_in(run) == []
    settings = " ".join(rest for name, rest in found if name == "ENV")
    assert "NUMBA_CACHE_DIR=/opt/slamcli/kernels" in settings
    assert ("ARG", "CPU=x86-64-v3") in found
    assert "NUMBA_CPU_NAME=x86-64-v3" in (CI / "action.yml").read_text()


def test_what_the_image_copies_goes_in_and_nothing_else():
    is_ignored = builder().is_ignored
    patterns = [line for line in (CI / "Dockerfile.dockerignore").read_text().split("\n") if line and line[0] != "#"]
    kept = [
        "pyproject.toml",
        "requirements.lock",
        "README.md",
        "LICENSE",
        "src/slamcli/cli/main.py",
        "configs/worlds/office.yaml",
    ]
    left = [
        "sample_data/office.bag",
        ".git/HEAD",
        "tests/x.py",
        "src/slamcli/cli/__pycache__/main.pyc",
        "docs/README.md",
    ]
    assert [is_ignored(name, patterns) for name in kept] == [False] * len(kept)
    assert [is_ignored(name, patterns) for name in left] == [True] * len(left)
    copied = {
        word
        for name, rest in builder().instructions((CI / "Dockerfile").read_text())
        if name == "COPY"
        for word in rest.split()[:-1]
    }
    assert copied == {"requirements.lock", "pyproject.toml", "README.md", "LICENSE", "src", "configs"}
    assert all((ROOT / name).exists() for name in copied)


def test_instructions_go_on_after_a_backslash():
    text = "# syntax\nFROM a\n\nRUN one && \\\n    two\n# COPY x y\nENV A=1 \\\n    B=2\n"
    assert list(builder().instructions(text)) == [("FROM", "a"), ("RUN", "one &&  two"), ("ENV", "A=1  B=2")]
