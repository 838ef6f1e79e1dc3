# SPDX-License-Identifier: MIT
"""Pages say what the code does."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
from shell_examples import wrong_in

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_the_parameter_tables_are_current():
    path = ROOT / ".ci" / "parameter_tables.py"
    spec = importlib.util.spec_from_file_location("parameter_tables", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    pages = [page.read_text() for page in module.PAGES]
    assert "| `minimumScore` | 0 | beams | ≥ 0 |" in pages[0]
    assert "| `occdist_scale` | 0.01 |" in pages[1]
    assert [module.render(page) for page in pages] == pages, "run: python .ci/parameter_tables.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text())
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


def test_every_page_is_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text()
    assert [page.name for page in PAGES[2:] if page.name != "index.md" and f"{page.name})" not in index] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_options_in_examples_exist(page):
    text = page.read_text()
    examples = re.findall(r"^(?:    |\$ )(?=.*slamcli )((?:[^\n]|\\\n)*)", text, re.MULTILINE)
    examples += re.findall(r"^ *```(?:sh|console)\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
    examples += re.findall(r"(?<!`)`(slamcli [^`]+)`(?!`)", text.replace("\\|", "|"))
    assert wrong_in("\n".join(examples)) == []


def test_wrong_examples_are_found():
    script = """slamcli info a.bag --json | jq . | slamcli schema --valid -
for bag in *.bag; do slamcli mpa $bag --algo x; done
error=$(slamcli evaluate a b --json --maximum x=1)
slamcli map a.bag \\
  --alg gmapping  # --not-an-option
slamcli map-tools crop a b --margn 1 > --file
slamcli info \"a.bag\" --fulll && slamcli doctor --jsn"""
    assert wrong_in(script) == [
        "slamcli schema --valid", "slamcli mpa", "slamcli evaluate --maximum", "slamcli map --alg", "slamcli map-tools --margn",
        "slamcli info --fulll", "slamcli doctor --jsn",
    ]  # fmt: skip
