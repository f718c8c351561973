"""The page of a campaign in a real browser and on paper: what fits, what clicks and keys do."""

import csv
import re
import shutil
from contextlib import contextmanager

import h5py
import pytest
from browser import browser, console, need_browser, on_paper, printed
from once import made_once, shared_folder
from processes import wait_for

from agglom_mpi.report.page import write_report
from agglom_mpi.report.sections.section import SCROLLED
from agglom_mpi.storage.reader import read_campaign

pytestmark = pytest.mark.slow

HUGE, WIDE, NARROW = 2560, 1280, 400
OVERLAPS = """
const shown = [...document.querySelectorAll(
    "h1, h2, h3, .state, nav a, .note, .warning, dt, dd, figure svg, figcaption, caption, th, " +
    "td, .csv, pre, summary, section > ul > li")].filter((one) => one.checkVisibility());
const boxes = shown.map((one) => one.getBoundingClientRect());
const found = [];
for (let i = 0; i < boxes.length; ++i) for (let j = i + 1; j < boxes.length; ++j) {
    const [a, b] = [boxes[i], boxes[j]];
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 1 && down > 1) found.push([shown[i].outerHTML, shown[j].outerHTML].map(
        (text) => text.slice(0, 80)));
}
return found;
"""
OF_SCROLLED = '&& getComputedStyle(one).overflowX !== "auto"'
CUT = f"""
return [...document.querySelectorAll("body *")].filter((one) => one.checkVisibility()
    && !one.closest("svg") && getComputedStyle(one).display !== "inline"
    && !one.parentElement.closest(".drawing")
    && ((one.scrollWidth > one.clientWidth + 1 {OF_SCROLLED})
        || one.getBoundingClientRect().right > document.documentElement.clientWidth + 1))
    .map((one) => one.outerHTML.slice(0, 80));
"""
HIDDEN = """
return [...document.querySelectorAll(
    "h2, h3, p, li, dt, dd, td, th, caption, figcaption, figure svg, summary, pre")].filter(
    (one) => one.textContent.trim() && !one.matches(".broad th, .wider, .narrow")
    && !one.checkVisibility()).map((one) => one.outerHTML.slice(0, 80));
"""
TAB_STOPS = """
return [...document.querySelectorAll("*")].filter((one) => one.tabIndex >= 0)
    .map((one) => [one.getAttribute("aria-label") ?? one.textContent.trim(),
        one.parentElement?.closest("svg") !== null]);
"""
LUMINANCE = """
const [red, green, blue] = getComputedStyle(arguments[0])[arguments[1]].match(/[\\d.]+/g);
return (0.2126 * red + 0.7152 * green + 0.0722 * blue) / 255;
"""


@pytest.fixture(scope="module")
def page(shared_campaign, tmp_path_factory):
    """Return the page of a finished campaign, from its path."""
    need_browser()

    def make(folder):
        data = read_campaign(shared_campaign("estimated") / "estimated.h5")
        assert list(write_report(data, folder, simulate=True))

    return made_once(shared_folder(tmp_path_factory) / "page", make) / "report.html"


@pytest.fixture(scope="module")
def many(shared_campaign, tmp_path_factory):
    """Return a page with more of the best strings beside each other than paper has room for."""
    need_browser()

    def make(folder):
        copy = shutil.copy(shared_campaign("estimated") / "estimated.h5", folder / "many.h5")
        with h5py.File(copy, "r+") as file:
            file.attrs["campaign"] = file.attrs["campaign"].replace("strings: 6", "strings: 12")
        assert list(write_report(read_campaign(copy), folder, simulate=False))

    return made_once(shared_folder(tmp_path_factory) / "many", make) / "report.html"


@pytest.fixture
def at(page, tmp_path):
    """Return a context in which the page is open in a browser of a width."""

    @contextmanager
    def context(width, **options):
        with browser(tmp_path, width, **options) as driver:
            driver.get(page.as_uri())
            yield driver
            assert console(driver) == []

    return context


def unfold(driver):
    driver.execute_script("for (const each of document.querySelectorAll('details')) each.open = 1")


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [HUGE, WIDE, NARROW])
def test_everything_fits_into_the_window_and_nothing_overlaps(at, width, dark):
    with at(width, dark=dark) as driver:
        unfold(driver)
        across = driver.execute_script(
            "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        )
        assert across == [width, width]
        assert driver.execute_script(OVERLAPS) == []
        assert driver.execute_script(CUT) == []


@pytest.mark.parametrize("name", ["page", "many"])
def test_on_paper_nothing_is_cut_hidden_or_overlaps(request, tmp_path, name):
    with browser(tmp_path, WIDE) as driver:
        driver.get(request.getfixturevalue(name).as_uri())
        on_paper(driver)
        cut = CUT.replace(OF_SCROLLED, "")
        assert cut != CUT
        assert driver.execute_script(cut) == []
        assert driver.execute_script(HIDDEN) == []
        assert driver.execute_script(OVERLAPS) == []
        broad = driver.find_elements("css selector", "#answer table.broad")
        assert len(broad) == (name == "many")
        best = driver.find_elements("css selector", "#answer tbody tr td:first-child")
        assert [each.text for each in best] == [f"#{i + 1}" for i in range(12 if broad else 6)]


def test_headings_stay_with_what_is_below_them_on_paper(at):
    """At least four lines of 9 pt are below each; and every row of a folded table is printed."""
    with at(WIDE) as driver:
        strings, heights = printed(driver)
        rows = driver.find_elements("css selector", "#strings tbody tr")
        assert len(strings) == len(rows)
        headings = driver.find_elements("css selector", "h1, h2, h3")
        assert heights.keys() == {each.text for each in headings}
        assert min(heights.values()) > 54.0
        assert not driver.find_element("css selector", "#strings details").get_attribute("open")


def test_each_stop_of_the_tab_key_has_a_name_and_none_is_in_an_image(at):
    with at(WIDE) as driver:
        unfold(driver)
        stops = driver.execute_script(TAB_STOPS)
        assert len(stops) > 20
        assert [name for name, in_image in stops if in_image or not name] == []


def test_names_of_images_lead_to_their_files(at, page):
    with at(WIDE) as driver:
        links = driver.find_elements("css selector", "figcaption a")
        assert len(links) == 2 * len(driver.find_elements("css selector", "figure"))
        for link in links:
            assert (page.parent / link.text).stat().st_size > 100
            assert link.get_attribute("href") == (page.parent / link.text).as_uri()


def test_figures_stand_in_two_columns_on_a_wide_screen_and_in_one_on_a_narrow_one(at):
    left = """return [...new Set([...document.querySelectorAll("figure")].map(
        (each) => Math.round(each.getBoundingClientRect().left)))].length"""
    with at(WIDE) as driver:
        assert driver.execute_script(left) == 2
    with at(NARROW) as driver:
        assert driver.execute_script(left) == 1


def test_lettering_of_figures_stays_legible_on_a_narrow_screen(at):
    """Matplotlib's 8 pt are at least 6 pixels, and 10 pixels in a figure that scrolls."""
    scales = """return [...document.querySelectorAll("figure svg")].map((each) => [
        each.viewBox.baseVal.width / 72,
        each.getBoundingClientRect().width / each.viewBox.baseVal.width])"""
    with at(NARROW) as driver:
        for inches, scale in driver.execute_script(scales):
            assert scale >= (1.24 if inches >= SCROLLED else 0.75), inches


def test_the_question_stands_below_warnings_and_ranges_below_results(at):
    with at(WIDE) as driver:
        first = driver.find_element("css selector", "section")
        if first.find_element("css selector", "h2").text == "Warnings":
            first = driver.find_elements("css selector", "section")[1]
        assert first.find_element("css selector", "h2").text == "Question"
        rows = driver.find_elements("css selector", "#ranges tbody tr")
        ranges = {row.text.split("\n")[0].rsplit(" ", 4)[0]: row.text for row in rows}
        assert re.search(r"hardness 10 200 MPa evenly", " ".join(ranges.values()))
        assert "2" in first.find_element("css selector", "dd").text


def column(driver, table, label):
    cells = driver.find_elements("css selector", f"{table} td[data-label='{label}']")
    return [cell.get_attribute("textContent") for cell in cells]


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_a_click_on_a_heading_sorts_a_table_and_a_second_one_turns_it(at, width):
    with at(width) as driver:
        unfold(driver)
        [heading] = driver.find_elements("xpath", "//section[@id='strings']//th[.='string']")
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", heading)
        before = [int(text) for text in column(driver, "#strings", "string")]
        heading.click()
        assert [int(text) for text in column(driver, "#strings", "string")] == sorted(before)
        assert heading.get_attribute("aria-sort") == "ascending"
        heading.click()
        assert [int(text) for text in column(driver, "#strings", "string")] == sorted(before)[::-1]
        assert before != sorted(before)


def test_values_are_sorted_by_their_numbers_and_empty_cells_are_last(at):
    with at(WIDE) as driver:
        unfold(driver)
        label = "objective, re-estimate"
        [heading] = driver.find_elements("xpath", f"//section[@id='strings']//th[.='{label}']")
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", heading)
        heading.click()
        texts = column(driver, "#strings", label)
        known = [text for text in texts if text]
        assert len(known) == 6
        assert texts[:6] == known
        values = [float(text.split()[0]) for text in known]
        assert values == sorted(values)


@pytest.mark.parametrize(("figure", "mark"), [("best_strings", "path"), ("search_paths", "use")])
def test_the_values_of_a_string_show_under_the_pointer(at, figure, mark):
    from selenium.webdriver import ActionChains

    with at(WIDE) as driver:
        marks = driver.find_elements("css selector", f"#{figure} a[href^='#string-'] {mark}")
        chosen = marks[len(marks) // 2]
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", chosen)
        box = driver.find_element("css selector", ".values")
        assert not box.is_displayed()
        if mark == "use":
            ActionChains(driver).move_to_element(chosen).perform()
        else:
            _move_onto_line(driver, chosen)
        assert box.is_displayed()
        shown = int(re.search(r"(?m)^string: (\d+)$", box.text)[1])
        same = driver.find_elements("css selector", f"a.same[href='#string-{shown}']")
        assert len(same) >= 2  # it is marked in both figures
        unfold(driver)
        row = driver.find_elements("css selector", f"#string-{shown} td")
        cells = [(cell.get_attribute("data-label"), cell.text) for cell in row]
        assert box.text.split("\n") == [f"{label}: {text}" for label, text in cells if text]
        ActionChains(driver).move_to_element(driver.find_element("css selector", "h1")).perform()
        assert not box.is_displayed()


@pytest.mark.parametrize("figure", ["best_strings", "search_paths"])
def test_the_values_of_strings_show_at_the_arrow_keys(at, figure):
    from selenium.webdriver import ActionChains, Keys

    with at(WIDE) as driver:
        driver.execute_script(f"document.querySelector('#{figure} svg').focus()")
        box = driver.find_element("css selector", ".values")

        def press(key):
            ActionChains(driver).send_keys(key).perform()
            found = re.search(r"(?m)^rank: (\d+)$", box.text) if box.is_displayed() else None
            return found and int(found[1])

        first, second = press(Keys.HOME), press(Keys.ARROW_RIGHT)
        assert first == 1 < second
        assert (press(Keys.ARROW_LEFT), press(Keys.ARROW_LEFT)) == (first, first)
        assert press(Keys.END) > second
        assert press(Keys.ESCAPE) is None
        assert press(Keys.ARROW_DOWN) == first
        string = re.search(r"(?m)^string: (\d+)$", box.text)[1]
        press(Keys.ENTER)
        assert driver.current_url.endswith(f"#string-{string}")
        press(Keys.TAB)
        assert not box.is_displayed()


def test_the_keyboard_sorts_a_table(at):
    with at(WIDE) as driver:
        unfold(driver)
        [heading] = driver.find_elements("xpath", "//section[@id='strings']//th[.='string']")
        before = [int(text) for text in column(driver, "#strings", "string")]
        heading.find_element("css selector", "button").send_keys(" ")
        assert [int(text) for text in column(driver, "#strings", "string")] == sorted(before)


def _move_onto_line(driver, line):
    """Move the pointer to the first point of a line, which `move_to_element` may miss."""
    x, y = driver.execute_script(
        """const [line, svg] = [arguments[0], arguments[0].ownerSVGElement];
        const place = line.getPointAtLength(0.02 * line.getTotalLength());
        const seen = place.matrixTransform(line.getScreenCTM());
        return [seen.x, seen.y];""",
        line,
    )
    event = {"type": "mouseMoved", "x": x, "y": y}
    driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)


def test_each_table_is_saved_as_a_csv_file_with_the_same_cells(at, tmp_path):
    with at(WIDE) as driver:
        unfold(driver)
        tables = driver.find_elements("css selector", ".table")
        names = [each.find_element("css selector", ".csv").text for each in tables]
        assert {"ranges.csv", "best_strings.csv", "strings.csv", "starts.csv"} <= set(names)
        assert len(set(names)) == len(names)
        for table, name in zip(tables, names, strict=True):
            link = table.find_element("css selector", ".csv")
            driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", link)
            link.click()
            wait_for((tmp_path / name).exists, f"the download of {name}")
            with (tmp_path / name).open(newline="") as file:
                [headings, *rows] = csv.reader(file)
            cells = table.find_elements("css selector", "tbody td")
            texts = [cell.get_attribute("textContent") for cell in cells]
            assert [text for row in rows for text in row] == texts, name
            assert len(headings) == len(rows[0])


@pytest.mark.parametrize("dark", [False, True])
def test_figures_and_text_are_dark_where_the_page_is(at, dark):
    with at(WIDE, dark=dark) as driver:
        page = driver.find_element("css selector", "html")
        background = driver.find_element("css selector", "#convergence svg path")
        light = {
            "page": driver.execute_script(LUMINANCE, page, "backgroundColor"),
            "figure": driver.execute_script(LUMINANCE, background, "fill"),
        }
        text = driver.execute_script(LUMINANCE, page, "color")
        assert all((value < 0.2) == dark and (value > 0.8) != dark for value in light.values())
        assert (text > 0.8) == dark


def test_without_scripts_all_of_the_page_is_visible(at):
    with at(WIDE, scripts=False) as driver:
        rows = driver.find_elements("css selector", "#strings tbody tr")
        assert len(rows) > 6
        assert all(row.find_element("css selector", "td").is_displayed() for row in rows)
        assert all(each.is_displayed() for each in driver.find_elements("css selector", "pre"))
        assert driver.find_elements("css selector", ".values") == []
