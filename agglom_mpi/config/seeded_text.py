"""The text of a campaign with another seed, all else as its author wrote it."""

import re
from typing import Final

from agglom_mpi.config.yaml_source import CampaignError, parse

KEY: Final = "seed"
_LINE: Final = re.compile(r"^(seed\s*:)[^#\r\n]*?(?=\s*(?:#.*)?$)", re.MULTILINE)


def with_seed(text: str, name: str, seed: int) -> str:
    """Return the text of a campaign in which the seed is replaced, or added where there is none.

    Other lines keep their numbers. What the text says is compared before and after.

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
    changed, found = _LINE.subn(rf"\1 {seed}", text)
    if not found:
        separator = "" if text.endswith("\n") else "\n"
        changed = f"{text}{separator}{KEY}: {seed}\n"
    try:
        if {key: repr(value) for key, value in parse(changed, name).data.items()} == wanted:
            return changed
    except CampaignError:  # of a text in braces, say
        pass
    message = f"cannot be replaced by {seed} here; write it as a line of its own like 'seed: 1'"
    raise CampaignError(source.problem((KEY,), message))
