"""Campaigns that somebody has taken apart: valid ones with mutated entries, values and bytes.

A campaign is a tree here: a mapping is a list of [key, value], so that a key may be there twice; a
sequence is a tuple; a scalar is YAML as it is written.
"""

import json
from pathlib import Path

from hypothesis import strategies as st
from ruamel.yaml import YAML

JOBS = Path(__file__).parents[2] / "jobs"
FILES = [path.read_text() for path in sorted(JOBS.rglob("*.yaml"))]
BASES = [text for text in FILES if "\nscene:" in text]  # the others are studies

NUMBERS = [
    *("0", "-0.0", "-1", "1", "2", "1e400", "-1e400", "1e-400", ".inf", "-.inf", ".nan", "nan"),
    *("9" * 30, "9" * 5000, "0x" + "f" * 40, "0o17", "017", "0b11", "1_000", "190:20:30", "1e"),
    *("1e308", "5e-324", "2147483648", "9223372036854775808", "-9223372036854775809", "1.0e+3"),
    *("+.5", "1.", "1e1e1", "1,5", "١٢", "½", "1e99", "1e-99", "0.1e-100"),
]
QUANTITIES = [
    *("10 MPa", "10 m", "-300 degC", "300 degF", "1 K*K/K", "1 m/0", "1 dB", "1e400 m", "nan m"),
    *("3 furlong/fortnight", "1 m**1e9", "1 m**-999999999", "1 m^m", "5 %", "1 mm mm mm", "1 m s"),
    *("1 " + "m*" * 300 + "m", "1 " + "kilo" * 200 + "m", "1 " + "(" * 500, "1 m" + "**9" * 40),
    *("1 [length]", "1 {}", "1 __import__('os')", "1 \\x00", "1 µm", "1 Å", "１ m", "1 m²", "1 '"),
    *(
        "1e999999999999 m",
        "9" * 4000 + " m",
        "1 delta_degC",
        "1 radian",
        "1 bit",
        "1 m if 1 else s",
    ),
    *("1 m**(9**9**9)", "1 9**9**9", "1 m**0.5", "1 s**-2 * m", "1 count", "1 m or 1", "1 lambda"),
]
TEXTS = [
    *("null", "~", "true", "yes", "no", "on", "2001-12-14", "2001-12-14t21:59:43.10-05:00", "''"),
    *("[]", "{}", "none", "log", "event", "fixed:5", "adaptive", "surrogate", "a:b", "os:system"),
    *('"\\x1b]0;owned\\a"', '"\\e[2J"', '"\\0"', '"\\u202E"', '"\\uD800"', '"\\u2028x"', '"a\\nb"'),
    *("x" * 70_000, '"' + "é" * 5000 + '"', "<script>", "{{ 7*7 }}", "%s%n", "$HOME", "../../etc"),
    *(
        "!!python/object/apply:os.system ['touch owned']",
        "!!python/name:os.system",
        "!!binary aGk=",
    ),
    *("!!set {a, b}", "!!omap [a: 1]", "!!timestamp 2001", "!!int x", "!!float x", "!foo bar"),
    *("!!str 5", "!!map [a]", "!!seq {a: 1}", "!!null x", "!!bool 7", "!<tag:yaml.org,2002:int> q"),
    *(
        "*nowhere",
        "&a *a",
        "&a [*a, *a]",
        "&a {b: *a}",
        "[&a 1, *a]",
        "? [a, b]",
        "- - - 1",
        "|",
        ">",
    ),
    *(
        "'unclosed",
        '"unclosed',
        "[1, 2",
        "{a: 1",
        "]",
        "}",
        "@x",
        "`x",
        "%x",
        "a: b: c",
        "# no",
        "? :",
    ),
    *(
        "growth_target",
        "moments",
        "function",
        "pressure",
        "constant",
        "all",
        "1 ms",
        "characteristic",
    ),
]
KEYS = [
    *("scene", "variables", "law", "rule", "method", "call", "frames", "start", "target", "value"),
    *("<<", "?", "", "''", "~", "null", "true", "1", "1.5", "2001-12-14", "[a]", "{a: b}", "&a k"),
    *("__class__", "__init__", "model_config", "x" * 3000, '"\\x1b[31m"', '"a.b"', '"\\n"', "é"),
    *("!!python/none ", "*k", "Scene", "scene ", "particels", "grains", "hardness", "title", "ctx"),
]


def bomb(levels):
    """Return a sequence of aliases that doubles nine times at every level."""
    lines = ["&l0 [x, x, x, x, x, x, x, x, x]"]
    for level in range(1, levels):
        lines.append(f"&l{level} [{', '.join([f'*l{level - 1}'] * 9)}]")
    return f"[{', '.join(lines)}]"


def nested(opening, depth):
    """Return brackets within brackets, which may be left open."""
    return opening * depth + "1" + {"[": "]", "{a: ": "}", "- ": ""}[opening] * depth


SCALARS = st.one_of(
    st.sampled_from(NUMBERS),
    st.sampled_from(QUANTITIES),
    st.sampled_from(TEXTS),
    st.builds(bomb, st.integers(2, 12)),
    st.builds(
        nested, st.sampled_from(["[", "{a: ", "- "]), st.sampled_from([2, 9, 12, 200, 20_000])
    ),
    st.integers().map(str),
    st.floats().map(repr),
    st.text(max_size=20).map(json.dumps),
    st.builds(lambda x, unit: f"{x!r} {unit}", st.floats(), st.sampled_from(["m", "Pa", "K", "s"])),
)


def tree_of(data):
    """Return plain data as a tree."""
    if isinstance(data, dict):
        return [[key, tree_of(value)] for key, value in data.items()]
    if isinstance(data, list):
        return tuple(tree_of(value) for value in data)
    return json.dumps(data)


def text_of(tree, indent=0):
    """Return a tree as YAML; mappings in sequences in one line."""
    if isinstance(tree, str):
        return tree
    if isinstance(tree, tuple):
        return f"[{', '.join(_line_of(value) for value in tree)}]"
    pad = "\n" + " " * indent
    return "".join(f"{pad}{key}: {text_of(value, indent + 2)}" for key, value in tree) or "{}"


def _line_of(tree):
    if not isinstance(tree, list):
        return text_of(tree)
    return "{" + ", ".join(f"{key}: {_line_of(value)}" for key, value in tree) + "}"


TREES = [tree_of(YAML(typ="safe", pure=True).load(text)) for text in BASES]


def copied(tree):
    """Return a tree whose mappings can be changed."""
    return [[key, copied(value)] for key, value in tree] if isinstance(tree, list) else tree


def mappings(tree):
    """Return all mappings that are not in a sequence, the outermost first."""
    inner = (mappings(value) for _, value in tree if isinstance(value, list))
    return [tree, *(found for each in inner for found in each)]


def _change_value(draw, entries, i, tree):
    entries[i][1] = draw(SCALARS)


def _move_value(draw, entries, i, tree):
    values = [value for found in mappings(tree) for _, value in found]
    entries[i][1] = copied(draw(st.sampled_from(values)))


def _wrap_value(draw, entries, i, tree):
    value = entries[i][1]
    wrapped = [
        (value,),
        (value, value),
        (value, draw(SCALARS)),
        [[draw(st.sampled_from(KEYS)), value]],
    ]
    entries[i][1] = draw(st.sampled_from(wrapped))


def _rename(draw, entries, i, tree):
    entries[i][0] = draw(st.one_of(st.sampled_from(KEYS), st.text(max_size=9).map(json.dumps)))


def _delete(draw, entries, i, tree):
    del entries[i]


def _repeat(draw, entries, i, tree):
    entries.insert(i, list(entries[i]))


def _insert(draw, entries, i, tree):
    entries.insert(i, [draw(st.sampled_from(KEYS)), draw(SCALARS)])


def _insert_many(draw, entries, i, tree):
    entries += [[f"k{n}", "1"] for n in range(draw(st.sampled_from([30, 200])))]


def _anchor(draw, entries, i, tree):
    if isinstance(entries[i][1], str):
        entries[i][1] = f"&a {entries[i][1]}"
    key = draw(st.sampled_from(["<<", "alias", entries[i][0]]))
    draw(st.sampled_from(mappings(tree))).append([key, draw(st.sampled_from(["*a", "[*a, *a]"]))])


CHANGES = [
    *(_change_value, _change_value, _change_value, _move_value, _wrap_value, _rename, _delete),
    *(_repeat, _insert, _insert_many, _anchor),
]

BYTES = [
    *(b"\xff", b"\xc3\x28", b"\xed\xa0\x80", b"\x00", b"\x1b[31m", b"\x07", b"\x7f", b"\xc2\x85"),
    *(
        b"\xe2\x80\xa8",
        b"\xef\xbb\xbf",
        b"\t",
        b"\r",
        b"\n---\n",
        b"\n...\n",
        b"\n%YAML 9.9\n---\n",
        b"%YAML 1.9\n---\n",
    ),
    *(b"\n\t", b": ", b"- ", b"#", b"&a ", b"*a", b"!!", b"{", b"[", b"'", b'"', b"|\n", b"\\"),
    *(b"\n? a\n: b\n", b"\n<<: *a\n", b"\n%TAG ! !\n---\n", b"\xef\xbf\xbf", b"\xf4\x90\x80\x80"),
]
ENCODINGS = ["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037"]


def _spoilt(draw, content):
    """Return the bytes of a text with one thing done to them."""
    place = draw(st.integers(0, max(0, len(content) - 1)))
    match draw(st.integers(0, 5)):
        case 0:
            return content[:place] + draw(st.sampled_from(BYTES)) + content[place:]
        case 1:
            return content[:place]
        case 2:
            return content.replace(
                b"\n", draw(st.sampled_from([b"\r\n", b"\r", b"\n\t", b"\n\n\n"]))
            )
        case 3:
            return content[:place] + draw(st.binary(max_size=4)) + content[place + 1 :]
        case 4:
            return content + b"\n---\n" + content
        case _:
            return content[:place] + content[place : place + 40] * 30 + content[place:]


@st.composite
def hostile_yaml(draw):
    """Draw the bytes of a campaign file."""
    tree = copied(draw(st.sampled_from(TREES)))
    for _ in range(draw(st.integers(0, 4))):
        entries = draw(st.sampled_from([found for found in mappings(tree) if found] or [[]]))
        if entries:
            i = draw(st.integers(0, len(entries) - 1))
            draw(st.sampled_from(CHANGES))(draw, entries, i, tree)
    text = text_of(tree)
    encoding = draw(st.sampled_from(ENCODINGS)) if draw(st.integers(0, 9)) == 0 else "utf-8"
    content = text.encode(encoding, "replace")
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        content = _spoilt(draw, content)
    return content
