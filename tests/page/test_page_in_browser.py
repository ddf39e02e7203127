"""The page of results in a real browser: its charts, and how film and curves move together."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from page_documents import write_documents, write_film

from grosmc_mj.films.offscreen import find_ffmpeg
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import write_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
VIDEO = "-v error -f lavfi -i testsrc=s=64x48:r=20:d=3 -pix_fmt yuv420p -movflags +faststart"
CURSOR = "() => document.querySelector('.case .plot').layout.shapes.at(-1).x0"
DRAWN = (
    "() => [...document.querySelectorAll('.plot')]"
    ".map((home) => home.querySelectorAll('.main-svg').length > 0)"
)
OPENING = "all => document.querySelectorAll('details').forEach(fold => { fold.open = all; })"
pytestmark = [
    pytest.mark.render,
    pytest.mark.apart,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Any]]:
    """Opens the page in a browser without a net; it complains of nothing and asks for nothing."""
    from playwright.sync_api import sync_playwright

    folder = write_documents(tmp_path_factory.mktemp("results"))
    film, path = folder / "made.mp4", folder / "report.html"
    subprocess.run([find_ffmpeg().path, *VIDEO.split(), film], check=True)
    write_film(folder, film.read_bytes())
    write_page(read_results([folder]), [folder], path)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])

        @contextmanager
        def opened(width: int = 1280, **options: Any) -> Iterator[Any]:
            complaints: list[str] = []
            size = {"width": width, "height": 800}
            context = browser.new_context(viewport=size, offline=True, **options)  # pyright: ignore
            page = context.new_page()
            page.on("console", lambda message: complaints.append(message.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("request", lambda request: complaints.append(request.url))
            page.goto(path.as_uri())
            page.wait_for_selector("html[data-ready]", state="attached")
            yield page
            assert [line for line in complaints if not line.startswith(("file:", "data:"))] == []
            context.close()

        yield opened
        browser.close()


def until(page: Any, holds: Callable[[], bool]) -> None:
    """Wait up to 10 s; the page's policy forbids to evaluate a text inside it."""
    for _ in range(200):
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("still not so after 10 s")


def test_charts_are_drawn_and_film_and_curves_have_one_time(shown: Callable[..., Any]) -> None:
    with shown() as page:
        assert page.evaluate(DRAWN) == [True] * 4
        video = page.locator("video")
        until(page, lambda: video.evaluate("video => video.readyState > 1"))
        video.evaluate("video => { video.currentTime = 2; }")
        until(page, lambda: page.evaluate(CURSOR) == pytest.approx(1.25))
        click = "home => home.emit('plotly_click', { points: [{ x: 1.5 }] })"
        page.locator(".case .plot").evaluate(click)
        until(page, lambda: page.evaluate(CURSOR) == pytest.approx(1.5))
        assert video.evaluate("video => video.currentTime") == pytest.approx(2.5)


def test_claims_are_filtered_and_a_narrow_screen_scrolls_in_one_direction(
    shown: Callable[..., Any],
) -> None:
    with shown(width=400) as page:
        for verdict, visible in (("refuted", True), ("", False)):
            page.select_option("#verdict", verdict)
            assert page.locator(".claim").is_visible() is visible
        for unfold in (True, False):
            page.evaluate(OPENING, unfold)
            assert page.evaluate("() => document.documentElement.scrollWidth") <= 400
        # On paper there is nothing to open.
        page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
        assert page.locator("main details:not([open])").count() == 0


def test_nobody_is_kept_out(shown: Callable[..., Any]) -> None:
    from axe_playwright_python.sync_playwright import Axe

    for scheme in ("light", "dark"):
        with shown(color_scheme=scheme) as page:
            ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
            assert (ground == "rgb(255, 255, 255)") is (scheme == "light")
            violations = Axe().run(page).response["violations"]
            assert [v["id"] for v in violations if v["impact"] in ("serious", "critical")] == []
