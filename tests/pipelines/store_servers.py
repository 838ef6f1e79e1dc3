# SPDX-License-Identifier: MIT
"""A store as S3 is, small enough for a test: ListObjectsV2, HeadObject and GetObject with ranges; it is a web server as well."""

from __future__ import annotations

import hashlib
import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import parse_qsl, unquote, urlsplit
from xml.sax.saxutils import escape

OBJECT = "<Contents><Key>{}</Key><LastModified>2026-01-01T00:00:00.000Z</LastModified><ETag>&quot;{}&quot;</ETag><Size>{}</Size></Contents>"


class Store(http.server.ThreadingHTTPServer):
    """Objects by key, in one bucket of any name; `asked` are the requests, `cut` is after how many bytes an answer breaks off."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.objects: dict[str, bytes] = {}
        self.asked: list[str] = []
        self.cut: int | None = None

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"

    @property
    def environment(self) -> dict[str, str]:
        return {
            "AWS_ENDPOINT_URL": self.address,
            "AWS_ALLOW_HTTP": "true",
            "AWS_SKIP_SIGNATURE": "true",
            "AWS_REGION": "us-east-1",
        }


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Store

    def log_message(self, *_: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        query = dict(parse_qsl(url.query))
        key = unquote(url.path).lstrip("/").partition("/")[2]
        self.server.asked.append(f"{self.command} {unquote(url.path)}")
        if query.get("list-type") == "2":
            self.answer(200, self.listing(query.get("prefix", ""), query.get("delimiter", "")))
        elif key not in self.server.objects:
            self.answer(404, b"<Error><Code>NoSuchKey</Code></Error>")
        else:
            self.give(self.server.objects[key])

    def listing(self, prefix: str, delimiter: str) -> bytes:
        inside = {key: content for key, content in self.server.objects.items() if key.startswith(prefix)}
        deeper = {key for key in inside if delimiter and delimiter in key[len(prefix) :]}
        folders = sorted({prefix + key[len(prefix) :].partition(delimiter)[0] + delimiter for key in deeper})
        parts = [OBJECT.format(escape(k), tag(inside[k]), len(inside[k])) for k in sorted(set(inside) - deeper)]
        parts += [f"<CommonPrefixes><Prefix>{escape(folder)}</Prefix></CommonPrefixes>" for folder in folders]
        head = (
            f"<Name>b</Name><Prefix>{escape(prefix)}</Prefix><KeyCount>{len(parts)}</KeyCount><MaxKeys>1000</MaxKeys>"
        )
        return f"<ListBucketResult>{head}<IsTruncated>false</IsTruncated>{''.join(parts)}</ListBucketResult>".encode()

    def give(self, content: bytes) -> None:
        headers = {"ETag": f'"{tag(content)}"', "Last-Modified": "Thu, 01 Jan 2026 00:00:00 GMT"}
        wanted = self.headers.get("Range")
        if wanted is None:
            self.answer(200, content, headers)
            return
        first, _, last = wanted.removeprefix("bytes=").partition("-")
        begin, end = int(first), min(int(last or len(content)), len(content) - 1)
        headers["Content-Range"] = f"bytes {begin}-{end}/{len(content)}"
        self.answer(206, content[begin : end + 1], headers)

    def answer(self, code: int, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(code)
        for name, value in {**(headers or {}), "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body[: self.server.cut])
            self.close_connection = self.server.cut is not None


def tag(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()


@contextmanager
def store_server() -> Iterator[Store]:
    server = Store()
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
