"""The page in a real browser, without a network."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest
from report_kit import HOSTILE, visit


def test_it_opens_offline_without_a_word(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        seen.page.wait_for_load_state("load")
        assert seen.page.locator(".verdict").is_visible()
        assert seen.said == []
        assert seen.asked == []
        missing = "[...document.images].filter((i) => i.src && i.naturalWidth === 0).length"
        assert seen.page.evaluate(missing) == 0


def test_a_page_that_asks_for_something_is_noticed(chromium: Any, tmp_path: Path) -> None:
    path = tmp_path / "bad.html"
    path.write_text('<img src="http://example.org/x.png"><script>nothing()</script>')
    with visit(chromium, path) as seen:
        seen.page.wait_for_load_state("load")
        assert seen.asked == ["http://example.org/x.png"]
        assert any("nothing is not defined" in line for line in seen.said)


def test_what_data_says_is_shown_and_not_run(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        assert seen.page.evaluate("document.querySelectorAll('img[onerror], [onload]').length") == 0
        assert seen.page.locator("h1").inner_text() == f"Made up {HOSTILE}"
        names = seen.page.locator(".board tbody th").all_inner_texts()
        assert any(HOSTILE in name.replace("\u200b", "") for name in names)
        drawn = seen.page.locator(".plot svg text").all_text_contents()
        assert any(HOSTILE in text for text in drawn)


def test_a_heading_sorts_both_ways(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        table = seen.page.locator("table.sortable").first
        heading = table.locator("th", has_text="FLIP").first

        def values() -> list[str]:
            column = heading.evaluate("(h) => h.cellIndex")
            return list(table.evaluate("(t, c) => [...t.tBodies[0].rows].map((r) => r.cells[c].dataset.sort)", column))

        heading.locator("button").click()
        assert heading.get_attribute("aria-sort") == "ascending"
        rising = values()
        assert len(rising) == 3
        assert [float(value) for value in rising] == sorted(float(value) for value in rising)
        heading.locator("button").press("Enter")
        assert heading.get_attribute("aria-sort") == "descending"
        assert values() == rising[::-1]
        assert table.locator("th[aria-sort]").count() == 1


def test_who_has_no_rank_is_last_either_way(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        table = seen.page.locator("table.sortable").first
        rank = table.locator("thead th").first
        for _ in range(2):
            rank.locator("button").click()
            assert HOSTILE in table.locator("tbody tr").last.locator("th").inner_text()


def test_the_slider_moves_the_edge_by_key_and_by_pointer(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        viewer = seen.page.locator(".viewer").first
        slider, over = viewer.locator(".slider"), viewer.locator(".over")
        assert over.evaluate("(i) => i.style.clipPath") == "inset(0px 0px 0px 50%)"
        slider.focus()
        for _ in range(3):
            slider.press("ArrowRight")
        assert over.evaluate("(i) => i.style.clipPath") == "inset(0px 0px 0px 53%)"
        slider.scroll_into_view_if_needed()
        box = slider.bounding_box()
        seen.page.mouse.click(box["x"] + box["width"] * 0.25, box["y"] + box["height"] / 2)
        assert 20 <= float(slider.input_value()) <= 30
        assert over.evaluate("(i) => i.style.clipPath") == f"inset(0px 0px 0px {slider.input_value()}%)"
        assert viewer.locator(".handle").evaluate("(h) => h.style.left") == f"{slider.input_value()}%"


def test_anybody_can_be_put_beside_the_reference(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        viewer = seen.page.locator(".viewer").first
        name = "raster_only · 50ms"
        viewer.locator(".right").select_option(name)
        frame = viewer.locator(".frame").input_value()
        shown = viewer.locator(f'.shots[data-frame="{frame}"] figure[data-name="{name}"]')
        assert viewer.locator(".over").get_attribute("src") == shown.locator(".picture").get_attribute("src")
        viewer.locator(".errors").check()
        assert viewer.locator(".over").get_attribute("src") == shown.locator(".map").get_attribute("src")
        assert viewer.locator(".of-right").inner_text() == f"{name}, FLIP map"
        viewer.locator(f'.shots[data-frame="{frame}"] button').nth(2).click()
        assert viewer.locator(".right").input_value() == viewer.locator(".right option").nth(2).get_attribute("value")


def test_every_frame_that_is_chosen_shows_its_own_pictures(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        viewer = seen.page.locator(".viewer").first
        frames = viewer.locator(".frame option").all_text_contents()
        assert len(frames) == 4
        for frame in frames:
            viewer.locator(".frame").select_option(frame)
            assert viewer.locator(".shots:not([hidden])").evaluate_all("(g) => g.map((e) => e.dataset.frame)") == [
                frame
            ]
            assert f"frame {frame}," in viewer.locator(".under").get_attribute("alt")


def test_every_figure_can_be_taken_away(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        figures = seen.page.locator("figure.plot")
        assert figures.count() >= 7
        for figure in figures.all():
            key = figure.get_attribute("id")
            svg, table = figure.locator("a.svg"), figure.locator("a.csv")
            assert svg.get_attribute("download") == f"{key}.svg"
            text = unquote(svg.get_attribute("href").partition(",")[2])
            root = ElementTree.fromstring(text)
            assert root.tag == "{http://www.w3.org/2000/svg}svg"
            assert root.get("width", "").endswith("pt")
            data = base64.b64decode(table.get_attribute("href").partition("base64,")[2]).decode()
            assert data.startswith("label,")
            assert len(data.splitlines()) > 1


def test_a_download_really_is_one(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen, seen.page.expect_download() as waiting:
        seen.page.locator("figure.plot a.csv").first.click()
    assert waiting.value.suggested_filename.endswith(".csv")


@pytest.mark.parametrize("width", [360, 768, 1280])
def test_nothing_is_wider_than_the_window(chromium: Any, page_path: Path, width: int) -> None:
    with visit(chromium, page_path, width) as seen:
        assert seen.page.evaluate("document.documentElement.scrollWidth") == width
        outside = "(w) => [...document.querySelectorAll('main > section, .board, .plot, .viewer, .card, header > *')]"
        outside += ".filter((e) => e.getBoundingClientRect().right > w + 0.5).map((e) => e.className || e.id)"
        assert seen.page.evaluate(outside, width) == []


def test_paper_has_no_controls_but_all_pictures(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        hidden = (".stage", ".slider", ".controls", "nav", ".downloads")
        maps = seen.page.locator(".shots .map")
        assert not maps.first.is_visible()
        seen.page.emulate_media(media="print")
        assert [each for each in hidden if seen.page.locator(each).first.is_visible()] == []
        assert all(picture.is_visible() for picture in seen.page.locator(".shots .picture").all())
        assert all(picture.is_visible() for picture in maps.all())
        seen.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        assert seen.page.locator("details:not([open])").count() == 0


def test_without_script_everything_can_be_read(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path, java_script_enabled=False) as seen:
        assert not seen.page.locator(".stage").first.is_visible()
        assert all(picture.is_visible() for picture in seen.page.locator(".shots .map").all())
        assert seen.said == []


def test_tables_fit_on_paper(chromium: Any, page_path: Path) -> None:
    a4_less_margins = 718
    with visit(chromium, page_path, a4_less_margins) as seen:
        seen.page.emulate_media(media="print")
        assert seen.page.evaluate("document.documentElement.scrollWidth") == a4_less_margins


def test_ids_are_unique_and_everything_has_a_name(chromium: Any, page_path: Path) -> None:
    with visit(chromium, page_path) as seen:
        ids = seen.page.evaluate("[...document.querySelectorAll('[id]')].map((e) => e.id)")
        assert len(ids) > 100
        assert len(ids) == len(set(ids))
        for query in ("img:not([alt])", "[role=img]:not([aria-label])", "input:not([aria-label]):not(label input)"):
            assert seen.page.locator(query).count() == 0
        broken = "[...document.querySelectorAll('nav a')].filter((a) => !document.querySelector(a.hash)).length"
        assert seen.page.evaluate(broken) == 0


def test_a_dark_page_changes_the_ink_of_figures(chromium: Any, page_path: Path) -> None:
    fill = "getComputedStyle(document.querySelector('.plot svg text')).fill"
    with visit(chromium, page_path, color_scheme="light") as seen:
        light = seen.page.evaluate(fill)
    with visit(chromium, page_path, color_scheme="dark") as seen:
        assert seen.page.evaluate(fill) != light
