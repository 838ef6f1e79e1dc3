# SPDX-License-Identifier: MIT
"""The player's server: what it knows and nothing else, to whom it may, with headers that a browser holds it to."""

from __future__ import annotations

import gzip
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading

import player_result
import pytest

from slamcli.cli.main import run
from slamcli.errors import DataError
from slamcli.pipelines.schemas import first_deviation, schema_of
from slamcli.pipelines.serve_http import PlayerServer, Resource, Site

TEXT = b"hello, " * 200


def image(number):
    if number == 2:
        raise DataError("the recording has gone")
    return b"\xff\xd8" + bytes([number])


@pytest.fixture(scope="module")
def server():
    resources = {
        "/": Resource("text/html; charset=utf-8", TEXT),
        "/data/pose.bin": Resource("application/octet-stream", b"1234"),
    }
    with PlayerServer(Site(resources=resources, num_images=3, image=image), "127.0.0.1", 0) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers, skip_accept_encoding=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def test_what_is_there_comes_with_its_type_and_a_strict_policy(server):
    status, headers, body = ask(server, "/")
    assert (status, body, headers["Content-Type"]) == (200, TEXT, "text/html; charset=utf-8")
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'")
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Access-Control-Allow-Origin" not in headers
    assert headers["Server"] == "slamcli"
    assert ask(server, "/?x=1")[0] == 200
    assert ask(server, "/image/1.jpg")[2] == b"\xff\xd8\x01"
    assert server.url == f"http://127.0.0.1:{server.server_port}/"
    assert server.local


def test_head_has_no_body_and_gzip_is_for_those_who_take_it(server):
    status, headers, body = ask(server, "/", "HEAD")
    assert (status, headers["Content-Length"], body) == (200, str(len(TEXT)), b"")
    _, headers, body = ask(server, "/", Accept_Encoding="br, gzip")
    assert headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(body) == TEXT
    assert "Content-Encoding" not in ask(server, "/data/pose.bin", Accept_Encoding="gzip")[1]


def test_what_a_browser_has_is_not_sent_again(server):
    tag = ask(server, "/")[1]["ETag"]
    status, headers, body = ask(server, "/", If_None_Match=tag)
    assert (status, headers["ETag"], body) == (304, tag, b"")
    assert ask(server, "/", If_None_Match='"other"')[0] == 200


@pytest.mark.parametrize(
    "path", ["/run.json", "/../run.json", "//etc/passwd", "/%2e%2e/run.json", "/data/", "/image/3.jpg", "/image/-1.jpg", "/image/01.jpg", "/image/99999999999.jpg"],
)  # fmt: skip
def test_nothing_else_is_there(server, path):
    assert ask(server, path)[0] == 404


def test_an_image_that_cannot_be_read_is_said(server):
    status, headers, body = ask(server, "/image/2.jpg")
    assert (status, body) == (500, b"the recording has gone\n")
    assert headers["Content-Type"].startswith("text/plain")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_only_get_and_head(server, method):
    status, headers, _ = ask(server, "/", method)
    assert (status, headers["Allow"]) == (405, "GET, HEAD")
    assert "Content-Security-Policy" in headers


@pytest.mark.parametrize(
    ("host", "status"),
    [("localhost:1234", 200), ("127.0.0.1", 200), ("[::1]:80", 200), ("192.168.0.7:80", 200), ("evil.example", 421), ("evil.example:80", 421), ("localhost.evil.example", 421), ("", 421)],
)  # fmt: skip
def test_a_name_that_is_not_ours_is_refused(server, host, status):
    assert ask(server, "/", Host=host)[0] == status


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return player_result.write(tmp_path_factory.mktemp("served"))


def start(*arguments, **options):
    code = "import sys; from slamcli.cli.main import run; sys.exit(run(sys.argv[1:]))"
    return subprocess.Popen([sys.executable, "-c", code, "view", *arguments], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)  # fmt: skip


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_line_is_the_address_and_a_signal_ends_it(result, number):
    with start(str(result), "--serve") as process:
        url = process.stdout.readline().strip()
        assert url.startswith("http://127.0.0.1:")
        connection = http.client.HTTPConnection(url.removeprefix("http://").rstrip("/"), timeout=30)
        connection.request("GET", "/replay.json")
        assert b'"title":"result"' in connection.getresponse().read()
        connection.close()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "")
    assert "Traceback" not in err
    assert f"playing {result} at {url}" in err


def test_wrong_options_are_one_line_and_exit_code_2(result, capsys, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for arguments, message in (
            ([str(result), "--serve", "--port", str(port)], f"cannot listen on 127.0.0.1 port {port}: Address already in use"),
            ([str(result), "--serve", "--host", "no.such.host.invalid"], "cannot listen on no.such.host.invalid"),
            ([str(result / "map.yaml"), "--serve"], "--serve plays the folder that slamcli map wrote;"),
            ([str(result), "--serve", "--export", "a.html"], "two ways to the same page"),
            ([str(result), "--serve", "-o", "a.png"], "-o names a picture, and --serve makes none"),
            ([str(result), "--export", str(tmp_path / "a.txt")], "name ends with .html"),
            ([str(result), "--port", "80"], "--port is for --serve"),
            ([str(tmp_path / "missing"), "--serve"], "missing: no such file or folder"),
            ([str(result), "--serve", "--recording", str(tmp_path / "no.bag")], "no.bag"),
        ):  # fmt: skip
            assert run(["view", *arguments]) == 2
            captured = capsys.readouterr()
            assert captured.out == ""
            assert message in captured.err
            assert captured.err.count("\n") == 1
    assert os.listdir(tmp_path) == []  # noqa: PTH208


def test_export_prints_its_name(result, capsys, tmp_path):
    assert run(["view", str(result), "--export", str(tmp_path / "a.html"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (next(iter(document)), document["schema"], document["kind"]) == ("schema", "slamcli.view.1", "player")
    assert first_deviation(document, schema_of(document)) is None
    assert document["size_bytes"] == (tmp_path / "a.html").stat().st_size
    assert (tmp_path / "a.html").stat().st_size > 10_000


def test_a_script_gets_the_address_as_json(result):
    with start(str(result), "--serve", "--json") as process:
        lines = iter(process.stdout.readline, "}\n")
        document = json.loads("".join(lines) + "}")
        assert next(iter(document)) == "schema"
        assert first_deviation(document, schema_of(document)) is None
        assert document["url"].startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0


def test_an_address_that_others_reach_is_warned_of(result):
    with start(str(result), "--serve", "--host", "0.0.0.0") as process:  # noqa: S104
        assert process.stdout.readline().startswith("http://0.0.0.0:")
        assert process.stderr.readline().startswith("warning: http://0.0.0.0:")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0
