"""The text of a campaign with another seed, all else as its author wrote it."""

from collections.abc import Iterator
from typing import Final

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode

from agglom_mpi.config.yaml_source import CampaignError, parse

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
