"""Which variables the strings of a campaign file have, as an attribute of the file states it."""

import json
import re
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

from agglom_mpi.variables import MAX_VARIABLE_NAME, TEN, Variable, VariableTable

FURTHER_VARIABLES: Final = "further_variables"
"""Attribute with name, unit and meaning of the variables beside those of the papers, as JSON.

Files of campaigns without any lack it.
"""


def variable_attributes(variables: VariableTable) -> dict[str, str]:
    """Return the attributes that say which variables the strings of a file have."""
    further = [[each.name, each.unit, each.meaning] for each in variables.further]
    return {FURTHER_VARIABLES: json.dumps(further)} if further else {}


def variables_of(attributes: Mapping[str, Any]) -> VariableTable:
    """Return the variables of the strings of a file with these attributes."""
    text = attributes.get(FURTHER_VARIABLES)
    return TEN if text is None else _variables_of(text)


@cache
def _variables_of(text: str) -> VariableTable:
    """Return the table of an attribute; raises ValueError if it is no such text."""
    found = json.loads(text)
    if not isinstance(found, list) or not found:
        raise ValueError(f"attribute {FURTHER_VARIABLES} is no list")
    for each in found:
        if not isinstance(each, list) or [type(part) for part in each] != [str] * 3:
            raise ValueError(f"attribute {FURTHER_VARIABLES} has an entry without name and unit")
        if not _PATH.fullmatch(each[0]):
            raise ValueError(f"attribute {FURTHER_VARIABLES} has a name that no variable has")
    return VariableTable(Variable(name, unit, name, meaning) for name, unit, meaning in found)


_PATH: Final = re.compile(rf"(?=.{{1,{MAX_VARIABLE_NAME}}}$)[A-Za-z]\w*(\.\w+)*", re.ASCII)
