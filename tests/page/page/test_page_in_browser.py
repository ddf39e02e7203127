"""The page of results in a real browser: what it draws, how its parts move, who can use it."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from page_documents import DOCUMENTS, TIMES, write_documents, write_film

from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import find_ffmpeg
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import write_page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 360, "height": 740}

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    write_documents(folder)
    try:
        film = folder / "made.mp4"
        command = [
            find_ffmpeg().path, "-v", "error", "-f", "lavfi", "-i", "testsrc=s=64x48:r=20:d=3",
            "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(film),
        ]  # fmt: skip
        subprocess.run(command, check=True)
    except SetupError as error:
        pytest.skip(str(error))
    write_film(folder, film.read_bytes())
    path = folder / "report.html"
    write_page(read_results([folder]), [folder], path, lambda file, most: None)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


class Seen:
    """A page in a browser without a net, with what it complains of and asks for."""

    def __init__(self, browser: Any, file: Path, **context: Any) -> None:
        self.context = browser.new_context(**{"viewport": WIDE, "offline": True, **context})
        self.page, self.said, self.asked = self.context.new_page(), [], []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(file.as_uri())
        self.page.wait_for_selector("html[data-ready]", state="attached")
        if self.page.locator("#curves").count():
            self.page.wait_for_selector("#curves-plot .scatterlayer")

    def traces(self, what: str, meta: str | None = None) -> list[dict[str, Any]]:
        """The data that a figure is drawn from."""
        found = self.page.evaluate(
            "s => document.querySelector(s).data.map("
            "d => ({name: d.name, meta: d.meta, type: d.type, x: d.x, y: d.y}))",
            what,
        )
        return [each for each in found if meta is None or each["meta"] == meta]

    def until(self, told: str) -> None:
        """Wait until an expression is true; the browser's own waiting would need its eval."""
        for _ in range(100):
            if self.page.evaluate(told):
                return
            self.page.wait_for_timeout(50)
        pytest.fail(f"never: {told}")

    def cursor(self) -> float:
        """Where the curves' cursor is [s]."""
        self.page.wait_for_timeout(200)
        return self.page.evaluate("document.querySelector('#curves-plot').layout.shapes.at(-1).x0")

    def film(self) -> float:
        """Where the film is [s]."""
        return self.page.evaluate("document.querySelector('video').currentTime")


@pytest.fixture
def seen(browser: Any, page_file: Path) -> Iterator[Seen]:
    opened = Seen(browser, page_file)
    yield opened
    opened.context.close()
    assert opened.said == []
    leaving = [url for url in opened.asked if not url.startswith(("file:", "blob:", "data:"))]
    assert leaving == []


def test_curves_have_the_values_of_the_results(seen: Seen) -> None:
    panels = DOCUMENTS["curves"]["panels"]
    drawn = seen.traces("#curves-plot", "curve")
    assert [each["y"] for each in drawn] == [x["y"] for panel in panels for x in panel["curves"]]
    assert all(each["x"] == TIMES for each in drawn)
    (limit,) = seen.traces("#curves-plot", "limit")
    assert (limit["x"], limit["y"]) == ([1.0, 2.0], [0.9, 0.9])
    shaded = seen.page.evaluate("document.querySelector('#curves-plot').layout.shapes")
    assert any((each.get("x0"), each.get("x1")) == (0.5, 1.0) for each in shaded)


def test_laws_and_plants_are_taken_off_and_put_back_by_keyboard(seen: Seen) -> None:
    before = seen.traces("#curves-plot", "curve")
    for box, left in (("#laws input[value=lqr]", 1), ("#plants input[value=corrected]", 3)):
        seen.page.focus(box)
        seen.page.keyboard.press("Space")
        assert len(seen.traces("#curves-plot", "curve")) == left
        seen.page.keyboard.press("Space")
        assert seen.traces("#curves-plot", "curve") == before


def test_all_panels_share_one_zoom(seen: Seen) -> None:
    axes = seen.page.evaluate(
        "document.querySelector('#curves-plot').data.map(d => [d.xaxis, d.yaxis])"
    )
    assert {x for x, _ in axes} == {"x"}
    assert {y for _, y in axes} == {"y", "y2"}


def test_film_and_curves_have_one_clock(seen: Seen) -> None:
    # The film begins at 0.25 s of the run and shows half a second of it in a second.
    page = seen.page
    seen.until("document.querySelector('video').readyState >= 1")
    page.evaluate("document.querySelector('video').currentTime = 2")
    page.wait_for_timeout(600)
    assert seen.cursor() == pytest.approx(1.25, abs=0.03)
    assert float(page.input_value("#clock")) == pytest.approx(1.25, abs=0.03)
    page.focus("#clock")
    page.keyboard.press("Home")
    for key in ("PageUp",) * 2 + ("ArrowRight",) * 50:
        page.keyboard.press(key)
    assert seen.cursor() == pytest.approx(0.5)
    assert seen.film() == pytest.approx(0.5, abs=0.03)
    page.evaluate("document.querySelector('video').play()")
    seen.until("document.querySelector('video').currentTime > 1")
    page.evaluate("document.querySelector('video').pause()")
    page.wait_for_timeout(300)
    assert seen.cursor() == pytest.approx(0.25 + 0.5 * seen.film(), abs=0.05)


def test_a_click_on_a_curve_sets_the_film(seen: Seen) -> None:
    page = seen.page
    seen.until("document.querySelector('video').readyState >= 1")
    plot = page.locator("#curves-plot .nsewdrag").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    # At 1 s of 2 s there is a point of a curve at half the height of the axis.
    x = box["x"] + box["width"] / 2
    for share in range(5, 96, 5):
        page.mouse.move(x, box["y"] + box["height"] * share / 100)
        page.wait_for_timeout(60)
        page.mouse.click(x, box["y"] + box["height"] * share / 100)
        if seen.cursor() > 0.3:
            break
    assert seen.cursor() == 1.0
    assert seen.film() == pytest.approx(1.5, abs=0.03)


def test_values_at_the_cursor_are_those_between_two_points(seen: Seen) -> None:
    page = seen.page
    page.click("#values summary")
    page.fill("#clock", "1.5")
    rows = page.locator("#values tbody tr").all_inner_texts()
    assert [row.split("\t")[-1] for row in rows][:2] == ["0.75", "0.9375"]


def test_claims_are_filtered_and_open_to_equation_values_and_figure(seen: Seen) -> None:
    page = seen.page
    assert page.locator(".claim:visible").count() == 2
    page.select_option("[data-filter=verdict]", "refuted")
    assert page.locator(".claim:visible").count() == 1
    assert page.inner_text("#shown") == "1 of 2"
    page.select_option("[data-filter=system]", "arm")
    assert page.locator(".claim:visible").count() == 0
    page.select_option("[data-filter=system]", "servo")
    page.focus(".claim:visible summary")
    page.keyboard.press("Enter")
    page.wait_for_selector(".claim[open] .scatterlayer")
    assert page.locator(".claim[open] math mfrac").count() == 2
    assert "at most 2 %" in page.inner_text(".claim[open] table")
    assert [each["x"] for each in seen.traces(".claim[open] .plot")] == [
        [12.5, 12.4, 12.5, 12.4, 11.0, 11.0]
    ]


def test_a_run_of_a_campaign_tells_its_row_and_its_command(seen: Seen) -> None:
    page = seen.page
    page.locator("#campaigns").scroll_into_view_if_needed()
    page.wait_for_selector(".runs .scatterlayer .point")
    assert page.locator(".chosen button").all_inner_texts() == ["0", "1", "2", "3"]
    page.focus(".chosen button")
    page.keyboard.press("Enter")
    told = page.inner_text(".replay")
    assert "mass = 1 kg" in told
    assert re.search(r"grosmc-mj campaign \S+camp --replay 0 --controller lqr$", told)


def test_brushing_chooses_runs(seen: Seen) -> None:
    page = seen.page
    page.locator("#campaigns .runs").scroll_into_view_if_needed()
    page.wait_for_selector(".runs .scatterlayer .point")
    page.wait_for_timeout(300)
    box = page.locator(".runs .nsewdrag").first.bounding_box()
    # The left half has the runs of the smaller masses.
    page.mouse.move(box["x"] + 2, box["y"] + 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] - 2, steps=8)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert page.inner_text(".chosen caption") == "The worst of 2 chosen runs"
    assert page.locator(".chosen button").all_inner_texts() == ["0", "1"]


def test_runs_are_chosen_by_keyboard_and_put_back(seen: Seen) -> None:
    page = seen.page
    page.locator("#campaigns .runs").scroll_into_view_if_needed()
    page.wait_for_selector(".runs .scatterlayer .point")
    page.get_by_label("across from").focus()
    page.keyboard.type("1.3")
    page.keyboard.press("Tab")
    page.keyboard.type("1.9")
    assert page.inner_text(".chosen caption") == "The worst of 2 chosen runs"
    assert page.locator(".chosen button").all_inner_texts() == ["1", "2"]
    marked = page.evaluate("document.querySelector('.runs').data.map(d => d.selectedpoints)")
    assert marked == [[0, 1], []]
    page.focus(".chosen button")
    page.keyboard.press("Enter")
    assert "--replay 1 " in page.inner_text(".replay")
    page.focus(".brush button")
    page.keyboard.press("Enter")
    assert page.locator(".chosen button").all_inner_texts() == ["0", "1", "2", "3"]
    assert page.get_by_label("across from").input_value() == ""


def sheet(seen: Seen, title: str) -> Any:
    """The article of a study, once it is drawn."""
    found = seen.page.locator(f".sheet:has-text('{title}')").first
    found.scroll_into_view_if_needed()
    found.locator(".js-plotly-plot .main-svg").first.wait_for(state="attached")
    return found


def test_maps_say_what_each_law_stands(seen: Seen) -> None:
    for title, texts in (
        ("each rung on top of the others", [["2", "0.5", "3", "0.25"]]),
        ("how much of it each law stands", [["1.5 ms"]]),
        ("Premises of the theorems", [["✗ -0.5"]]),
    ):
        plot = sheet(seen, title).locator(".plot")
        assert plot.evaluate("each => each.data[0].text") == texts


def test_a_study_with_several_charts_has_them_by_keyboard(seen: Seen) -> None:
    region = sheet(seen, "Region of servo")
    letters = "each => each.data[0].text"
    assert region.locator(".plot").evaluate(letters)[1] == ["converged"] * 2
    region.locator("select").focus()
    seen.page.keyboard.press("ArrowDown")
    seen.page.wait_for_timeout(200)
    assert region.locator(".plot").evaluate(letters)[1] == ["converged", "left the region"]


def test_a_sweep_shows_where_its_answer_turns(seen: Seen) -> None:
    plot = sheet(seen, "Claims over what the chapter leaves open").locator(".plot")
    assert plot.evaluate("each => [each.data[0].x, each.data[0].y]") == [[50, 100], [2, 1]]
    assert plot.evaluate("each => each.data[0].marker.symbol") == ["x", "circle"]
    assert plot.evaluate("each => each.layout.shapes.map(s => s.x0)") == [62.5]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nobody_is_kept_out(browser: Any, page_file: Path, scheme: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    opened = Seen(browser, page_file, color_scheme=scheme)
    opened.page.locator(".claim summary").first.click()
    opened.page.locator("#studies").scroll_into_view_if_needed()
    opened.page.wait_for_timeout(500)
    ground = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") is (scheme == "light")
    found = Axe().run(opened.page).response["violations"]
    assert [each["id"] for each in found if each["impact"] in ("serious", "critical")] == []
    assert opened.said == []
    opened.context.close()


def test_a_narrow_screen_scrolls_in_one_direction(browser: Any, page_file: Path) -> None:
    opened = Seen(browser, page_file, viewport=NARROW)
    for section in ("claims", "campaigns", "studies", "origin"):
        opened.page.locator(f"#{section}").scroll_into_view_if_needed()
        opened.page.wait_for_timeout(200)
    width = opened.page.evaluate("document.documentElement.scrollWidth")
    assert width <= NARROW["width"]
    opened.context.close()


def test_an_injected_script_never_runs(browser: Any, tmp_path: Path, page_file: Path) -> None:
    text = page_file.read_text(encoding="utf-8")
    hostile = "<script>window.stolen = 1</script><img src=x onerror='window.stolen = 1'>"
    file = tmp_path / "injected.html"
    file.write_text(text.replace("<main>", f"<main>{hostile}", 1), encoding="utf-8")
    opened = Seen(browser, file)
    assert opened.page.evaluate("window.stolen") is None
    assert any("Content Security Policy" in each for each in opened.said)
    opened.context.close()


def test_names_of_somebody_else_are_drawn_as_text(browser: Any, tmp_path: Path) -> None:
    from test_page_of_results import HOSTILE, write_hostile

    write_hostile(tmp_path)
    file = tmp_path / "report.html"
    write_page(read_results([tmp_path]), [tmp_path], file, lambda film, most: None)
    opened = Seen(browser, file)
    for section in ("claims", "campaigns", "studies"):
        opened.page.locator(f"#{section}").scroll_into_view_if_needed()
        opened.page.wait_for_timeout(200)
    for study in opened.page.locator(".sheet").all():
        study.scroll_into_view_if_needed()
        opened.page.wait_for_timeout(100)
    assert opened.page.locator(".sheet .main-svg").count() > 10
    assert opened.page.evaluate("window.stolen") is None
    assert opened.page.locator("img").count() == 0
    assert HOSTILE in opened.page.inner_text("#answer")
    assert opened.said == []
    opened.context.close()


def test_on_paper_there_is_nothing_to_open(seen: Seen) -> None:
    pdf = seen.page.pdf()
    assert pdf.startswith(b"%PDF")
    # Nothing takes more than a page.
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) <= len(DOCUMENTS)
    assert seen.page.evaluate("document.querySelectorAll('.claim[open]').length") == 0
