# SPDX-License-Identifier: MIT
"""The documentation builds into a site without a warning, and the site stands on its own: its links lead to pages and headings of
its own, and nothing is fetched from elsewhere."""

from __future__ import annotations

import logging
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Page(HTMLParser):
    """What a page of the site refers to: links to follow, files that the browser loads, and places in it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = {name: value or "" for name, value in attrs}
        if "id" in of:
            self.places.add(of["id"])
        if tag == "a" and "href" in of:
            self.links.append(of["href"])
        elif tag == "link" and of.get("rel") not in ("next", "prev", "canonical"):
            self.loaded.append(of["href"])
        elif "src" in of:
            self.loaded.append(of["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built as `make docs` builds it."""
    patch = pytest.MonkeyPatch()
    patch.setenv("NO_MKDOCS_2_WARNING", "1")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    said = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(record.getMessage())
    logging.getLogger("mkdocs").addHandler(handler)
    folder = tmp_path_factory.mktemp("site")
    try:
        config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder))
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
        config.plugins.on_shutdown()
    finally:
        logging.getLogger("mkdocs").removeHandler(handler)
        patch.undo()
    assert said == []
    return {page.relative_to(folder): Page(page.read_text()) for page in folder.rglob("*.html")}, folder


def test_every_page_is_built(site):
    pages, _ = site
    written = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert written - set(pages) == set()


def test_links_lead_to_pages_and_headings(site):
    pages, folder = site
    wrong = []
    for name, page in pages.items():
        for link in page.links + page.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or name.name == "404.html":
                continue
            target = (folder / name.parent / unquote(parts.path)).resolve() if parts.path else folder / name
            target = target / "index.html" if target.is_dir() else target
            other = pages.get(target.relative_to(folder))
            if not target.is_file() or (parts.fragment and other is not None and parts.fragment not in other.places):
                wrong.append(f"{name}: {link}")
    assert wrong == []


def test_nothing_is_fetched_from_elsewhere(site):
    pages, folder = site
    assert {link for page in pages.values() for link in page.loaded if urlsplit(link).netloc} == set()
    for sheet in folder.rglob("*.css"):
        assert re.findall(r"url\([\"']?https?:[^)]*\)", sheet.read_text()) == []
