# SPDX-License-Identifier: MIT
"""A local web server for the player: it knows what it may send, and sends nothing else."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import ipaddress
import re
import socket
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from slamcli.errors import SlamcliError, UsageError

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_LEAST_PACKED = 500
_MOST_KEPT_IMAGES = 200
_IDLE_S = 60


@dataclass(slots=True, eq=False)
class Resource:
    """One thing that the server has: its type and its bytes."""

    content_type: str
    content: bytes
    etag: str = field(init=False)
    _packed: bytes | None = None

    def __post_init__(self) -> None:
        self.etag = f'"{hashlib.sha256(self.content).hexdigest()[:32]}"'

    def packed(self) -> bytes | None:
        """Return the content in gzip's format, None where that is no gain; it is packed once."""
        if self.content_type.startswith("image/") or len(self.content) < _LEAST_PACKED:
            return None
        if self._packed is None:
            self._packed = gzip.compress(self.content, compresslevel=5, mtime=0)
        return self._packed if len(self._packed) < len(self.content) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Everything that can be asked for."""

    resources: Mapping[str, Resource]
    """By path, ``/`` among them."""
    num_images: int = 0
    image: Callable[[int], bytes] | None = None
    """Gives the JPEG of one of them, at ``/image/NUMBER.jpg``; raises `SlamcliError` where it cannot be read."""


class PlayerServer(ThreadingHTTPServer):
    """Serves a `Site` on one address; `serve_forever` until `shutdown`.

    Raises
    ------
    UsageError
        If the address cannot be listened on.
    """

    daemon_threads = True
    # Two servers on one port would take turns in answering: the second must fail.
    allow_reuse_port = False

    def __init__(self, site: Site, host: str, port: int) -> None:
        self.site, self.named_host = site, host
        self._images: OrderedDict[int, Resource] = OrderedDict()
        self._lock = threading.Lock()
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self.address_family = family
            super().__init__((str(address[0]), int(address[1])), _Handler)
        except (OSError, OverflowError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UsageError(
                f"cannot listen on {host} port {port}: {reason}; --port 0 takes a free one, --host names the address"
            ) from error

    def server_bind(self) -> None:
        """Bind without asking a name server for the machine's name, which `HTTPServer` would wait for."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    @property
    def url(self) -> str:
        """Where the page is."""
        host = f"[{self.named_host}]" if ":" in self.named_host else self.named_host
        return f"http://{host}:{self.server_port}/"

    @property
    def local(self) -> bool:
        """Whether only programs of this machine can reach it."""
        return ipaddress.ip_address(self.server_name.partition("%")[0]).is_loopback

    def find(self, path: str) -> Resource | None:
        """Return what is at a path, None where nothing is.

        Raises
        ------
        SlamcliError
            If it is an image that cannot be read.
        """
        known = self.site.resources.get(path)
        if known is not None:
            return known
        match = re.fullmatch(r"/image/(0|[1-9][0-9]{0,7})\.jpg", path)
        if match is None or self.site.image is None or int(match[1]) >= self.site.num_images:
            return None
        number = int(match[1])
        with self._lock:  # one at a time: a recording is read by one reader
            if number not in self._images:
                self._images[number] = Resource("image/jpeg", self.site.image(number))
            self._images.move_to_end(number)
            while len(self._images) > _MOST_KEPT_IMAGES:
                self._images.popitem(last=False)
            return self._images[number]

    def trusts(self, host: str | None) -> bool:
        """Return whether a request's Host may be ours.

        A page elsewhere whose name is made to point at this machine (DNS rebinding) sends its own name; addresses,
        localhost and the name that was given to us cannot be its.
        """
        if not host:
            return False
        name = re.sub(r":[0-9]*$", "", host).strip("[]").lower()
        with contextlib.suppress(ValueError):
            ipaddress.ip_address(name)
            return True
        return name in ("localhost", self.named_host.lower()) or name.endswith(".localhost")

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of browsers that went away."""


class _Handler(BaseHTTPRequestHandler):
    server: PlayerServer
    protocol_version = "HTTP/1.1"
    timeout = _IDLE_S

    def do_GET(self) -> None:
        """Answer with what is at the path."""
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        """Answer with its headers."""
        self._answer(with_body=False)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer what is no request for a page in one line; http.server's own answer is a page without a policy."""
        del explain
        status = HTTPStatus.METHOD_NOT_ALLOWED if code == HTTPStatus.NOT_IMPLEMENTED else HTTPStatus(code)
        self.close_connection = True
        self._refuse(status, message or status.phrase, with_body=True)

    def version_string(self) -> str:
        """Return the name that answers bear."""
        return "slamcli"

    def _answer(self, *, with_body: bool) -> None:
        if not self.server.trusts(self.headers.get("Host")):
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST, "this server does not go by that name", with_body=with_body)
            return
        try:
            found = self.server.find(self.path.partition("?")[0])
        except SlamcliError as error:
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, str(error), with_body=with_body)
            return
        if found is None:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here", with_body=with_body)
            return
        if found.etag in self.headers.get("If-None-Match", ""):
            self._send(HTTPStatus.NOT_MODIFIED, {"ETag": found.etag}, b"", with_body=False)
            return
        packed = found.packed() if re.search(r"\bgzip\b", self.headers.get("Accept-Encoding", "")) else None
        headers = {"Content-Type": found.content_type, "ETag": found.etag, "Vary": "Accept-Encoding"}
        if packed is not None:
            headers["Content-Encoding"] = "gzip"
        self._send(HTTPStatus.OK, headers, packed if packed is not None else found.content, with_body=with_body)

    def _refuse(self, status: HTTPStatus, reason: str, *, with_body: bool) -> None:
        headers = {"Content-Type": "text/plain; charset=utf-8"}
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = "GET, HEAD"
        if self.close_connection:
            headers["Connection"] = "close"
        self._send(status, headers, f"{reason}\n".encode(), with_body=with_body)

    def _send(self, status: HTTPStatus, headers: Mapping[str, str], body: bytes, *, with_body: bool) -> None:
        self.send_response(status)
        fixed = {
            "Cache-Control": "no-cache", "Content-Security-Policy": _POLICY, "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
        }  # fmt: skip
        for name, value in {**fixed, **headers}.items():
            self.send_header(name, value)
        if status != HTTPStatus.NOT_MODIFIED:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the page asks for much."""
