"""What people do with the page, in a browser.

A dive, or many, is dropped and recognised; marked healthy; diagnosed, in a queue that tells how far it is and can be
left; read as a report and as curves; compared; followed over time; its files come down; all is there after a restart.
In dark, on 400 px, by keys alone, and without script.
"""

import re
from base64 import b64encode

import pytest

from auv_torchrl.page import jobs
from tests.flightlog.dataflash_writer import ALL, flown
from tests.flightlog.shared_data import EXCERPTS
from tests.flightlog.simulate import simulated_logs
from tests.page.conftest import another, page_server

DIVE = next(EXCERPTS.glob("*.BIN*"))
TIMEOUT_MS = 90_000
# The contrast of every text with what is behind it, by the formula of WCAG 2; large text needs 3, all other 4.5.
CONTRAST = """() => {
  const parse = (text) => (text.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const found = [];
  for (const element of document.body.querySelectorAll("*")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    const box = element.getBoundingClientRect();
    const off = element.closest("noscript, .unseen, .skip, :disabled");
    if (!own || off || !box.width || getComputedStyle(element).visibility === "hidden") continue;
    let behind = element;
    while (behind && (parse(getComputedStyle(behind).backgroundColor)[3] ?? 1) === 0) behind = behind.parentElement;
    const under = behind ? light(parse(getComputedStyle(behind).backgroundColor)) : 1;
    const style = getComputedStyle(element);
    const over = light(parse(style.color));
    const ratio = (Math.max(over, under) + 0.05) / (Math.min(over, under) + 0.05);
    const size = parseFloat(style.fontSize);
    const least = size >= 24 || (size >= 18.66 && style.fontWeight >= 700) ? 3 : 4.5;
    if (ratio < least) found.push(`${ratio.toFixed(2)}: ${element.textContent.trim().slice(0, 40)}`);
  }
  return found;
}"""
UNNAMED = """() => [...document.querySelectorAll(
    "button, select, input:not([type=hidden]), a, progress, iframe, [role=img]")]
  .filter((element) => !(element.innerText || element.title || element.getAttribute("aria-label")
    || (element.labels && element.labels.length)))
  .map((element) => element.outerHTML.slice(0, 80))"""
WIDER = "() => document.documentElement.scrollWidth > document.documentElement.clientWidth"


@pytest.fixture(scope="module")
def address(tmp_path_factory, standin, browser):
    """A page with two dives and the stand-in for the diagnosis."""
    with page_server(tmp_path_factory.mktemp("served") / "page") as found:
        yield found


@pytest.fixture
def tab(browser, address):
    """A tab in which no script may fail and nothing is loaded from elsewhere."""
    context = browser.new_context(viewport={"width": 1200, "height": 800})
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("response", lambda answer: wrong.extend([] if answer.url.startswith(address) else [answer.url]))
    page.on("requestfailed", lambda r: wrong.extend([] if r.url.startswith(address) or r.failure == "csp" else [r.url]))
    page.goto(address)
    yield page
    context.close()
    assert wrong == []


def drop(page, name, content):
    """Drop a file on the page as a hand does, and wait until it is read."""
    (row,) = drop_all(page, {name: content})
    return row


def drop_all(page, files):
    """Drop files on the page, contents by name, all at once, and wait until they are read."""
    give(page, files)
    rows = [page.locator("#dives tr", has_text=name) for name in files]
    for row in rows:
        row.locator("select").wait_for()
    return rows


def give(page, files):
    """Drop files on the page, contents by name, all at once."""
    page.evaluate(
        """(files) => {
          const held = new DataTransfer();
          for (const [name, content] of files) {
            held.items.add(new File([Uint8Array.from(atob(content), (sign) => sign.charCodeAt(0))], name));
          }
          for (const kind of ["dragover", "drop"]) {
            document.getElementById("drop").dispatchEvent(
              new DragEvent(kind, { dataTransfer: held, bubbles: true, cancelable: true }));
          }
        }""",
        [[name, b64encode(content).decode()] for name, content in files.items()],  # a list takes a second for each
    )


def test_a_dropped_dive_comes_to_a_verdict(tab):
    """The .BIN of an autopilot: frame and vehicle are recognised, the report is shown, its files come down."""
    row = drop(tab, "dive1.BIN", DIVE.read_bytes())
    assert "vectored_6dof, 8 thrusters" in row.inner_text() and row.locator("select").input_value() == "bluerov2_heavy"
    row.get_by_role("button", name="Diagnose").click()
    tab.wait_for_selector("iframe.report")
    assert tab.inner_text("h1") == "Thruster 4 is weak."
    assert tab.frame_locator("iframe.report").locator("h1").inner_text() == "Thruster 4 is weak."
    assert downloaded(tab, "advice.param") == b"MOT_1_DIRECTION,1\n"


def test_a_report_runs_no_script_and_loads_nothing(tab, address):
    """Whatever is in it; its own style counts."""
    drop(tab, "scripts.csv", another()).get_by_role("button", name="Diagnose").click()
    report = tab.frame_locator("iframe.report")
    assert report.locator("#sign").inner_text() == "as it was"
    assert report.locator("h1").evaluate("(h) => getComputedStyle(h).color") == "rgb(1, 2, 3)"
    tab.goto(tab.locator("iframe.report").evaluate("(frame) => frame.src"))
    assert tab.inner_text("#sign") == "as it was" and tab.title() == "Diagnosis"


def test_a_healthy_dive_is_marked_by_a_click_and_taken_along(tab):
    """Here and in a second browser, without loading the page again."""
    row = drop(tab, "sound1.csv", another())
    second = tab.context.new_page()
    second.goto(tab.url)
    row.get_by_role("button", name="mark healthy").click()
    pressed = "#dives tr:has-text('sound1.csv') .mark[aria-pressed=true]"
    tab.wait_for_selector(pressed)
    second.wait_for_selector(pressed)
    drop(tab, "ill1.csv", another()).get_by_role("button", name="Diagnose").click()
    tab.wait_for_selector("iframe.report")
    assert "held against sound1.csv" in tab.inner_text("main")


def test_a_dive_that_is_marked_breaks_off_no_log_that_is_sent(tab):
    """However long that one takes to come; the page is not left, and what was ticked in it stays."""
    row = drop(tab, "here1.csv", another())
    row.get_by_label("compare").check()
    held = []
    tab.route("**/logs?name=long1.csv", lambda route: held.append(route))
    give(tab, {"long1.csv": another()})
    tab.locator("#sending li", has_text="long1.csv").wait_for()
    row.get_by_role("button", name="mark healthy").click()
    row.locator(".mark[aria-pressed=true]").wait_for()
    row.locator("select").select_option("bluerov2_heavy")
    row.locator("option[value=bluerov2_heavy][selected]").wait_for(state="attached")
    assert row.get_by_label("compare").is_checked()
    (route,) = held
    route.continue_()
    tab.locator("#dives tr", has_text="long1.csv").locator("select").wait_for()


@pytest.mark.thorough
def test_many_dives_are_dropped_at_once(tab):
    """Each is read and can be diagnosed by itself."""
    rows = drop_all(tab, {name: another() for name in ("many1.csv", "many2.csv", "many3.csv")})
    assert [row.locator("select").input_value() for row in rows] == ["paper"] * 3
    assert all(row.get_by_role("button", name="Diagnose").is_enabled() for row in rows)


def test_the_queue_tells_how_far_it_is_and_a_diagnosis_can_be_cancelled(tab):
    """The page follows by itself: the stage and the share while one runs, another waits, and comes next."""
    first, second = drop_all(tab, {"slow1.csv": another(), "next1.csv": another()})
    other = tab.context.new_page()
    other.set_default_timeout(TIMEOUT_MS)
    first.get_by_role("button", name="Diagnose").click()
    tab.locator(".stage", has_text="40 % screening effects").wait_for()
    assert tab.locator("progress").evaluate("(bar) => bar.value") == pytest.approx(0.4)
    other.goto(tab.url.split("diagnosis/")[0])
    other.locator("#dives tr", has_text="next1.csv").get_by_role("button", name="Diagnose").click()
    other.locator("#answer .tag", has_text="waits").wait_for()
    tab.get_by_role("button", name="Cancel").click()
    tab.locator("h1", has_text="It was cancelled").wait_for()
    other.locator("h1", has_text="Thruster 4 is weak.").wait_for()


def test_results_are_there_after_a_restart(browser, standin, tmp_path):
    """The next server over the folder shows the dive, its verdict and its report."""
    with browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        with page_server(tmp_path / "page") as address:
            page.goto(address)
            drop(page, "kept.csv", another()).get_by_role("button", name="Diagnose").click()
            page.wait_for_selector("iframe.report")
            place = page.url.removeprefix(address)
        with page_server(tmp_path / "page") as address:
            page.goto(address)
            assert page.locator("#dives tr", has_text="kept.csv").count() == 1
            page.goto(address + place)
            assert page.inner_text("h1") == "Thruster 4 is weak."
            assert page.frame_locator("iframe.report").locator("h1").inner_text() == "Thruster 4 is weak."


def test_advice_scenario_recording_and_calibrated_vehicle_come_down(tab, address):
    """Each as the diagnosis or the calibration wrote it."""
    row = drop(tab, "files1.csv", another())
    row.locator("select").select_option("bluerov2_heavy")
    row.get_by_role("button", name="mark healthy").click()
    tab.wait_for_selector("#dives tr:has-text('files1.csv') .mark[aria-pressed=true]")
    drop(tab, "files2.csv", another()).get_by_role("button", name="Diagnose").click()
    tab.wait_for_selector("iframe.report")
    assert downloaded(tab, "advice.param") == b"MOT_1_DIRECTION,1\n"
    assert downloaded(tab, "scenario.yaml").startswith(b"effects:")
    assert downloaded(tab, "diagnosis.rrd").startswith(b"RRF2")
    tab.goto(f"{address}vehicle/bluerov2_heavy")
    tab.get_by_role("button", name="Calibrate on").click()
    assert downloaded(tab, "bluerov2_heavy_calibrated.yaml") == b"name: calibrated\n"


def downloaded(page, name):
    """The content of the file behind a link."""
    with page.expect_download() as loading:
        page.get_by_role("link", name=name).click()
    return loading.value.path().read_bytes()


def test_the_history_of_a_vehicle_shows_its_dives_and_what_changed(tab, address):
    """In the order of the dates in their names."""
    for name in ("2026-03-01.csv", "2026-01-01.csv"):
        row = drop(tab, name, another())
        row.locator("select").select_option("bluerov2")
        tab.wait_for_selector(f"tr:has-text('{name}') option[value=bluerov2][selected]", state="attached")
    tab.locator("tr", has_text="2026-01-01.csv").get_by_role("button", name="mark healthy").click()
    tab.wait_for_selector("tr:has-text('2026-01-01.csv') .mark[aria-pressed=true]")
    tab.goto(f"{address}vehicle/bluerov2")
    assert [line.split("\n")[0][:10] for line in tab.locator(".timeline li").all_inner_texts()] == [
        "2026-01-01",
        "2026-03-01",
    ]
    tab.get_by_role("button", name="What changed from dive to dive?").click()
    tab.wait_for_selector("iframe.report")
    assert tab.locator("a", has_text="dives.html").count() == 1


def test_two_dives_are_compared_and_curves_are_looked_at_closer_by_keys(tab):
    """Cursor and zoom are shared by all curves."""
    for name in ("left.csv", "right.csv"):
        drop(tab, name, another()).locator("input[type=checkbox]").check()
    tab.get_by_role("button", name="Compare two dives").click()
    tab.wait_for_selector(".overview canvas")
    titles = tab.locator(".overview .u-title").all_inner_texts()
    assert titles[:2] == ["Depth, m (left.csv)", "Depth, m (right.csv)"]
    tab.locator(".overview button", has_text="Closer").focus()
    with tab.expect_response(re.compile("begin=")):
        tab.keyboard.press("Enter")
    tab.mouse.move(600, tab.locator(".u-over").first.bounding_box()["y"] + 40)
    told = "() => [...document.querySelectorAll('.u-legend .u-series:first-child .u-value')].map((e) => e.textContent)"
    times = tab.evaluate(told)
    assert len(times) == len(titles) and "–" not in times[:2]


def test_dives_are_chosen_and_diagnosed_by_keys_alone(tab):
    """Tab and Enter reach the button of a dive; the first stop leads past the navigation."""
    row = drop(tab, "keys.csv", another())
    tab.goto(tab.url)
    tab.keyboard.press("Tab")
    assert tab.evaluate("() => document.activeElement.className") == "skip"
    button = row.get_by_role("button", name="Diagnose")
    wanted = button.get_attribute("id")
    for _ in range(60):
        tab.keyboard.press("Tab")
        if tab.evaluate("() => document.activeElement.id") == wanted:
            break
    outline = tab.evaluate("() => getComputedStyle(document.activeElement).outlineStyle")
    tab.keyboard.press("Enter")
    tab.wait_for_selector("iframe.report")
    assert outline == "solid"


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (400, "light"),
        (1200, "dark"),
        pytest.param(400, "dark", marks=pytest.mark.thorough),
        pytest.param(1200, "light", marks=pytest.mark.thorough),
    ],
)
def test_pages_are_legible_named_and_no_wider_than_the_screen(tab, address, scheme, width):
    """Contrast of WCAG AA in light and in dark; every control has a name; 400 px are enough."""
    row = drop(tab, f"long-name-of-a-dive-{scheme}-{width}-{'x' * 40}.csv", another())
    dive = row.locator("a").first.get_attribute("href")
    tab.emulate_media(color_scheme=scheme)
    tab.set_viewport_size({"width": width, "height": 800})
    for path in ("", dive, "vehicle/", "vehicle/paper", "api"):
        tab.goto(address + path.removeprefix("./"))
        if path == dive:
            tab.wait_for_selector(".overview canvas")
        assert tab.evaluate(CONTRAST) == []
        assert tab.evaluate(UNNAMED) == []
        assert not tab.evaluate(WIDER), path


def test_a_page_goes_without_script(browser, address):
    """Choosing a file and sending the form is enough."""
    with browser.new_context(java_script_enabled=False) as context:
        page = context.new_page()
        page.goto(address)
        page.set_input_files("#files", {"name": "plain.csv", "mimeType": "text/csv", "buffer": another()})
        page.get_by_role("button", name="Send").click()
        row = page.locator("tr", has_text="plain.csv")
        row.first.wait_for()  # the click does not wait for the answer
        assert row.count() == 1


@pytest.mark.slow
def test_the_log_of_an_autopilot_comes_to_its_verdict_by_the_diagnosis_itself(browser, tmp_path, monkeypatch):
    """A reversed motor is found and a file undoes it; curves have the errors of prediction, before and after."""
    monkeypatch.setattr(jobs, "DIAGNOSE", "auv_torchrl.monitoring.command")  # others have a stand-in for it
    (log,) = simulated_logs("bluerov2_heavy", [{"thruster_gain": {"gain_1": -1.0}}], episodes=1, seconds=40.0, seed=3)
    written = flown(log, {**ALL, "MOT_1_DIRECTION": -1})
    with page_server(tmp_path / "page") as address, browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(4 * TIMEOUT_MS)
        page.goto(address)
        row = drop(page, "00000029.BIN", written)
        assert row.locator("select").input_value() == "bluerov2_heavy"
        row.get_by_role("button", name="Diagnose").click()
        page.wait_for_selector("iframe.report")
        assert "Thruster 1 gives" in page.inner_text("h1")
        assert downloaded(page, "advice.param") == b"MOT_1_DIRECTION,1\n"
        page.wait_for_selector(".overview canvas")
        assert "Error of prediction: place, m" in page.locator(".u-title").all_inner_texts()
        assert page.locator(".span-held-out").count() == 1
        assert page.frame_locator("iframe.report").locator("#verdict").inner_text() == "● explained"
