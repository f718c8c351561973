"""Campaign files that somebody has altered: shown, or refused in words, whatever is asked."""

import json
import shutil
import signal
import sys
import time
from collections import Counter

import flipped_bits
import numpy as np
import pytest
from attacked_commands import PHASES
from flipped_bits import REFUSED, SOUND
from forked import called_in_child
from hostile_files import alter
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from processes import output_of, program

from agglom_mpi.errors import FAILURE, FINISHED

ASKED = [
    *("agglom check X", "agglom report X", "agglom report X --json", "agglom report X tiny.h5"),
    *("agglom report X --sensitivity", "agglom export X --csv csv"),
    "agglom report X --out page --stored-only",
    "agglom export X --compact copy.h5",
    *("agglom simulate X --string 0 --sample 0", "agglom simulate X --string 1 --json"),
    *("agglom plan tiny.yaml --from X --ranks 1,3", "agglom-invert tiny.yaml -o X"),
    "agglom-invert tiny.yaml -o X --generations 2 --quiet",
]
BATCH = 100
"""Files that one process sees."""


@pytest.fixture
def work(commands, tiny_folder, monkeypatch):
    """Return commands with a tiny campaign and its file, everything that they need loaded."""
    for name in ("tiny.yaml", "tiny.h5"):
        shutil.copy(tiny_folder / name, commands.folder)
    monkeypatch.setattr("agglom_mpi.report.style.write_drawing", sketch)
    for line in ASKED:
        shutil.copy(tiny_folder / "tiny.h5", commands.folder / "x.h5")
        commands.load(*line.replace("X", "x.h5").split())
    return commands


def sketch(folder, drawing):
    """Draw a figure, and write something much smaller than it."""
    drawing.draw(Figure(figsize=drawing.size))
    (folder / f"{drawing.name}.png").write_text(drawing.name)
    (folder / f"{drawing.name}.svg").write_text('<svg viewBox="0 0 1 1"></svg>')


def clear(folder):
    """Remove what the commands have written."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name not in ("tiny.yaml", "tiny.h5"):
            path.unlink()


def ends_of_altered_files(work, sound, count, number):
    """Exit codes and processor times in s of commands for `count` altered files.

    Asserts what holds of each.
    """
    ends = []

    @seed(number)
    @settings(max_examples=count, database=None, phases=PHASES)
    @given(st.data())
    def attack(data):
        clear(work.folder)
        (work.folder / "x.h5").write_bytes(sound)
        alter(data.draw, work.folder / "x.h5")
        line = data.draw(st.sampled_from(ASKED))
        begun = time.process_time()
        ended = work.run(*line.replace("X", "x.h5").split())
        ends.append((ended.code, time.process_time() - begun))
        if ended.code != FINISHED:
            # Of a sample that is simulated again, it is said that it fails or differs.
            assert "x.h5" in ended.errors + ended.said or line.startswith("agglom simulate")

    attack()
    return ends


def batches(count):
    """Return the numbers of files that one process after the other sees."""
    return [min(BATCH, count - done) for done in range(0, count, BATCH)]


@pytest.mark.slow
def test_an_altered_file_is_shown_or_refused_in_words(work, cases):
    sound = (work.folder / "tiny.h5").read_bytes()
    # A process that has read thousands of them crashes at last, far from what did the damage.
    ends = [
        end
        for number, count in enumerate(batches(cases(150)))
        for end in called_in_child(ends_of_altered_files, work, sound, count, number)
    ]
    codes = Counter(code for code, _ in ends)
    slowest = max(seconds for _, seconds in ends)
    print(f"{len(ends)} altered files, by exit code {dict(codes)}, the slowest {slowest:.2f} s")
    assert {FINISHED, FAILURE} <= codes.keys()
    assert (work.folder / "tiny.h5").read_bytes() == sound


@pytest.mark.slow
def test_a_file_with_flipped_bits_is_read_or_refused_in_words(tiny_folder, tmp_path, cases):
    path, listed = tmp_path / "flipped.h5", tmp_path / "flips.json"
    content = (tiny_folder / "tiny.h5").read_bytes()
    # The rest is holes, and rows that are not there.
    places = np.flatnonzero(np.frombuffer(content, np.uint8))
    chance, found = np.random.default_rng(11), Counter()
    for count in batches(cases(300)):
        flips = [
            [(int(place), int(chance.integers(8))) for place in chance.choice(places, number)]
            for number in chance.integers(1, 9, count)
        ]
        listed.write_text(json.dumps(flips))
        path.write_bytes(content)
        with program([sys.executable, flipped_bits.__file__, path, listed]) as process:
            said, errors = output_of(process)
        assert process.returncode == 0, errors
        found.update(json.loads(said))
    print(f"{found.total()} files with flipped bits, by exit code or signal {dict(found)}")
    # Some damage makes HDF5 itself crash or never end, and nothing above it can catch that.
    ends = (signal.SIGSEGV, signal.SIGABRT, signal.SIGPROF)
    crashed = sum(found.pop(-number, 0) for number in ends)
    assert set(found) == {SOUND, REFUSED}
    assert 100 * crashed <= cases(300)
