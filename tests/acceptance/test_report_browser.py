"""The report page in a real browser: quiet, offline, whole at any width, light and dark, on paper."""

import base64
import json
import re
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import diagnoses
import ladders
import numpy as np
import pytest
import report_contexts
import worlds

from pumaid.estimation.evaluate import JointPrediction, predictions, rmse
from pumaid.reporting.page import ReportContext, page, report_files, what_if

pytestmark = pytest.mark.browser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)

#: Luminance contrast that the Web Content Accessibility Guidelines 2.1 ask of text (criterion 1.4.3).
CONTRAST = 4.5

#: px: smallest text of a figure on a 400 px page that is still read without zooming.
SMALLEST = 8.0


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[object]:
    """A headless Chromium with a profile of its own that logs its console and its network."""
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("needs chromium and chromedriver (Debian: apt-get install chromium chromium-driver)")
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium (pip install 'pumaid[test]')")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture(scope="module", params=["ordinary", "hostile"])
def address(request, tmp_path_factory) -> str:
    """Where the page of a six-joint arm, or of one with dangerous names, lies."""
    ordinary = request.param == "ordinary"
    context = report_contexts.small(worlds.STANFORD, units="deg") if ordinary else report_contexts.hostile()
    context = replace(context, ladder=ladders.ladder(7, context.robot.n_joints))
    if request.param == "hostile":
        context = replace(context, diagnosis=diagnoses.small(), stale=(report_contexts.HOSTILE,))
    path: Path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_bytes(dict(report_files(context, []))["report.html"])
    return path.as_uri()


def shown(browser, address: str, *, width: int, scheme: str = "light"):
    """The page at `width` px for a reader who prefers `scheme`."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": features})
    browser.get(address)
    return browser


def test_nothing_is_fetched_and_nothing_complained_of(browser, address):
    """The only request is the page itself, and the console is silent."""
    for log in ("browser", "performance"):
        browser.get_log(log)
    shown(browser, address, width=1600)
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert {url for url in urls if not url.startswith("data:")} == {address}
    assert browser.get_log("browser") == []


@pytest.mark.parametrize("width", [400, 1600])
def test_every_figure_is_seen(browser, address, width):
    """The page is as wide as its window; each figure lies inside it at a size that can be read, and has ink in it."""
    shown(browser, address, width=width)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    boxes = browser.execute_script(
        "return [...document.querySelectorAll('figure svg')].map(s => {const b = s.getBoundingClientRect();"
        " return [b.left, b.width, b.height, s.querySelectorAll('path').length]})"
    )
    assert len(boxes) == len(set(re.findall(r'<figure id="([^"]+)"', browser.page_source))) >= 8
    for left, wide, high, paths in boxes:
        assert left >= 0 and wide >= min(280, 0.7 * width) and high >= 90 and paths > 3


def test_words_in_figures_can_be_read_on_a_phone(browser, address):
    """At 400 px no text of a figure is smaller than the eye takes."""
    shown(browser, address, width=400)
    heights = browser.execute_script(
        "return [...document.querySelectorAll('figure:not(.wide) svg text')].map(t => parseFloat("
        "getComputedStyle(t).fontSize) * t.getScreenCTM().a).filter(size => size > 0)"
    )
    assert heights and min(heights) >= SMALLEST


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_stand_out_from_the_page(browser, address, scheme):
    """Text, in figures too, has the contrast that accessibility asks for, on light and on dark."""
    shown(browser, address, width=1600, scheme=scheme)
    paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    inks = browser.execute_script(
        "return ['p', 'li', 'td', 'th', 'figcaption', 'a', 'td.alarm', 'td.unknown', 'figure svg'].map(s =>"
        " document.querySelector(s)).filter(Boolean).map(e => getComputedStyle(e).color)"
    )
    assert (luminance(paper) < 0.1) == (scheme == "dark")
    assert all(contrast(ink, paper) >= CONTRAST for ink in inks)


def luminance(colour: str) -> float:
    """Relative luminance of ``rgb(r, g, b)`` (WCAG 2.1)."""
    parts = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    red, green, blue = (p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(ink: str, paper: str) -> float:
    """Contrast of two colours (WCAG 2.1)."""
    high, low = sorted((luminance(ink), luminance(paper)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.fixture(scope="module")
def live(tmp_path_factory) -> tuple[ReportContext, str]:
    """A six-joint arm of which stribeck friction is said to be missing at joint 1, in degrees, and its page."""
    context = replace(report_contexts.small(worlds.STANFORD, units="deg"), diagnosis=diagnoses.small())
    path: Path = tmp_path_factory.mktemp("live") / "report.html"
    path.write_text(page(context, [(part, part.content(context)) for part in what_if.SECTIONS], {}), encoding="utf-8")
    return context, path.as_uri()


#: Helpers of a script in the page: a joint is chosen (from 1), a parameter gets a value, an effect is switched.
HANDS = """
const all = (s) => [...document.querySelectorAll('.what-if ' + s)];
const tell = (node, kind) => node.dispatchEvent(new Event(kind));
const joint = (n) => { const box = all('[name=joint]')[0]; box.selectedIndex = n - 1; tell(box, 'change'); };
const bar = (name) => all('.slider').find((r) => r.innerText.includes(name)).querySelector('[type=range]');
const move = (name, by) => { bar(name).value = Number(bar(name).value) + by; tell(bar(name), 'input'); };
const tick = (name) => all('legend label').find((l) => l.textContent.startsWith(name)).querySelector('input').click();
const errors = () => all('.numbers dd').map((d) => d.firstChild.textContent);
"""


def program(context: ReportContext, joint: int, changes: dict[str, float]) -> list[str]:
    """RMSE of fitted and held-out runs of a joint by the program, to four digits; `changes` are new parameters."""
    names, solution = context.estimate.names, context.estimate.solution.copy()
    for name, value in changes.items():
        solution[names.index(name)] = value
    part = predictions(replace(context.estimate, solution=solution), context.dataset, context.robot)[joint]
    return [digits(rmse([(part, runs)])) for runs in (part.counted, part.heldout) if runs.any()]


def digits(value: float) -> str:
    """An RMSE as the page shows it."""
    return f"{value:#.4g} A"


def test_errors_follow_a_slider_as_the_program_says(browser, live):
    """RMSE of fitted and unseen runs is that of the program with the parameter changed, whatever was moved before."""
    context, address = live
    shown(browser, address, width=1600)
    value = dict(zip(context.estimate.names, context.estimate.solution, strict=True))
    texts = browser.execute_script(HANDS + "joint(6); move('coulomb.j6.plus', 0.03); return errors();")
    assert texts[:2] == program(context, 6, {"coulomb.j6.plus": value["coulomb.j6.plus"] + 0.03})
    texts = browser.execute_script(HANDS + "move('viscous.j6.minus', 0.0004); return errors();")  # A s/deg
    changes = {"coulomb.j6.plus": 0.03, "viscous.j6.minus": 0.0004 * 180.0 / np.pi}
    assert texts[:2] == program(context, 6, {name: value[name] + by for name, by in changes.items()})
    texts = browser.execute_script(HANDS + "joint(2); move('gravity.l2.x', 0.02); return errors();")
    assert texts[0] == program(context, 2, {"gravity.l2.x": value["gravity.l2.x"] + 0.02})[0]


def test_an_effect_that_is_off_is_as_the_program_says(browser, live):
    """Without gravity, that of links further out too, the RMSE is the program's; Reset brings the model back."""
    context, address = live
    shown(browser, address, width=1600)
    texts = browser.execute_script(HANDS + "joint(2); tick('gravity'); return errors();")
    weights = {name: 0.0 for name in context.estimate.names if name.startswith("gravity")}
    assert texts[0] == program(context, 2, weights)[0] != program(context, 2, {})[0]
    texts = browser.execute_script(HANDS + "all('[name=reset]')[0].click(); return errors();")
    assert texts[0] == program(context, 2, {})[0]


def least_squares(part: JointPrediction, columns: list[np.ndarray]) -> str:
    """The RMSE of a least-squares fit of (N,) columns to the counted runs of a joint."""
    weight = np.sqrt(part.bins.count * part.counted[part.bins.run])
    matrix, current = np.column_stack(columns) * weight[:, None], part.bins.current * weight
    left = current - matrix @ np.linalg.lstsq(matrix, current, rcond=None)[0]
    return digits(np.sqrt((left @ left + weight**2 @ part.inside) / (weight @ weight)))


def test_best_fit_and_a_missing_effect_are_least_squares(browser, live):
    """With an effect off the rest is refitted; an effect that is ticked is fitted with the rest, at its shape."""
    context, address = live
    part = predictions(context.estimate, context.dataset, context.robot)[1]
    columns = dict(zip(context.estimate.names, part.design.T, strict=True))
    coulomb, speed = [columns["coulomb.j1.plus"], columns["coulomb.j1.minus"]], part.bins.samples.velocity[:, 0]
    shown(browser, address, width=1600)
    without = browser.execute_script(HANDS + "tick('viscous'); all('[name=fit]')[0].click(); return errors();")[0]
    assert without == least_squares(part, coulomb)
    added = browser.execute_script(HANDS + "tick('stribeck'); return errors();")[0]
    stribeck = np.sign(speed) * np.exp(-np.abs(speed) / 0.12)
    assert added == least_squares(part, [*coulomb, stribeck]) and float(added[:-2]) < float(without[:-2])


def test_sliders_are_fast(browser, live):
    """A slider of each of six joints is moved, and the plots are drawn, in less than a third of a second."""
    shown(browser, live[1], width=1600)
    time = browser.execute_async_script(
        HANDS
        + """const done = arguments[0]; let sum = 0;
        (async () => {
          for (let n = 1; n < 7; n++) {
            joint(n);
            await null;
            const start = performance.now();
            move('coulomb', 0.01);
            await null;  // uPlot draws once all is told
            sum += performance.now() - start;
          }
          done(sum);
        })();"""
    )
    assert 0.0 < time < 300.0


def test_prints_to_several_pages(browser, address):
    """On paper the page is light, breaks into sheets, and cuts no figure in two."""
    shown(browser, address, width=1600, scheme="dark")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    options = {"paperWidth": 8.27, "paperHeight": 11.69, "printBackground": True}
    pdf = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", options)["data"])
    assert pdf.startswith(b"%PDF") and pages(pdf) > 1
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    breaks = browser.execute_script(
        "return [...document.querySelectorAll('figure')].map(f => getComputedStyle(f).breakInside)"
    )
    assert luminance(paper) > 0.9 and set(breaks) == {"avoid"}


def pages(pdf: bytes) -> int:
    """Sheets of a PDF, its compressed parts opened."""
    parts = [pdf]
    for found in re.finditer(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL):
        try:
            parts.append(zlib.decompress(found[1]))
        except zlib.error:
            continue
    return sum(len(re.findall(rb"/Type\s*/Page(?![a-zA-Z])", part)) for part in parts)
