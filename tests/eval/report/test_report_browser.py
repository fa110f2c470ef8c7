"""Pages in a real browser: scripts run, the cursor reads, tables sort, nothing is fetched."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from eventsweep.eval.report.compare import pictures as side_by_side
from eventsweep.eval.report.compare.page import compare, comparison_page
from eventsweep.eval.report.compare.results import read_compared
from eventsweep.eval.report.html import page_text
from eventsweep.eval.report.run_page import run_page
from eventsweep.eval.report.study_page import _figure
from eventsweep.eval.results.results import write_results
from eventsweep.eval.studies.curves import METRICS, RobustnessCurve, draw
from eventsweep.eval.studies.definitions import STUDIES
from report_data import METHODS, SHAPE, report_data

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium in the PATH")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--virtual-time-budget=6000", "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
# Collects errors from before the page's own scripts run, and asks when all data are unpacked.
WATCH = "<script>window.wrong=[];addEventListener('error',(e)=>wrong.push(e.message));</script>"
ASK = """<script>(async () => {
  for (let k = 0; k < 300 && !document.documentElement.classList.contains("ready"); k++)
    await new Promise((done) => setTimeout(done, 10));
  let answer;
  try { answer = (() => { %s })(); } catch (error) { wrong.push(String(error)); }
  const probe = document.createElement("pre");
  probe.id = "probe";
  probe.textContent = JSON.stringify({ answer, wrong });
  document.body.append(probe);
})();</script>"""


def _browse(tmp_path, page, *flags):
    path, profile = tmp_path / "page.html", tmp_path / "profile"
    path.write_text(page, encoding="utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", *flags, path.as_uri()]
    return subprocess.run(command, capture_output=True, timeout=120, check=True).stdout.decode()


def _ask(tmp_path, page, question):
    asked = page.replace("<head>", f"<head>{WATCH}").replace("</body>", f"{ASK % question}</body>")
    dom = _browse(tmp_path, asked, "--dump-dom")
    found = json.loads(html.unescape(re.search(r'<pre id="probe">(.*?)</pre>', dom, re.S)[1]))
    assert found["wrong"] == []
    return found["answer"]


@pytest.fixture(scope="module")
def data():
    return report_data("desk")


def text_of(data, **changes):
    """The page of a run whose only case has other windows or film."""
    (case,) = data.cases
    return page_text(run_page(replace(data, cases=(replace(case, **changes),))))


@pytest.fixture(scope="module")
def page(data):
    return text_of(data)


MOVE = """
  const box = picture.getBoundingClientRect();
  picture.dispatchEvent(new PointerEvent("pointermove", {bubbles: true,
    clientX: box.left + picture.clientLeft + (x + .5) / 32 * picture.clientWidth,
    clientY: box.top + picture.clientTop + (y + .5) / 24 * picture.clientHeight}));
"""


def test_the_cursor_reads_the_same_pixel_everywhere(tmp_path, page, data):
    window = data.cases[0].windows[0]
    method = next(m for m in window.methods if m.name == "Alg1/H")
    y, x = (int(v) for v in np.argwhere(method.mask)[7])
    question = f"""
      const linked = document.querySelector(".linked"), x = {x}, y = {y};
      const pictures = [...linked.querySelectorAll(".picture")], texts = [];
      for (const picture of pictures) {{
        {MOVE} texts.push(linked.querySelector(".readout").textContent);
      }}
      const marks = [...linked.querySelectorAll("i.cross")].map((m) => [m.style.left, m.style.top]);
      return {{ texts, marks, pictures: pictures.length }};"""
    got = _ask(tmp_path, page, question)
    depth_m, truth_m = float(method.depth_m[y, x]), float(window.truth.depth_m[y, x])
    assert len(set(got["texts"])) == 1
    assert len(got["marks"]) == got["pictures"] == 6
    assert len({tuple(mark) for mark in got["marks"]}) == 1
    text = got["texts"][0]
    named = r" · (true depth|depth|error|frame|confidence) ([-\d.]+)"
    numbers = dict(re.findall(named, text))
    assert float(numbers["depth"]) == pytest.approx(depth_m, rel=1e-3)
    assert float(numbers["true depth"]) == pytest.approx(truth_m, rel=1e-3)
    assert float(numbers["error"]) == pytest.approx(100 * (depth_m - truth_m), abs=0.3)
    assert int(numbers["frame"]) == window.frame[y, x]
    assert float(numbers["confidence"]) == pytest.approx(method.confidence[y, x], rel=0.01)


def test_printed_all_is_black_on_white_and_nothing_waits_for_a_click(tmp_path, page):
    """The rules for print on a window about as wide as a sheet of A4."""
    assert page.count("@media print") > 1
    question = """
      const seen = (what) => [...document.querySelectorAll(what)].filter(
        (one) => one.getClientRects().length && getComputedStyle(one).display !== "none").length;
      return {
        ink: getComputedStyle(document.body).color, choices: seen(".choice"),
        chosen: seen(".chips label"), open: seen("nav, .controls, .readout, details:not([open])"),
        buttons: seen("button"), tables: seen("table"),
        cut: [...document.querySelectorAll(".scroll")].filter(
          (one) => one.scrollWidth > one.clientWidth + 1).length,
      };"""
    got = _ask(tmp_path, page.replace("@media print", "@media screen"), question)
    assert got["choices"] == got["chosen"] > 0
    assert got["tables"] > 0
    assert (got["ink"], got["open"], got["buttons"], got["cut"]) == ("rgb(0, 0, 0)", 0, 0, 0)
    dark = re.findall(r"@media ([^{]*prefers-color-scheme: dark[^{]*)", page)
    assert dark
    assert all(query.startswith("screen and") for query in dark)


def test_a_narrow_screen_shows_the_verdicts_of_a_comparison(tmp_path):
    for name, factor in (("a", 1.0), ("b", 2.0)):
        (tmp_path / name).mkdir()
        results = report_data("desk").results
        results.rows.loc[results.rows["metric"] == "mean_error", "value"] *= factor
        write_results(tmp_path / name, results)
    page = page_text(comparison_page(compare(read_compared([tmp_path / "a", tmp_path / "b"]))))
    page = page.replace('<html lang="en">', '<html lang="en" class="ready">')
    narrow = page.replace("@media (max-width: 560px)", "@media screen")
    question = """
      document.body.style.width = "400px";
      const cells = [...document.querySelectorAll(".of.m0 tbody td:nth-child(2)")];
      return cells.map((cell) => [cell.textContent, cell.getBoundingClientRect().right]);"""
    cells = _ask(tmp_path, narrow, question)
    assert cells
    assert all(text.startswith("undecided") and 0 < right <= 400 for text, right in cells)


@pytest.mark.slow
def test_a_comparison_shows_the_chosen_method_and_opens_what_is_folded(tmp_path, monkeypatch):
    monkeypatch.setattr(side_by_side, "load_run", lambda _: report_data("desk"))
    for name in "ab":
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, report_data("desk").results)
    page = page_text(comparison_page(compare(read_compared([tmp_path / "a", tmp_path / "b"]))))
    page = page.replace('<html lang="en">', '<html lang="en" class="ready">')
    shown = """
      const seen = () => [...document.querySelectorAll("#pictures0 .of")]
        .filter((one) => one.offsetParent && one.querySelector("img"))
        .map((one) => one.querySelector("img").alt);
      const before = seen();
      document.querySelector('label[for="pictures0-method-m1"]').click();
      const folded = document.querySelector("#settings details");
      folded.open = true;
      return [before, seen(), folded.querySelectorAll("tbody tr").length > 5];
    """
    before, after, rows = _ask(tmp_path, page, shown)
    before, after = ([alt.split(" · ")[0] for alt in alts] for alts in (before, after))
    assert (before, after) == (["a, Depth [m] of Alg1/H"], ["a, Depth [m] of Alg1/A"])
    assert rows


@pytest.mark.slow
def test_the_cursor_reads_why_a_pixel_is_wrong(tmp_path, data):
    window = data.cases[0].windows[0]
    method = next(m for m in window.methods if m.name == "Alg1/H")
    y, x = (int(v) for v in np.argwhere(method.mask)[7])
    causes = np.zeros(SHAPE, np.uint8)
    causes[y, x] = 3
    methods = tuple(replace(m, causes=causes) if m is method else m for m in window.methods)
    question = f"""
      const linked = document.querySelector(".linked"), x = {x}, y = {y};
      const picture = linked.querySelector(".picture"); {MOVE}
      return linked.querySelector(".readout").textContent;"""
    text = _ask(tmp_path, text_of(data, windows=(replace(window, methods=methods),)), question)
    assert re.search(r"error [-\d.]+ cm · off by more than a tenth, occlusion: at a depth", text)


@pytest.mark.slow
def test_the_slider_shows_one_window_at_a_time_and_play_goes_on(tmp_path, data):
    film = tuple(replace(w, name=f"w{k:03d}") for k, w in enumerate(data.cases[0].windows * 3))
    page = text_of(data, film=film)
    question = """
      const player = document.querySelector(".player"), range = player.querySelector("input");
      const shown = () => [...player.querySelectorAll(".still")].map((still) => !still.hidden);
      const output = player.querySelector("output"), button = player.querySelector("button");
      const before = shown();
      range.value = 1; range.dispatchEvent(new Event("input"));
      const after = [shown(), output.textContent.slice(0, 4)];
      button.click(); const playing = button.ariaLabel; button.click();
      return [before, ...after, playing, button.ariaLabel];"""
    got = _ask(tmp_path, page, question)
    first, second = [True, False, False], [False, True, False]
    assert got == [first, second, "w001", "pause", "play"]


def test_a_pixel_without_depth_says_so_until_a_method_has_one(tmp_path, page, data):
    first, second = (
        next(m for m in data.cases[0].windows[0].methods if m.name == name)
        for name in ("Alg1/H", "Alg1/max")
    )
    y, x = (int(v) for v in np.argwhere(~first.mask & second.mask)[0])
    question = f"""
      const linked = document.querySelector(".linked"), x = {x}, y = {y};
      const picture = linked.querySelector(".picture"); {MOVE}
      const before = linked.querySelector(".readout").textContent;
      [...document.querySelectorAll("label")].find((l) => l.textContent == "Alg1/max").click();
      return [before, linked.querySelector(".readout").textContent];"""
    before, after = _ask(tmp_path, page, question)
    assert before.endswith("no depth")
    found_m = float(re.search(r" · depth ([\d.]+) m", after)[1])
    assert found_m == pytest.approx(second.depth_m[y, x], rel=1e-3)


@pytest.mark.slow
def test_the_cursor_reads_a_prediction_that_says_no_confidence(tmp_path, data):
    window = data.cases[0].windows[0]
    silent = replace(window.methods[0], name="Given/x", confidence=np.full(SHAPE, np.nan))
    windows = (replace(window, methods=(*window.methods, silent)),)
    y, x = (int(v) for v in np.argwhere(silent.mask)[3])
    question = f"""
      const linked = document.querySelector(".linked"), x = {x}, y = {y};
      document.querySelector("label[for=case0-m{len(METHODS)}]").click();
      const picture = linked.querySelector(".picture"); {MOVE}
      linked.cloud.box.querySelector("[name=truth]").click();
      return [linked.querySelector(".readout").textContent,
        +linked.querySelector("canvas").dataset.drawn];"""
    text, drawn = _ask(tmp_path, text_of(data, windows=windows), question)
    assert f"depth {silent.depth_m[y, x]:.2f}"[:-1] in text
    assert text.endswith("says no confidence")
    assert drawn == silent.mask.sum()


def _shot(tmp_path, page, size, *flags):
    """The grey values of a page, in dark where the flags say so."""
    shot = tmp_path / "shot.png"
    _browse(tmp_path, page, f"--screenshot={shot}", f"--window-size={size}", *flags)
    return np.asarray(Image.open(shot).convert("L"))


DARK = "--blink-settings=preferredColorScheme=0"


@pytest.mark.slow
def test_a_studys_figure_is_as_dark_as_the_page(tmp_path):
    study = STUDIES["event-share"]
    ones = np.ones((4, len(study.amounts)))
    curves = [RobustnessCurve("Alg1/H", one, "m", study.amounts, *ones) for one in METRICS]
    draw(study, curves, tmp_path / "event-share.svg", "planes; 1 seed")
    uri = _figure(tmp_path / "event-share.svg")
    style = ":root { color-scheme: light dark } body { margin: 0 }"
    page = f'<html><head><style>{style}</style></head><img src="{uri}" style="width:100%"></html>'
    light, dark = (_shot(tmp_path, page, "900,300", *flags) for flags in ((), (DARK,)))
    assert min(light.std(), dark.std()) > 5
    assert light.mean() > 200
    assert dark.mean() < 80


@pytest.mark.slow
def test_print_holds_no_configuration(tmp_path, data):
    """A folded part takes no room on paper: as many lines of settings change nothing."""
    sizes = []
    for lines in (1, 400):
        page = text_of(replace(data, configuration="planes = 12\n" * lines))
        _browse(tmp_path, page, f"--print-to-pdf={tmp_path / 'page.pdf'}")
        sizes.append(len(re.findall(rb"/Type /Page\b", (tmp_path / "page.pdf").read_bytes())))
    assert sizes[0] == sizes[1] > 0


def test_the_cloud_draws_every_point_and_turns(tmp_path, page, data):
    question = """
      const canvas = document.querySelector(".cloud canvas");
      const cloud = canvas.closest(".linked").cloud, context = canvas.getContext("2d");
      const look = () => context.getImageData(0, 0, canvas.width, canvas.height).data;
      const filled = (data) => data.filter((value, k) => k % 4 === 3 && value > 0).length;
      cloud.draw();
      const before = look(), drawn = +canvas.dataset.drawn;
      canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
      const after = look(), moved = before.some((value, k) => value !== after[k]);
      cloud.box.querySelector("[name=truth]").click();
      return { drawn, moved, filled: filled(before), alone: +canvas.dataset.drawn };"""
    got = _ask(tmp_path, page, question)
    points = next(m for m in data.cases[0].windows[0].methods if m.name == "Alg1/H").mask.sum()
    assert (got["drawn"], got["alone"]) == (SHAPE[0] * SHAPE[1] + points, points)
    assert got["moved"]
    assert got["filled"] > 300


def test_a_click_sorts_or_enlarges_and_the_cursor_goes_on(tmp_path, page):
    question = """
      const table = document.querySelector("#ranking table"), head = table.tHead.rows[0].cells[2];
      const column = () => [...table.tBodies[0].rows].map((row) => +row.cells[2].dataset.value);
      head.click(); const first = column(); head.click(); return [first, column()];"""
    first, second = _ask(tmp_path, page, question)
    assert (first, second) == (sorted(first, reverse=True), sorted(first))
    assert len(set(first)) > 1
    question = f"""
      document.querySelector(".linked .picture").click();
      const dialog = document.querySelector("dialog"), picture = dialog.querySelector(".picture");
      const x = 3, y = 4; {MOVE}
      return [dialog.open, dialog.querySelector(".readout").textContent];"""
    opened, text = _ask(tmp_path, page, question)
    assert opened
    assert text.startswith("x 3, y 4 px")


def test_hostile_names_run_nothing(tmp_path, data):
    hostile = "</script><script>window.hit=1</script>"
    window = data.cases[0].windows[0]
    methods = tuple(replace(m, name=m.name + hostile) for m in window.methods)
    windows = (replace(window, name=hostile, methods=methods),)
    rows = data.results.rows
    rows = rows.assign(case=hostile, method=rows["method"] + hostile)
    page = text_of(
        replace(data, results=replace(data.results, rows=rows)), name=hostile, windows=windows
    )
    assert _ask(tmp_path, page, "return window.hit ?? 0;") == 0


@pytest.mark.parametrize("flags", [(), (DARK,)])
def test_a_phone_sees_a_page_in_light_and_dark(tmp_path, page, flags):
    """The narrowest window that a headless browser opens is wider than a phone, a frame is not."""
    inner = tmp_path / "inner.html"
    inner.write_text(page, encoding="utf-8")
    style = "border:0;width:390px;height:800px"
    frame = f'<body style="margin:0"><iframe src="{inner.as_uri()}" style="{style}"></iframe>'
    pixels = _shot(tmp_path, frame, "500,800", *flags)[:, :390]
    assert pixels.std() > 10
    assert (pixels.mean() < 100) == bool(flags)


def test_on_a_phone_only_tables_and_plots_scroll_sideways(tmp_path, page):
    """A frame of the page's own text is as narrow as a phone, and can be asked how wide it is."""
    holder = f"""<html><head></head><body>
      <iframe srcdoc="{html.escape(page)}" style="width:390px;height:800px;border:0"></iframe>
      <script>onload = () => document.documentElement.classList.add("ready")</script>
      </body></html>"""
    question = """
      const inner = document.querySelector("iframe").contentDocument.documentElement;
      return [inner.clientWidth, inner.scrollWidth];"""
    wide, scrolled = _ask(tmp_path, holder, question)
    assert 300 < scrolled <= wide <= 390
