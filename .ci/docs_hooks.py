# SPDX-License-Identifier: MIT
"""What `mkdocs build` does beside building: files of the source that pages link to come along into the site.

A page links to `../configs/mapping.rviz` as it stands in the source, so that the link works there (and wherever the source is
shown). The site has no source beside it: such files are copied into `site/files/`, and the links lead there.

The index of the search is written as a script, too: pages that are opened from the disk may not read files, but may load scripts
(`docs/assets/search-from-files.js` does the rest).
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

_OUTSIDE = re.compile(r"\]\(((?:\.\./)+[^)#\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Return the site's files and with them every file outside of docs/ that a page links to."""
    docs = Path(config.docs_dir)
    for page in list(files.documentation_pages()):
        for link in _OUTSIDE.findall(page.content_string):
            source = (docs / page.src_uri).parent / link
            uri = _uri(page.src_uri, link)
            if uri is not None and source.is_file() and files.get_file_from_path(uri) is None:
                files.append(File.generated(config, uri, abs_src_path=str(source.resolve())))
    return files


def on_page_markdown(markdown: str, page: Any, files: Any, **_: Any) -> str:
    """Return the page with its links out of docs/ turned to the copies."""

    def turned(match: re.Match[str]) -> str:
        uri = _uri(page.file.src_uri, match[1])
        if uri is None or files.get_file_from_path(uri) is None:
            return match[0]
        return f"]({posixpath.relpath(uri, posixpath.dirname(page.file.src_uri) or '.')})"

    return _OUTSIDE.sub(turned, markdown)


def on_post_build(config: Any, **_: Any) -> None:
    """Write the index of the search as a script."""
    search = Path(config.site_dir) / "search"
    (search / "search_index.js").write_text(f"var __index = {(search / 'search_index.json').read_text()}")


def _uri(page: str, link: str) -> str | None:
    """Return where in the site the file of a link lies, or None if it lies in docs/."""
    path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), link))
    return None if path.startswith("docs/") else f"files/{path}"
