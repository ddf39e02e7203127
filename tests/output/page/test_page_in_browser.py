"""The page of results in a real browser: its charts, and how film and curves move together."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from page_documents import write_documents, write_film

from grosmc_mj.output.films.offscreen import find_ffmpeg
from grosmc_mj.output.page.reading import read_results
from grosmc_mj.output.page.write import write_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
VIDEO = "-v error -f lavfi -i testsrc=s=64x48:r=20:d=3 -pix_fmt yuv420p -movflags +faststart"

# Scripts that the browser evaluates.
CURSOR = "() => document.querySelector('.case .plot').layout.shapes.at(-1).x0"
DRAWN = (
    "() => [...document.querySelectorAll('.plot')]"
    ".map((home) => home.querySelectorAll('.main-svg').length > 0)"
)
UNFOLD = "all => document.querySelectorAll('details').forEach(fold => { fold.open = all; })"
CLICK = "home => home.emit('plotly_click', { points: [{ x: 1.5 }] })"
WIDTH = "() => document.documentElement.scrollWidth"
PRINT = "() => dispatchEvent(new Event('beforeprint'))"
GROUND = "getComputedStyle(document.body).backgroundColor"

pytestmark = [
    pytest.mark.render,
    pytest.mark.apart,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]


@dataclass(frozen=True)
class Browser:
    """Browser without a net, and the page of all documents.

    Attributes:
        chromium: Playwright's browser.
        path: Path of the page.
    """

    chromium: Any
    path: Path

    @contextmanager
    def page(self, width: int = 1280, **options: Any) -> Iterator[Any]:
        """Open the page; check that it complains of nothing and asks for nothing."""
        size = {"width": width, "height": 800}
        context = self.chromium.new_context(viewport=size, offline=True, **options)
        page = context.new_page()
        events: list[str] = []
        page.on("console", lambda message: events.append(message.text))
        page.on("pageerror", lambda error: events.append(str(error)))
        page.on("request", lambda request: events.append(request.url))
        page.goto(self.path.as_uri())
        page.wait_for_selector("html[data-ready]", state="attached")
        yield page
        assert [event for event in events if not event.startswith(("file:", "data:"))] == []
        context.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    folder = write_documents(tmp_path_factory.mktemp("results"))
    film = folder / "made.mp4"
    subprocess.run([find_ffmpeg().path, *VIDEO.split(), film], check=True)
    write_film(folder, film.read_bytes())
    path = folder / "report.html"
    write_page(read_results([folder]), [folder], path)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield Browser(chromium, path)
        chromium.close()


def until(page: Any, holds: Callable[[], bool]) -> None:
    """Wait up to 10 s; Playwright's own waiting evaluates a text, which the policy forbids."""
    for _ in range(200):
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("still not so after 10 s")


def test_charts_are_drawn(browser: Browser) -> None:
    with browser.page() as page:
        assert page.evaluate(DRAWN) == [True] * 5


def test_the_film_has_the_time_of_the_curves(browser: Browser) -> None:
    with browser.page() as page:
        video = page.locator("video")
        until(page, lambda: video.evaluate("video => video.readyState > 1"))
        video.evaluate("video => { video.currentTime = 2; }")
        until(page, lambda: page.evaluate(CURSOR) == pytest.approx(1.25))

        page.locator(".case .plot").evaluate(CLICK)
        until(page, lambda: page.evaluate(CURSOR) == pytest.approx(1.5))
        assert video.evaluate("video => video.currentTime") == pytest.approx(2.5)


def test_the_controls_of_a_film_are_below_it(browser: Browser) -> None:
    with browser.page(width=400) as page:
        film = page.locator("video").bounding_box()
        controls = page.locator(".film figcaption").bounding_box()
        assert controls["y"] >= film["y"] + film["height"]
        assert film["width"] == page.locator("main").bounding_box()["width"]


def test_a_slider_moves_the_film(browser: Browser) -> None:
    with browser.page() as page:
        video = page.locator("video")
        until(page, lambda: video.evaluate("video => video.readyState > 0"))
        page.locator(".film input").fill("0.5")
        until(page, lambda: page.evaluate(CURSOR) == pytest.approx(1.0))


@pytest.mark.parametrize("unfolded", [True, False])
def test_a_narrow_screen_scrolls_in_one_direction(browser: Browser, unfolded: bool) -> None:
    with browser.page(width=400) as page:
        page.evaluate(UNFOLD, unfolded)
        assert page.evaluate(WIDTH) <= 400


def test_everything_is_open_on_paper(browser: Browser) -> None:
    with browser.page(width=400) as page:
        page.evaluate(UNFOLD, False)
        page.evaluate(PRINT)
        assert page.locator("main details:not([open])").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nobody_is_kept_out(browser: Browser, scheme: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    with browser.page(color_scheme=scheme) as page:
        is_white = page.evaluate(GROUND) == "rgb(255, 255, 255)"
        assert is_white is (scheme == "light")
        violations = Axe().run(page).response["violations"]
        grave = [v["id"] for v in violations if v["impact"] in ("serious", "critical")]
        assert grave == []
