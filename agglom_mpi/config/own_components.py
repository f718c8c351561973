"""Components of one's own: their modules, read beside the campaign that names them."""

from keyword import iskeyword
from pathlib import Path
from typing import Any, Final

from agglom_mpi.config.user_function import read_source
from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.declaration.reading import OWN_NAME, OwnComponents
from agglom_mpi.declaration.units import quoted

ONLY_ALLOWED: Final = (
    "Python code, which runs only with your permission: --allow-code, or "
    "load_campaign(..., allow_code=True)"
)
"""What is said of code that may not run."""


def read_own_name(name: str) -> tuple[str, str]:
    """Return file and class of a name `FILE.py:Class`; raise a ValueError for another form."""
    found = OWN_NAME.fullmatch(name)
    if found is None or any(map(iskeyword, found.groups())):
        raise ValueError(f"is {quoted(name)}; must be FILE.py:Class, of a file beside the campaign")
    return f"{found[1]}.py", found[2]


class BesideCampaign(OwnComponents):
    """Classes of the modules in the folder of a campaign; each module is read once.

    Parameters
    ----------
    folder
        The folder.
    allow_code
        Whether the modules may be executed.
    """

    def __init__(self, folder: Path, allow_code: bool) -> None:
        self._folder = folder
        self._allow_code = allow_code
        self._modules: dict[str, OwnModule] = {}

    def find(self, name: str) -> type[Any]:
        """Return the class `FILE.py:Class`; see `OwnComponents.find`."""
        file, own_class = read_own_name(name)
        if not self._allow_code:
            raise ValueError(f"is {quoted(name)}, {ONLY_ALLOWED}")
        if file not in self._modules:
            self._modules[file] = OwnModule.of(file, read_source(self._folder / file, name))
        try:
            return class_in(self._modules[file], own_class)
        except ValueError as error:
            raise ValueError(f"is {quoted(name)}, but {error}") from error.__cause__
