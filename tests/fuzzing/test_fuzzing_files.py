"""Campaign files that somebody has altered: shown, or refused in words, whatever is asked."""

import shutil

import pytest
from hostile_files import alter
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from agglom_mpi.errors import FINISHED

ASKED = [
    *("agglom check X", "agglom report X", "agglom report X --json", "agglom report X tiny.h5"),
    *("agglom report X --sensitivity", "agglom export X --csv csv"),
    "agglom report X --out page --stored-only",
    "agglom export X --compact copy.h5",
    *("agglom simulate X --string 0 --sample 0", "agglom simulate X --string 1 --json"),
    *("agglom plan tiny.yaml --from X --ranks 1,3", "agglom-invert tiny.yaml -o X"),
    "agglom-invert tiny.yaml -o X --generations 2 --quiet",
]


@pytest.fixture
def work(commands, tiny_folder, monkeypatch):
    """Return commands with a tiny campaign and its file, everything that they need loaded."""
    for name in ("tiny.yaml", "tiny.h5"):
        shutil.copy(tiny_folder / name, commands.folder)
    monkeypatch.setattr("agglom_mpi.report.page.write_drawing", sketch)
    for line in ASKED:
        shutil.copy(tiny_folder / "tiny.h5", commands.folder / "x.h5")
        commands.load(*line.replace("X", "x.h5").split())
    return commands


def sketch(folder, drawing):
    """Draw a figure, and write something much smaller than it."""
    drawing.draw(Figure(figsize=drawing.size))
    for suffix in ("png", "svg"):
        (folder / f"{drawing.name}.{suffix}").write_text(drawing.name)


def clear(folder):
    """Remove what the commands have written."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name not in ("tiny.yaml", "tiny.h5"):
            path.unlink()


@pytest.mark.slow
def test_an_altered_file_is_shown_or_refused_in_words(work, cases):
    sound = (work.folder / "tiny.h5").read_bytes()
    codes = set()

    @settings(max_examples=cases(300), database=None)
    @given(st.data())
    def attack(data):
        clear(work.folder)
        (work.folder / "x.h5").write_bytes(sound)
        alter(data.draw, work.folder / "x.h5")
        line = data.draw(st.sampled_from(ASKED))
        ended = work.run(*line.replace("X", "x.h5").split())
        codes.add(ended.code)
        if ended.code != FINISHED:
            assert "x.h5" in ended.errors + ended.said

    attack()
    assert {FINISHED, 1} <= codes
    assert (work.folder / "tiny.h5").read_bytes() == sound
