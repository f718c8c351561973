"""YAML text of a campaign as plain data with line numbers, and the errors that cite them.

YAML 1.2, in which `1e8` is a number and `no` is a text.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.scanner import Scanner

from agglom_mpi.declaration.declared import FieldError, FieldPath
from agglom_mpi.errors import MissingLibraryError, UserError
from agglom_mpi.file_kinds import (
    HDF5_IS_NO_YAML,
    SIGNATURE,
    begins_as_hdf5,
    clipped,
    quoted_start,
    read_bounded,
)
from agglom_mpi.formatting import pluralise

# Limits, so that an alias that contains itself or doubles at every level ends in a message, and
# brackets within brackets, which take the parser minutes.
MAX_DEPTH = 10
MAX_ENTRIES = 10_000
TOO_LARGE: Final = "is nested too deeply or too long"

MAX_LINE: Final = 500
"""Longest text of a problem in characters: keys may be as long as the file."""
MAX_PROBLEMS: Final = 20
"""Problems of a campaign that are shown; the others are counted."""


class Problem(NamedTuple):
    """One thing wrong with a campaign: file, line if known, field, and message."""

    file: str
    line: int | None
    field: str
    message: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        field = f"{self.field}: " if self.field else ""
        line = " ".join(f"{place}: {field}{self.message}".split())
        return line if len(line) <= MAX_LINE else f"{line[: MAX_LINE - 3]}..."


class CampaignError(UserError):
    """All problems of a campaign, one line each, the first of them, in the order of the file."""

    def __init__(self, *problems: Problem) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__(*self.problems)

    def __str__(self) -> str:
        lines = [str(problem) for problem in self.problems[:MAX_PROBLEMS]]
        if more := self.problems[MAX_PROBLEMS:]:
            lines.append(f"{more[0].file}: {pluralise(len(more), 'more problem')}")
        return "\n".join(lines)


class ArgumentError(CampaignError, ValueError):
    """A wrong argument of a method, named as a wrong entry of a campaign is."""

    @classmethod
    def of(cls, file: object, field: str, message: object) -> "ArgumentError":
        """Return the error about the argument `field` of what comes from `file`."""
        return cls(Problem(str(file), None, field, str(message)))


def warn(problems: Sequence[Problem], strict: bool, show: Callable[[str], None]) -> None:
    """Show each problem as a line that begins with `warning:`; if strict, raise a CampaignError."""
    if strict and problems:
        raise CampaignError(*problems)
    for problem in problems:
        show(f"warning: {problem}")


class MissingSearchLibraryError(CampaignError, MissingLibraryError):
    """A campaign's search needs an optional library that is not installed."""


@dataclass(frozen=True)
class Source:
    """A parsed campaign file: its name, plain data, and the line of every entry."""

    name: str
    data: dict[str, Any]
    lines: dict[FieldPath, int]

    def line(self, path: FieldPath) -> int:
        """Return the line of an entry, or of the nearest mapping around it."""
        while path not in self.lines:
            path = path[:-1]
        return self.lines[path]

    def problem(self, path: FieldPath, message: str) -> Problem:
        """Return what is wrong with an entry, with its line; `message` follows the field."""
        return Problem(self.name, self.line(path), ".".join(map(str, path)), message)

    def error(
        self, found: FieldError, needs: Mapping[FieldPath, str] | None = None
    ) -> CampaignError:
        """Return the CampaignError of fields; `needs` says why some that are missing are needed."""
        problems = []
        for path, message in found.problems:
            reason = (needs or {}).get(path) if path not in self.lines else None
            problems.append(self.problem(path, "; ".join(filter(None, [message, reason]))))
        return CampaignError(*problems)

    def value(self, path: FieldPath) -> Any:
        """Return the value of an entry as it was written."""
        value: Any = self.data
        for part in path:
            value = value[part]
        return value


MAX_BYTES: Final = 1 << 20
"""Largest size of a campaign's text; YAML of this size takes a second or two to parse."""


def read_text(name: str) -> str:
    """Return the text of the file `name`; raise a CampaignError if it cannot be read as UTF-8."""
    try:
        if begins_as_hdf5(name):  # asked first: it is mostly larger than a text may be
            raise CampaignError(Problem(name, None, "", HDF5_IS_NO_YAML))
        content = read_bounded(name, MAX_BYTES)
        if content.startswith(SIGNATURE):  # from a pipe
            raise CampaignError(Problem(name, None, "", HDF5_IS_NO_YAML))
        return content.decode("utf-8-sig")
    except FileNotFoundError:
        message = "no such file"
    except IsADirectoryError:
        message = "is a directory; a campaign is one YAML file"
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        byte = error.object[error.start]
        raise CampaignError(
            Problem(name, line, "", f"is not UTF-8 text: byte 0x{byte:02x}")
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise CampaignError(Problem(name, None, "", message))


def parse(text: str, name: str) -> Source:
    """Return the parsed YAML text of a campaign; raise a CampaignError if it is not a mapping.

    Parameters
    ----------
    text
        Text of the file.
    name
        Name of the file in errors.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Scanner, yaml.Composer = _BoundedScanner, _BoundedComposer
    yaml.composer.warn_double_anchors = False  # they are legal
    try:
        root = yaml.compose(text)
    except _TooLargeError as error:
        raise CampaignError(Problem(name, error.line, "", TOO_LARGE)) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        raise CampaignError(
            Problem(name, line, "", f"not valid YAML: {clipped(error.problem)}")
        ) from None
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"not valid YAML: the character U+{error.character:04X} is not allowed"
        raise CampaignError(Problem(name, line, "", message)) from None
    except (AssertionError, KeyError):  # for versions it does not know
        message = "not valid YAML, or of another version than 1.2"
        raise CampaignError(Problem(name, None, "", message)) from None
    if root is None:
        raise CampaignError(Problem(name, None, "", "is empty; a campaign needs a scene"))
    builder = _Builder(yaml, name)
    if not isinstance(root, MappingNode):
        found = "a list" if isinstance(root, SequenceNode) else "one text"
        raise builder.error(root, (), f"is {found}; must be a mapping of sections such as `scene:`")
    return Source(name, builder.build(root, (), root), builder.lines)


class _TooLargeError(Exception):
    """The text has too many entries, or too deep ones; the first beyond is in `line`."""

    def __init__(self, line: int) -> None:
        super().__init__(line)
        self.line = line


class _BoundedScanner(Scanner):
    """Scanner that stops at brackets within too many brackets.

    It looks ahead, and for every token at all brackets that are open.
    """

    def fetch_flow_collection_start(self, *arguments: Any, **options: Any) -> None:
        if self.flow_level > MAX_DEPTH:
            raise _TooLargeError(self.reader.line + 1)
        super().fetch_flow_collection_start(*arguments, **options)


class _BoundedComposer(Composer):
    """Composer that stops at the limits, before the rest of the text is parsed."""

    _entries = _level = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._entries += 1
        self._level += 1
        if self._level > MAX_DEPTH + 1 or self._entries > 2 * MAX_ENTRIES:  # keys and values
            raise _TooLargeError(self.parser.peek_event().start_mark.line + 1)
        node = super().compose_node(parent, index)
        self._level -= 1
        return node


class _Builder:
    """Converts YAML nodes to plain data and records the line of every entry."""

    def __init__(self, yaml: YAML, name: str) -> None:
        self.yaml = yaml
        self.name = name
        self.lines: dict[FieldPath, int] = {}

    def error(self, node: Node, path: FieldPath, message: str) -> CampaignError:
        return CampaignError(
            Problem(self.name, node.start_mark.line + 1, ".".join(map(str, path)), message)
        )

    def build(self, node: Node, path: FieldPath, place: Node) -> Any:
        """Return the data of `node`; `place` is the node whose line counts (its key, no anchor)."""
        if len(path) > MAX_DEPTH or len(self.lines) > MAX_ENTRIES:
            raise self.error(place, path[:MAX_DEPTH], TOO_LARGE)
        self.lines[path] = place.start_mark.line + 1
        if isinstance(node, MappingNode):
            return self.mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.build(item, (*path, i), item) for i, item in enumerate(node.value)]
        return self.scalar(node, path)

    def mapping(self, node: MappingNode, path: FieldPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self.scalar(key_node, path) if isinstance(key_node, ScalarNode) else None
            if not isinstance(key, str):
                raise self.error(key_node, path, "has a key that is not a word")
            if key in data:
                first = self.lines[*path, key]
                raise self.error(
                    key_node,
                    path,
                    f"duplicate key {quoted_start(key)}; it is already given in line {first}",
                )
            data[key] = self.build(value_node, (*path, key), key_node)
        return data

    def scalar(self, node: Node, path: FieldPath) -> Any:
        try:
            return self.yaml.constructor.construct_object(node)
        except (YAMLError, LookupError, ValueError):
            raise self.error(node, path, f"cannot read {quoted_start(node.value)}") from None


KEY: Final = "seed"


def with_seed(text: str, name: str, seed: int) -> str:
    """Return the text of a campaign in which the seed is replaced, or added where there is none.

    Other lines keep their numbers where possible. What the text says is compared before and after.

    Parameters
    ----------
    text
        Valid YAML, a mapping.
    name
        Name of the file in errors.
    seed

    Raises
    ------
    CampaignError
        If the seed cannot be replaced alone, as where it is an alias.
    """
    source = parse(text, name)
    wanted = {key: repr(value) for key, value in source.data.items()} | {KEY: repr(seed)}
    for candidate in _candidates(text, seed):
        try:
            found = parse(candidate, name).data
        except CampaignError:
            continue
        if {key: repr(value) for key, value in found.items()} == wanted:
            return candidate
    message = f"cannot be replaced by {seed} here; write it as a line of its own like 'seed: 1'"
    raise CampaignError(source.problem((KEY,), message))


def _candidates(text: str, seed: int) -> Iterator[str]:
    """Yield texts that may be what is wanted, the best first."""
    root = YAML(typ="safe", pure=True).compose(text)
    assert isinstance(root, MappingNode)
    for key, value in root.value:
        if key.value == KEY:
            begin, end = value.start_mark.index, value.end_mark.index
            yield f"{text[:begin]}{seed}{text[end:]}"
            if not value.value:  # `seed:` alone
                colon = text.find(":", key.end_mark.index) + 1
                yield f"{text[:colon]} {seed}{text[colon:]}"
            return
    first = root.value[0][0].start_mark
    indent = " " * first.column
    before, after = text[: first.index], text[first.index :]
    if root.flow_style:
        yield f"{before}{KEY}: {seed}, {after}"
        return
    separator = "" if text.endswith("\n") else "\n"
    yield f"{text}{separator}{indent}{KEY}: {seed}\n"
    yield f"{before}{KEY}: {seed}\n{indent}{after}"
