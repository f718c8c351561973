"""Campaign files that somebody has altered with h5py, as HDF5 sound: attributes, tables, rows."""

import hashlib
import json

import h5py
import numpy as np
from hypothesis import strategies as st

from agglom_mpi.storage.table import checksums

TEXTS = [
    "",
    "\x1b]0;owned\x07",
    "a\nb",
    "é" * 400,
    "x" * 60_000,
    "\u202ex",
    "<script>",
]
VALUES = st.one_of(
    st.sampled_from(TEXTS),
    st.sampled_from([0, 1, -1, 2, 3, 2**31, 2**40, 2**62, 2**63 - 1, -(2**63)]),
    st.sampled_from([0.5, float("nan"), float("inf"), -1e308, True, None]),
    st.sampled_from([b"\xff\xfe", np.void(b"\x00\xff"), np.zeros(3), np.zeros((2, 0), "i8")]),
    st.sampled_from([np.array(["a", "b"], "S1"), np.array([b"\xff"], "S2"), np.float16(1.0)]),
    st.integers(-(2**63), 2**63 - 1),
    st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=20),
)
ENTRIES = st.one_of(
    st.sampled_from(
        [None, True, -1, 0, 1, 2.5, 1e300, 10**30, "", "x", "\x1b[31m", [], {}, [[]], {"a": 1}]
    ),
    st.sampled_from(["event", "genetic", "moments", "none", "characteristic", float("nan")]),
    st.integers(),
    st.floats(),
)
"""Of the identity."""


def _attribute(draw, file):
    name = draw(st.sampled_from(sorted(file.attrs)))
    value = draw(VALUES)
    if value is None:
        del file.attrs[name]
    else:
        file.attrs[name] = h5py.Empty("f8") if value is True else value


def _raw_text(draw, file):
    """Store bytes that are no UTF-8 where a text is expected."""
    name = draw(st.sampled_from(sorted(file.attrs)))
    kind = h5py.string_dtype("utf-8", draw(st.sampled_from([8, None])))
    del file.attrs[name]
    file.attrs.create(
        name, draw(st.sampled_from([b"\xff\xfe", b"a\x1b[2Jb", b"\xc3\x28"])), dtype=kind
    )


def _identity(draw, file):
    """Change the identity together with its digest."""
    entries = json.loads(file.attrs["identity"])
    key = draw(st.sampled_from(sorted(entries)))
    if draw(st.integers(0, 4)) == 0:
        del entries[key]
    else:
        entries[key] = draw(ENTRIES)
    file.attrs["identity"] = json.dumps(entries)
    text = json.dumps(entries, sort_keys=True, separators=(",", ":"))
    file.attrs["campaign_sha256"] = hashlib.sha256(text.encode()).hexdigest()


def _campaign(draw, file):
    """Change a number in the text of the campaign."""
    words = file.attrs["campaign"].split(" ")
    words[draw(st.integers(0, len(words) - 1))] = draw(
        st.sampled_from(["0", "1e9", "[", "none", "\n"])
    )
    file.attrs["campaign"] = " ".join(words)


def _table(draw, file):
    """Put something else in the place of a table, or nothing."""
    name = draw(st.sampled_from(_tables(file)))
    shape, dtype = file[name].shape, file[name].dtype
    del file[name]
    match draw(st.sampled_from(["none", "group", "link", "elsewhere", "size", "type", "shape"])):
        case "group":
            file.create_group(name)
        case "link":
            file[name] = h5py.SoftLink(f"/{draw(st.sampled_from([name, 'nothing', *file]))}")
        case "elsewhere":
            file[name] = h5py.ExternalLink("../neighbour/notes.txt", "/")
        case "size":
            size = draw(st.sampled_from([64, 10**9, 2**40]))
            file.create_dataset(name, (size,), dtype, chunks=(64,))
        case "type":
            file.create_dataset(name, shape, draw(st.sampled_from(["f8", "S4", "i1", "u8"])))
        case "shape":
            file.create_dataset(name, (*shape, 2), dtype)


def _value(draw, dtype, shape):
    """Draw a value of a column."""
    if dtype.kind == "S":
        return draw(
            st.sampled_from([b"\xff\xfe", b"\x1b[31m", b"", b"running", b"x" * dtype.itemsize])
        )
    if dtype.kind == "f":
        found = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e308, 5e-324, -1e308, 1e9])
    else:
        limits = np.iinfo(dtype)
        found = st.sampled_from([limits.min, limits.max, 0, 1, 2, 3, 5, 255 % limits.max])
    return draw(found) if not shape else np.full(shape, draw(found))


def _tables(file):
    """Return the names of the tables, those of done bytes left out."""
    return sorted(name for name in file if file[name].dtype.names)


def _rows(draw, file):
    """Change columns of some rows, mostly together with their checksums."""
    name = draw(st.sampled_from(_tables(file)))
    rows = file[name][:20]
    for _ in range(draw(st.integers(1, 3))):
        column = draw(st.sampled_from(rows.dtype.names))
        kind = rows.dtype[column]
        first = draw(st.integers(0, len(rows) - 1))
        rows[column][first : draw(st.integers(first, len(rows))) + 1] = _value(
            draw, kind.base, kind.shape
        )
    if "crc" in rows.dtype.names and draw(st.integers(0, 3)):
        rows["crc"] = checksums(rows)
    file[name][: len(rows)] = rows


def _done(draw, file):
    """Say of rows that they are final, or not."""
    name = f"{draw(st.sampled_from(_tables(file)))}_done"
    if name in file and len(file[name]):
        last = draw(st.integers(0, min(30, len(file[name]) - 1)))
        first = draw(st.integers(0, last))
        file[name][first : last + 1] = draw(st.sampled_from([0, 1, 2, 255]))


WHOLE = [_attribute, _attribute, _raw_text, _identity, _campaign, _table]
WITHIN = [_rows, _rows, _rows, _done]


def alter(draw, path):
    """Alter a campaign file in up to four ways, drawn by a function of Hypothesis."""
    with h5py.File(path, "r+") as file:
        rows = draw(st.integers(0, 3))
        for _ in range(rows):
            draw(st.sampled_from(WITHIN))(draw, file)
        if rows == 0 or draw(st.booleans()):
            draw(st.sampled_from(WHOLE))(draw, file)
