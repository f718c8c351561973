"""Figures as the page holds them."""

import re

from agglom_mpi.report.sections.section import MAX_SVG_BYTES, embedded
from agglom_mpi.report.style import STRING_LINK, Drawing, write_drawing


def held(folder, draw, caption="what is seen"):
    """Return a figure with one panel as the page holds it."""
    drawing = Drawing("panel", caption, lambda figure: draw(figure.subplots()))
    write_drawing(folder, drawing)
    return embedded(folder, drawing)


def test_greys_have_a_dark_counterpart_and_colours_stay(tmp_path):
    figure = held(tmp_path, lambda ax: ax.plot([0, 1], color="#0072B2"))
    assert "fill: #ffffff; fill: light-dark(#ffffff, #171717)" in figure["svg"]
    assert "stroke: #000000; stroke: light-dark(#000000, #e6e6e6)" in figure["svg"]
    assert re.search(r"stroke: #0072b2(?!; stroke: light-dark)", figure["svg"])


def test_marks_lead_to_the_rows_of_their_strings(tmp_path):
    def draw(ax):
        ax.scatter([0, 1, 2], [0, 1, 2], urls=[f"{STRING_LINK}{i}" for i in (7, 8, 12)])

    found = re.findall(r'<a href="([^"]*)" tabindex="-1">', held(tmp_path, draw)["svg"])
    assert found == ["#string-7", "#string-8", "#string-12"]


def test_a_caption_is_a_text_of_the_figure_whatever_it_holds(tmp_path):
    figure = held(tmp_path, lambda ax: ax.plot([0, 1]), caption=r'"\g<1>" & <b>')
    assert r'aria-label="&quot;\g&lt;1&gt;&quot; &amp; &lt;b&gt;"' in figure["svg"]


def test_a_large_figure_is_held_as_pixels(tmp_path):
    count = MAX_SVG_BYTES // 100
    figure = held(tmp_path, lambda ax: ax.plot(range(count), "o"))
    assert figure["svg"] == ""
    assert figure["source"].startswith("data:image/png;base64,")
