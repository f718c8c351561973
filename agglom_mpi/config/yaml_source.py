"""The text of a campaign file as plain data that knows its lines, and the error that cites them.

YAML 1.2, in which `1e8` is a number and `no` is a text.
"""

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from agglom_mpi.errors import MissingLibraryError, UserError

Path = tuple[str | int, ...]

# An alias that contains itself, or that doubles at every level, must end in a message.
DEEPEST = 10
LONGEST = 10_000


class Problem(NamedTuple):
    """One thing wrong with a campaign: the file, the line if it has one, the field, the reason."""

    file: str
    line: int | None
    field: str
    message: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        field = f"{self.field}: " if self.field else ""
        return " ".join(f"{place}: {field}{self.message}".split())


class CampaignError(UserError):
    """Everything that is wrong with a campaign, one line per problem, in the order of the file."""

    def __init__(self, *problems: Problem) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__(*self.problems)

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


class MissingSearchLibraryError(CampaignError, MissingLibraryError):
    """A campaign's search needs an optional library that is not installed."""


@dataclass(frozen=True)
class Source:
    """A parsed campaign file."""

    name: str
    data: dict[str, Any]
    lines: dict[Path, int]

    def line(self, path: Path) -> int:
        """Line of an entry, or of the nearest mapping around it."""
        while path not in self.lines:
            path = path[:-1]
        return self.lines[path]

    def value(self, path: Path) -> Any:
        """Value of an entry as it was written."""
        value: Any = self.data
        for part in path:
            value = value[part]
        return value


def read_text(name: str) -> str:
    """Text of the file `name`, which must be UTF-8."""
    try:
        content = FilePath(name).read_bytes()
        if content.startswith(b"\x89HDF"):
            message = "is an HDF5 file, not YAML; agglom report and simulate read it"
            raise CampaignError(Problem(name, None, "", message))
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
    """Read YAML text.

    Parameters
    ----------
    text
        The whole file.
    name
        What errors call the file.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.composer.warn_double_anchors = False  # they are legal
    try:
        root = yaml.compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        raise CampaignError(Problem(name, line, "", f"not valid YAML: {error.problem}")) from None
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"not valid YAML: the character U+{error.character:04X} is not allowed"
        raise CampaignError(Problem(name, line, "", message)) from None
    except RecursionError:
        raise CampaignError(Problem(name, None, "", "is nested too deeply")) from None
    if root is None:
        raise CampaignError(Problem(name, None, "", "is empty; a campaign needs a scene"))
    builder = _Builder(yaml, name)
    if not isinstance(root, MappingNode):
        raise builder.error(root, (), "must be a mapping of sections such as `scene:`")
    return Source(name, builder.build(root, (), root), builder.lines)


class _Builder:
    """Turns nodes into plain data and notes the line of every entry."""

    def __init__(self, yaml: YAML, name: str) -> None:
        self.yaml = yaml
        self.name = name
        self.lines: dict[Path, int] = {}

    def error(self, node: Node, path: Path, message: str) -> CampaignError:
        return CampaignError(
            Problem(self.name, node.start_mark.line + 1, ".".join(map(str, path)), message)
        )

    def build(self, node: Node, path: Path, place: Node) -> Any:
        """Plain data of `node`; `place` is where the file mentions it (its key, not an anchor)."""
        if len(path) > DEEPEST or len(self.lines) > LONGEST:
            raise self.error(place, path[:DEEPEST], "is nested too deeply or too long")
        self.lines[path] = place.start_mark.line + 1
        if isinstance(node, MappingNode):
            return self.mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.build(item, (*path, i), item) for i, item in enumerate(node.value)]
        return self.scalar(node, path)

    def mapping(self, node: MappingNode, path: Path) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self.scalar(key_node, path) if isinstance(key_node, ScalarNode) else None
            if not isinstance(key, str):
                raise self.error(key_node, path, "has a key that is not a word")
            if key in data:
                first = self.lines[*path, key]
                raise self.error(
                    key_node, path, f"duplicate key '{key}'; it is already given in line {first}"
                )
            data[key] = self.build(value_node, (*path, key), key_node)
        return data

    def scalar(self, node: Node, path: Path) -> Any:
        try:
            return self.yaml.constructor.construct_object(node)
        except (YAMLError, ValueError):
            raise self.error(node, path, f"cannot read '{node.value[:40]}'") from None
