import importlib.util
import re
import shutil
from html import escape
from pathlib import Path

import h5py
import numpy as np
import pytest
from campaign_runs import SMALL, finish, write_campaign
from click.testing import CliRunner
from storage_rows import put_status

from agglom_mpi.analysis import ranking, run_warnings
from agglom_mpi.analysis.best_strings import best_table, collect_best
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.display.table import Column, Table
from agglom_mpi.errors import MissingLibraryError
from agglom_mpi.report import style as drawing_module
from agglom_mpi.report.export import ExportError
from agglom_mpi.report.figures.figure import figures as all_figures
from agglom_mpi.report.page import PRINTED_CHARACTERS, is_broad, write_report
from agglom_mpi.report.sample_particles import final_radii
from agglom_mpi.report.sections.published import beside, read_published
from agglom_mpi.report.sections.run import legs
from agglom_mpi.report.style import Drawing, write_drawing
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.storage.lock import CampaignLock
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import RESULTS, sample_dtype
from agglom_mpi.storage.table import checksums, make_row
from agglom_mpi.storage.writer import CampaignWriter

FIGURES = {
    "best_strings",
    "busy",
    "cloud",
    "convergence",
    "cost",
    "ensembles",
    "finalists",
    "radii",
    "samples_per_string",
    "search_paths",
}


def report(path, directory, **options):
    """Write the report of a file, and return its page."""
    options = {"simulate": False} | options
    lines = list(write_report(read_campaign(path), directory, **options))
    assert lines[-1].startswith(f"{directory / 'report.html'}: ")
    return (directory / "report.html").read_text()


def names(directory):
    return {path.name for path in directory.iterdir()}


def figures(page):
    return set(re.findall(r'<a href="(\w+)\.png">', page))


def warnings_of(page):
    """Return what stands above the question that a campaign asks."""
    return page[: page.index('<section id="question"')].partition('<section id="warnings"')[2]


@pytest.fixture
def waiting(tmp_path):
    """Return the file of a campaign that has not begun."""
    write_campaign(tmp_path / "small.yaml", **SMALL)
    work = InversionExperiment(load_campaign(tmp_path / "small.yaml"))
    prepare(tmp_path / "small.h5", work, accept_code_change=False)
    return tmp_path / "small.h5"


def begin(path, failed=0, ended=0):
    """Let a campaign judge three strings by ten samples each, the first by some that fail.

    A number of them have `ended` at the largest number of samples.
    """
    parameters = np.full((3, 10), 2.0)
    parameters[:, 9] = np.nan
    with CampaignWriter(path) as writer:
        writer.log.begin_leg(**leg_start(1, ""))
        writer.set_status("running")
        writer.put_strings(0, 0, np.arange(3), np.zeros(3, int), np.full((3, 2), -1), parameters)
        for string in range(3):
            rows = np.zeros(10, sample_dtype)
            rows["string"], rows["sample"], rows["state"] = string, np.arange(10), 1
            rows["mean_radius_ratio"], rows["particles"] = 1.5 + 0.1 * np.arange(10), 20
            rows["seconds"], rows["cpu_seconds"], rows["energy_error"] = 0.25, 0.2, 1e-12
            if string == 0:
                rows["state"][:failed], rows["reason"][:failed] = 2, 3
            writer.put_samples(rows)
        for string in range(3):
            bad = string == 0 and failed > 1
            row = make_row(
                RESULTS.dtype,
                string=string,
                objective=np.inf if bad else 0.1 + 0.1 * string,
                standard_error=0.01,
                mean_radius_ratio=1.9,
                mean_grains=7.0,
                growth_number=6.859,
                samples_used=10,
                failed=failed if string == 0 else 0,
                hit_maximum=string < ended,
            )
            writer.put_result(row)


@pytest.fixture
def sketched(monkeypatch):
    """Draw all figures, and write something much smaller than them."""
    from matplotlib.figure import Figure

    def write(directory, drawing):
        drawing.draw(Figure(figsize=drawing.size))
        for suffix in ("png", "svg"):
            (directory / f"{drawing.name}.{suffix}").write_text('<svg viewBox="0 0 1 1"></svg>')

    monkeypatch.setattr(drawing_module, "write_drawing", write)


@pytest.fixture
def undrawn(monkeypatch):
    """Write something in the place of each figure."""

    def write(directory, drawing):
        for suffix in ("png", "svg"):
            (directory / f"{drawing.name}.{suffix}").write_text('<svg viewBox="0 0 1 1"></svg>')

    monkeypatch.setattr(drawing_module, "write_drawing", write)


@pytest.mark.parametrize("simulate", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_page_and_its_figures_are_complete_and_self_contained(finished, tmp_path, simulate):
    page = report(finished, tmp_path / "out", simulate=simulate)
    wanted = FIGURES if simulate else FIGURES - {"cloud"}
    assert figures(page) == wanted
    written = {f"{name}.{suffix}" for name in wanted for suffix in ("png", "svg")}
    assert names(tmp_path / "out") == {"report.html", *written}
    assert page.count("<figure") == page.count("<svg") + page.count("<img") == len(wanted)
    assert page.count("<script>") == page.count("<script") == 1
    sources = re.findall(r'(?:src|href)="([^"]{0,30})', page)
    assert {source for source in sources if not source.startswith(("#", "data:"))} == written
    assert all(place.startswith("#") for place in re.findall(r"url\((.)", page))
    identifiers = re.findall(r'\bid="([^"]*)"', page)
    links = re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', page)
    assert len(identifiers) == len(set(identifiers))
    assert {one or other for one, other in links} <= set(identifiers)
    assert "identical to the recorded ones" in page or not simulate


@pytest.mark.usefixtures("undrawn")
def test_without_particles_the_mean_radii_of_samples_are_shown_instead(finished, tmp_path):
    page = report(finished, tmp_path / "out")
    assert "particles are not stored" in page
    assert "No cloud of particles" in page


@pytest.mark.usefixtures("undrawn")
def test_the_page_names_what_the_scene_leaves_out_and_the_worst_samples(finished, tmp_path):
    page = report(finished, tmp_path / "out")
    samples = read_campaign(finished).all_sample_rows()
    worst = samples[np.argmax(np.abs(samples["energy_error"]))]
    assert "fragmentation" in page
    chosen = f"--string {worst['string']} --sample {worst['sample']}"
    assert f"agglom simulate {finished.name} {chosen}" in page
    assert f"None of {len(samples)} samples failed." in page


def test_a_campaign_that_has_not_begun_has_a_page_without_figures(waiting, tmp_path):
    page = report(waiting, tmp_path / "out", sensitivity=True)
    assert names(tmp_path / "out") == {"report.html"}
    assert "not started yet" in page
    assert "No string is judged yet." in page
    assert "too few strings" in page


@pytest.mark.usefixtures("undrawn")
def test_a_file_that_is_being_written_has_a_page_of_what_is_there(waiting, tmp_path):
    begin(waiting)
    with CampaignLock(waiting):
        page = report(waiting, tmp_path / "out")
    assert "The file was being written when this was made." in page
    assert "3 strings judged by 30 samples of 30 simulated" in page
    assert figures(page) == {"best_strings", "ensembles", "radii"}


@pytest.mark.usefixtures("sketched")
def test_the_starts_show_how_much_of_their_busy_time_ranks_were_on_a_core(waiting):
    times = {"busy_seconds": 8.0, "cpu_seconds": 6.0, "database_seconds": 0.5}
    with CampaignWriter(waiting) as writer:
        leg = writer.log.begin_leg(**leg_start(2, "") | {"started": 1e9})
        writer.log.end_leg(leg, stopped=1e9 + 5.0, exit_code=0, samples=30, **times)
        writer.log.begin_leg(**leg_start(2, ""))
    table = legs(read_campaign(waiting))
    places = [table.headings.index(name) for name in ("busy", "on a core", "writing")]
    ended, running = table.cells
    assert [ended[place] for place in places] == ["80.0%", "75.0%", "5.00%"]
    assert [running[place] for place in places] == ["", "", ""]


def test_a_string_is_shown_with_its_processor_time_or_else_its_wall_clock_time(waiting):
    def shown():
        data = read_campaign(waiting)
        table = best_table(data, collect_best(data, 6))
        return dict(zip(table.headings, zip(*table.cells, strict=True), strict=True))

    begin(waiting)
    assert shown()["processor time"] == ("2 s", "2 s", "2 s")
    with h5py.File(waiting, "r+") as file:
        rows = file["samples"][...]
        rows["cpu_seconds"] = np.nan
        rows["crc"] = checksums(rows)
        file["samples"][...] = rows
    assert shown()["wall-clock time"] == ("2.5 s", "2.5 s", "2.5 s")
    assert "processor time" not in shown()


@pytest.mark.usefixtures("undrawn")
def test_warnings_of_the_terminal_stand_at_the_top(waiting, finished, tmp_path, monkeypatch):
    begin(waiting, failed=1, ended=2)
    [shown] = re.findall(r"(\d+) strings ended", warnings_of(report(waiting, tmp_path / "out")))
    assert shown == "2"
    assert "1 sample failed" in warnings_of((tmp_path / "out" / "report.html").read_text())
    monkeypatch.setattr(run_warnings, "FEWEST_LEFT", 99)
    lines = run_warnings.run_warnings(read_campaign(finished))
    assert "scene.particles" in " ".join(lines)
    page = warnings_of(report(finished, tmp_path / "finished"))
    assert page.count('class="warning"') >= len(lines)
    assert all(escape(line) in page for line in lines)


@pytest.mark.usefixtures("undrawn")
def test_ranges_stand_below_the_results(finished, tmp_path):
    page = report(finished, tmp_path / "out")
    sections = re.findall(r'<section id="(\w+)"', page)
    first = ["question", "answer", "ranges"]
    assert sorted(first, key=sections.index) == first


@pytest.mark.usefixtures("undrawn")
def test_each_string_says_what_it_is_ranked_by(four_of_six, tmp_path, monkeypatch):
    monkeypatch.setattr(ranking, "ranks_itself", lambda data: True)
    page = report(four_of_six, tmp_path / "out")
    data = read_campaign(four_of_six)
    by = ranking.places_by(data)
    shown = re.findall(r'data-label="ranked by">([^<]*)</td>', page)
    assert shown == by
    assert by[:4] == ["re-estimate"] * 4
    last = set(data.generation_rows()["population"][-1].tolist())
    order = rank_strings(data).order
    kinds = ["search" if string in last else "samples" for string in order[4:]]
    assert by[4:] == kinds == sorted(kinds, reverse=True)
    lowest = min(order, key=lambda string: rank_strings(data).results[string]["objective"])
    place = order.index(lowest)
    assert f"string {lowest} has place {place + 1}, by {by[place]}." in page


@pytest.mark.parametrize("upright", [True, False])
def test_a_table_without_room_on_paper_is_broad(upright):
    columns = [Column("first"), Column("text", text=True), Column("pair")]
    row = {"first": "a b", "text": "words " * 50, "pair": "0.1234 ± 0.0056"}

    def broad(factor, **others):
        return is_broad(Table(columns * factor, [row | others] * factor, upright=upright))

    assert not broad(1)
    assert broad(1, text="x" * PRINTED_CHARACTERS)
    assert broad(20)


def test_failed_samples_are_counted_by_reason(waiting, tmp_path):
    begin(waiting, failed=4)
    page = report(waiting, tmp_path / "out")
    assert "4 of 30 samples: budget of steps or events exceeded" in page
    assert "Most failures: string 0 (4)." in page
    shown = page[page.index('id="answer"') : page.index('id="search"')]
    assert re.findall(r'data-label="string">(\d+)</td>', shown) == ["1", "2"]


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize(
    "table",
    [
        "samples",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("strings", "results")),
        pytest.param("generations", marks=pytest.mark.slow),
    ],
)
def test_damaged_rows_are_left_out_and_counted(copy, tmp_path, table):
    best = int(open_campaign(copy).best()["string"][0])
    place = {"generations": 1, "samples": best * read_campaign(copy).max_samples}.get(table, best)
    with h5py.File(copy, "r+") as file:
        row = file[table][place]
        row["crc"] ^= 1
        file[table][place] = row
    page = report(copy, tmp_path / "out", simulate=True)
    assert "1 damaged row left out" in warnings_of(page)
    assert "convergence" in figures(page)


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_campaign_text_is_reported(copy, tmp_path):
    with h5py.File(copy, "r+") as file:
        file.attrs["campaign"] = "scene: [nonsense"
    page = report(copy, tmp_path / "out", simulate=True)
    assert "text in the file cannot be read" in page
    assert "convergence" in figures(page)


@pytest.mark.usefixtures("undrawn")
def test_a_title_is_shown_as_it_is_written(copy, tmp_path):
    with h5py.File(copy, "r+") as file:
        file.attrs["title"] = "<script>alert(1)</script> & co"
    page = report(copy, tmp_path / "out")
    assert "<h1>&lt;script&gt;alert(1)&lt;/script&gt; &amp; co</h1>" in page


SCRIPT = "<script>alert(1)</script>"


@pytest.mark.usefixtures("undrawn")
def test_no_text_of_a_file_becomes_a_part_of_the_page(copy, tmp_path):
    copy = copy.rename(copy.with_name("<b>name.h5"))
    with CampaignWriter(copy) as writer:
        writer.log.put_failure(0, 0, rank=0, host=SCRIPT, text=f"module.py: {SCRIPT}")
    with h5py.File(copy, "r+") as file:
        for name in ("title", "created", "code_version", "sources_sha256"):
            file.attrs[name] = SCRIPT
        file.attrs["campaign"] = f"# {SCRIPT}\n{file.attrs['campaign']}"
        legs = file["legs"][:1]
        for name in ("host", "processor", "code_version"):
            legs[name] = SCRIPT.encode()
        legs["crc"] = checksums(legs)
        file["legs"][:1] = legs
        put_status(file, state=b"<script>", reason=SCRIPT.encode())
    page = report(copy, tmp_path / "out")
    assert page.count("&lt;script&gt;alert(1)") >= 9
    assert page.count("<script") == 1
    assert SCRIPT not in page
    assert "<b>" not in page


def test_texts_in_a_figure_are_texts(tmp_path):
    def draw(figure):
        figure.subplots().set_title(SCRIPT)

    write_drawing(tmp_path, Drawing("x", SCRIPT, draw))
    assert "<script" not in (tmp_path / "x.svg").read_text()


@pytest.mark.usefixtures("undrawn")
def test_other_files_in_the_directory_stay_and_the_page_is_replaced(finished, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("notes.txt", "report.html", "convergence.pdf"):
        (out / name).write_text("mine")
    assert report(finished, out) != "mine"
    assert (out / "notes.txt").read_text() == (out / "convergence.pdf").read_text() == "mine"


@pytest.mark.usefixtures("sketched")
def test_a_report_that_fails_leaves_the_old_page_and_no_pieces(finished, tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("old")

    def fail(*arguments):
        raise OSError(28, "No space left on device", "busy.png")

    monkeypatch.setitem(vars(all_figures()["busy"]), "draw", fail)
    with pytest.raises(OSError, match="No space left"):
        report(finished, out)
    assert (out / "report.html").read_text() == "old"
    assert not [name for name in names(out) if name.startswith(".") or name.endswith(".new")]


def test_what_is_no_directory_is_refused(finished, tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(ExportError, match="is no directory"):
        report(finished, tmp_path / "out")


@pytest.mark.parametrize("library", ["matplotlib", "jinja2"])
def test_without_a_library_one_message_says_what_to_install(
    finished, tmp_path, monkeypatch, library
):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == library else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    message = rf"need {library}: pip install 'agglom_mpi\[report\]'"
    with pytest.raises(MissingLibraryError, match=message):
        report(finished, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def agglom(*arguments):
    done = CliRunner().invoke(main, ["report", *map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exc_info
    return done


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_the_page_and_says_where(finished, tmp_path):
    done = agglom(finished, "--out", tmp_path / "out", "--stored-only")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.startswith(f"{tmp_path / 'out' / 'report.html'}: 9 figures as PNG and SVG")
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--stored-only"], "--stored-only is for --out"),
        (["--out", "x", "--json"], "give --out or --json, not both"),
        (["--out", __file__], "is no directory"),
    ],
)
def test_options_that_do_not_go_together_are_refused(finished, words, message):
    done = agglom(finished, *words)
    assert done.exit_code == 2
    assert message in done.stderr


def test_stored_particles_and_frames_are_shown_without_simulating(tmp_path):
    path = write_campaign(
        tmp_path / "kept.yaml", generations=1, max_samples=5, population=4, parents=2
    )
    kept = "output: {final_particles: true, frames: {count: 5, strings: 1}}\n"
    path.write_text(path.read_text() + kept)
    finish(tmp_path, "kept.yaml")
    page = report(tmp_path / "kept.h5", tmp_path / "out")
    assert {"radii", "cloud"} <= figures(page)
    assert "as stored" in page
    data = read_campaign(tmp_path / "kept.h5")
    stored = final_radii(data, rank_strings(data).order[0])
    plain = shutil.copy(tmp_path / "kept.h5", tmp_path / "plain.h5")
    with h5py.File(plain, "r+") as file:
        file["final_particles_done"][:] = 0
    simulated = final_radii(read_campaign(plain), rank_strings(data).order[0])
    assert "identical to the recorded" in simulated.source
    np.testing.assert_allclose(simulated.values, stored.values, rtol=1e-14)
    assert simulated.central == stored.central


def table_of(page, caption):
    """Return the cells of a table of the page, a list for each row, the headings first."""
    part = page[page.index(f"<caption>{caption}") :]
    rows = re.findall("<tr.*?</tr>", part[: part.index("</table>")], re.DOTALL)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_the_best_strings_are_as_many_as_the_campaign_estimates_again(copy):
    with h5py.File(copy, "r+") as file:
        text = file.attrs["campaign"]
        assert "strings: 6" in text
        file.attrs["campaign"] = text.replace("strings: 6", "strings: 4")
    assert listed_strings(read_campaign(copy)) == 4


@pytest.mark.usefixtures("undrawn")
def test_the_page_sets_the_best_strings_beside_published_ones(four_of_six, tmp_path):
    published = read_published(Path("jobs/published/accretion_2003.json"))
    page = report(four_of_six, tmp_path / "out", published=published)
    headings, *rows = table_of(page, "[A] table 1")
    assert headings[-2:] == ["Λ, as searched", "Λ, re-estimate"]
    assert [row[1] for row in rows[:4]] == ["published", "here"] * 2
    assert rows[0][-2:] == ["0.00013602", ""]
    assert "[A] table 1" not in report(four_of_six, tmp_path / "plain")


@pytest.mark.parametrize("text", ["", "[]", '{"paper": "", "note": "", "tables": [{}]}'])
def test_another_file_than_published_tables_is_named(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(CampaignError, match=r"other\.json"):
        read_published(path)


def test_published_rows_have_no_re_estimate(four_of_six):
    data = read_campaign(four_of_six)
    published = read_published(Path("jobs/published/agglomeration_2004.json"))
    table = beside(published.tables[2], data)
    assert table.headings[2:4] == ["Π, as searched", "Π, re-estimate"]
    published, here = table.cells[0], table.cells[1]
    assert published[2:] == ["0.67708", "", "3.2292", "", "33.6732", ""]
    assert "" not in here[2:]
    assert table.cells[-1][3::2] == ["", "", ""]
