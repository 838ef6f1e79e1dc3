# SPDX-License-Identifier: MIT
"""The player in a real Chromium: it loads without a complaint, plays, and does what its controls say."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading

import player_result
import pytest

BROWSER, DRIVER = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="no Chromium with its driver (apt-get install chromium chromium-driver)"
)
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--window-size=1100,760",
)  # fmt: skip
PATIENCE_S = 60
KNOWN = "return player.layers.find((one) => one.name === 'Map').layer.growth.known(player.moment().count)"
COLOURS = """
player.draw();
const view = document.getElementById("view"), found = {};
const pen = new OffscreenCanvas(view.width, view.height).getContext("2d", { willReadFrequently: true });
pen.drawImage(view, 0, 0);
const data = pen.getImageData(0, 0, view.width, view.height).data;
for (let i = 0; i < data.length; i += 4) {
  const name = [data[i], data[i + 1], data[i + 2]].map((one) => one.toString(16).padStart(2, "0")).join("");
  found[name] = (found[name] || 0) + 1;
}
return found;
"""
WHITE, ORANGE = "ffffff", "d55e00"
"""Free cells, and points of the scan, in light colours."""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return player_result.write(tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="module")
def address(result):
    code = "import sys; from slamcli.cli.main import run; sys.exit(run(sys.argv[1:]))"
    arguments = ["view", str(result), "--serve", "--truth", str(result.parent / "truth.tum")]
    with subprocess.Popen([sys.executable, "-c", code, *arguments], text=True, stdout=subprocess.PIPE) as process:
        yield process.stdout.readline().strip()
        process.send_signal(signal.SIGINT)
        process.wait(timeout=PATIENCE_S)
    assert process.returncode == 0


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = Service(executable_path=DRIVER, env={**os.environ, "NO_PROXY": "*"})
    driver = webdriver.Chrome(options=options, service=service)
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light(motion="no-preference")})
    driver.set_page_load_timeout(PATIENCE_S)
    yield driver
    driver.quit()


def light(motion, scheme="light"):
    return [{"name": "prefers-color-scheme", "value": scheme}, {"name": "prefers-reduced-motion", "value": motion}]


def until(driver, condition, *arguments):
    """Wait until a script's condition holds."""
    from selenium.webdriver.support.ui import WebDriverWait

    wait = WebDriverWait(driver, PATIENCE_S, poll_frequency=0.05)
    return wait.until(lambda d: d.execute_script(f"return {condition}", *arguments))


def opened(driver, url):
    driver.get("about:blank")  # the same page with another fragment would not be loaded again
    driver.get_log("browser")
    driver.get(url)
    until(
        driver,
        "!!window.player || /cannot be played/.test(document.getElementById('loading').textContent)",
    )
    return driver


@pytest.fixture
def page(chromium, address):
    """Return the page at rest at its beginning; whatever the test did, the browser must not have complained."""
    yield opened(chromium, f"{address}#paused&t=0")
    assert chromium.get_log("browser") == []


def press(driver, *keys):
    from selenium.webdriver.common.action_chains import ActionChains

    for key in keys:
        ActionChains(driver).send_keys(key).perform()


def at(driver):
    return driver.execute_script("return player.time")


def test_everything_is_on_the_page(page):
    assert page.title == "result"
    assert "gmapping · 20 poses · 5.0 m · map of 82 × 32 cells of 10 cm" in page.find_element("id", "facts").text
    layers = [label.text for label in page.find_elements("css selector", "#layers label")]
    assert layers == ["Map", "Edges", "Loop edges", "Ground truth", "Trajectory", "Nodes", "Scan", "Robot", "Particles"]
    assert [h.text.split("\n")[0] for h in page.find_elements("css selector", ".chart h2")] == ["Points of each scan", "Effective number of particles"]  # fmt: skip
    assert page.find_element("id", "time").text == "0:00.0 / 0:09.5"
    unnamed = """return [...document.querySelectorAll("button, input, select, canvas, img")].filter((one) => one.offsetParent
      && !one.closest("[aria-hidden]") && !one.labels?.length && !one.getAttribute("aria-label") && !one.alt && !one.className).map((one) => one.outerHTML)"""
    assert page.execute_script(unnamed) == []


def test_it_plays_by_itself_and_ends(chromium, address):
    opened(chromium, f"{address}#speed=200")
    until(chromium, "player.time === player.duration && !player.playing")
    assert chromium.get_log("browser") == []
    again = "document.getElementById('play').click(); return [player.time, player.playing]"
    assert chromium.execute_script(again) == [0, True]


def test_no_film_for_those_who_want_less_motion(chromium, address):
    chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light(motion="reduce")})
    try:
        opened(chromium, address)
        assert chromium.execute_script("return [player.playing, player.time]") == [False, 0]
    finally:
        chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light(motion="no-preference")})


def test_the_map_grows_and_shrinks_again(page):
    known, white = [], []
    for time in (0, 3, 9.5, 3, 0):
        page.execute_script("player.seek(arguments[0])", time)
        known.append(page.execute_script(KNOWN))
        white.append(page.execute_script(COLOURS).get(WHITE, 0))
    assert known[0] < known[1] < known[2] == 82 * 32
    assert known[3:] == known[1::-1]
    assert 0 < white[0] < white[1] < white[2]
    assert white[3:] == white[1::-1]


def test_a_reduced_map_grows_as_the_whole_one(page):
    reduced = """const growth = player.layers[0].layer.growth, seen = [];
      const pen = new OffscreenCanvas(41, 16).getContext("2d", { willReadFrequently: true });
      for (const count of [1, 8, 20, 8, 1]) {
        pen.clearRect(0, 0, 41, 16);
        pen.drawImage(growth.canvas(count, 0.3), 0, 0);
        seen.push([...pen.getImageData(0, 0, 41, 16).data].join());
      }
      return seen.map((one) => seen.indexOf(one))"""
    assert page.execute_script(reduced) == [0, 1, 2, 1, 0]
    assert page.execute_script("return player.layers[0].layer.growth.levels.map((one) => [one.width, one.height])") == [[82, 32], [41, 16]]  # fmt: skip


def test_keys(page):
    from selenium.webdriver.common.keys import Keys

    press(page, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert at(page) == 1.0
    press(page, Keys.ARROW_LEFT)
    assert at(page) == 0.5
    press(page, Keys.END)
    assert at(page) == 9.5
    press(page, Keys.HOME)
    assert at(page) == 0
    speed = page.execute_script("return player.speed")
    press(page, "+")
    faster = page.execute_script("return player.speed")
    assert faster > speed
    press(page, "-")
    assert page.execute_script("return player.speed") == speed
    press(page, "f")
    assert page.execute_script("return player.camera.follow")
    press(page, "0")
    assert page.execute_script("return [player.camera.follow, player.camera.whole]") == [False, True]
    press(page, " ")
    until(page, "player.playing && player.time > 0")
    press(page, " ")
    assert not page.execute_script("return player.playing")
    press(page, "?")
    assert page.find_element("id", "keys").is_displayed()
    press(page, Keys.ESCAPE)
    until(page, "!document.getElementById('keys').open")


def test_layers_are_switched(page):
    page.execute_script("player.seek(9.5)")
    before = page.execute_script(COLOURS)
    assert before[ORANGE] > 20
    numbers = {label.text: label for label in page.find_elements("css selector", "#layers label")}
    numbers["Scan"].click()
    assert ORANGE not in page.execute_script(COLOURS)
    press(page, "1")
    assert page.execute_script(COLOURS).get(WHITE, 0) < 0.2 * before[WHITE]


def test_the_time_line_is_dragged(page):
    from selenium.webdriver.common.action_chains import ActionChains

    bar = page.find_element("id", "scrub")
    ActionChains(page).move_to_element(bar).click().perform()
    assert 3 < at(page) < 6.5
    until(page, "document.getElementById('scrub').getAttribute('aria-valuetext').endsWith('of 0:09.5')")
    assert re.fullmatch(r"0:0\d\.\d of 0:09\.5", bar.get_attribute("aria-valuetext"))
    page.find_element("css selector", ".chart canvas").click()
    until(page, "Math.abs(player.time - 5) < 2")


def test_buttons_zoom_and_drag(page):
    from selenium.webdriver.common.action_chains import ActionChains

    scale = page.execute_script("return player.camera.scale")
    page.find_element("id", "closer").click()
    assert page.execute_script("return player.camera.scale") == pytest.approx(1.5 * scale)
    x, y = page.execute_script("return [player.camera.x, player.camera.y]")
    view = page.find_element("id", "view")
    ActionChains(page).drag_and_drop_by_offset(view, 60, -30).perform()
    moved = page.execute_script("return [player.camera.x, player.camera.y]")
    assert moved == pytest.approx([x - 60 / (1.5 * scale), y - 30 / (1.5 * scale)])
    page.find_element("id", "whole").click()
    assert page.execute_script("return player.camera.scale") == pytest.approx(scale)
    page.find_element("id", "follow").click()
    page.execute_script("player.seek(9.5); player.draw()")
    assert page.execute_script("return [player.camera.x, player.camera.y]") == pytest.approx([6.0, 1.5], abs=1e-6)


def test_the_image_is_the_nearest_one(page):
    until(page, "document.getElementById('image').naturalWidth === 32")
    assert page.find_element("id", "stamp").text == "at 0:00.0"
    page.execute_script("player.seek(7)")
    until(page, "document.getElementById('image').src.endsWith('/image/2.jpg')")
    until(page, "document.getElementById('stamp').textContent === 'at 0:07.5'")


@pytest.mark.parametrize(("width", "height"), [(390, 800), (700, 400), (1600, 900)])
def test_it_fits_the_window(page, width, height):
    page.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    )  # fmt: skip
    try:
        until(page, "innerWidth === arguments[0] && Math.abs(player.camera.width - document.getElementById('view').clientWidth) < 1", width)  # fmt: skip
        assert page.execute_script("return document.documentElement.scrollWidth") <= width
        box = page.execute_script("const r = document.getElementById('play').getBoundingClientRect(); return [r.left, r.right, r.top, r.bottom]")  # fmt: skip
        assert 0 <= box[0] < box[1] <= width
        assert 0 <= box[2] < box[3] <= height
        assert page.execute_script(COLOURS)[WHITE] > 1000
    finally:
        page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_dark_and_light(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light("no-preference", "dark")})
    try:
        until(page, "document.documentElement.dataset.theme === 'dark'")
        assert WHITE not in page.execute_script(COLOURS)
        page.find_element("id", "theme").click()
        assert page.execute_script(COLOURS)[WHITE] > 1000
    finally:
        page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light("no-preference")})


def test_a_loop_appears_when_it_is_closed(page):
    for label in page.find_elements("css selector", "#layers label"):
        if label.text in ("Ground truth", "Trajectory", "Robot", "Particles", "Scan"):
            label.click()
    page.execute_script("player.seek(7.4)")
    closure = "b0307a"
    assert closure not in page.execute_script(COLOURS)
    page.execute_script("player.seek(7.5)")
    assert page.execute_script(COLOURS)[closure] > 10
    assert page.execute_script("return player.facts.marks") == {"closure": [7.5], "resampling": [6]}
    assert "loop closed" in page.find_element("id", "legend").text


def test_the_page_in_one_file_plays_too(chromium, result, tmp_path):
    from slamcli.pipelines.serve import export_player
    from slamcli.runtime import RunLog

    target = tmp_path / "page.html"
    export_player(result, target, log=RunLog())
    opened(chromium, f"{target.as_uri()}#speed=200")
    until(chromium, "player.time === player.duration")
    assert chromium.execute_script(KNOWN) == 82 * 32
    until(chromium, "document.getElementById('image').naturalWidth === 32")
    assert chromium.get_log("browser") == []


def test_what_cannot_be_loaded_is_said(chromium, result):
    from slamcli.pipelines.serve import open_player
    from slamcli.runtime import RunLog

    with open_player(result, log=RunLog()) as server:
        del server.site.resources["/data/cells.bin"]
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        opened(chromium, server.url)
        said = chromium.find_element("id", "loading").text
        server.shutdown()
        thread.join()
    assert said == "This result cannot be played: data/cells.bin: the server answers 404"
    chromium.get_log("browser")
