"""Components of one's own: their modules, read beside the campaign or as its file records them."""

import base64
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.config.user_function import read_source
from agglom_mpi.declaration.components import Component, components_within
from agglom_mpi.declaration.own_modules import OwnModule, class_in, executed
from agglom_mpi.declaration.reading import (
    OWN_COMPONENTS,
    OWN_MODULES,
    OWN_NAME,
    OWN_SHA256,
    SOURCE_SHA256,
    OwnComponents,
    own_names,
    values_in,
)
from agglom_mpi.declaration.units import quoted
from agglom_mpi.errors import CodeNotAllowedError

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.document import SceneDocument

ONLY_ALLOWED: Final = (
    "Python code, which runs only with your permission: --allow-code, or "
    "load_campaign(..., allow_code=True)"
)
"""Reason why code does not run, for messages."""


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
        self._failed: dict[str, str] = {}  # by file, the name that its error is reported at

    def find(self, name: str, kind: type[Any]) -> type[Any]:
        """Return the class `FILE.py:Class`; see `OwnComponents.find`."""
        file, own_class = read_own_name(name)
        if not self._allow_code:
            raise ValueError(f"is {quoted(name)}, {ONLY_ALLOWED}")
        if self._failed.get(file, name) != name:
            raise ValueError(f"is {quoted(name)}; see {self._failed[file]} on {file}")
        try:
            if file not in self._modules:
                self._modules[file] = OwnModule.of(
                    file, read_source(self._folder / file, name), self._folder
                )
            executed(self._modules[file])
        except ValueError as error:
            self._failed[file] = name
            raise ValueError(_but(name, error)) from error.__cause__
        try:
            return class_in(self._modules[file], own_class)
        except ValueError as error:
            raise ValueError(_but(name, error)) from error.__cause__


def _but(name: str, error: ValueError) -> str:
    """Return an error about a module as one about the name that a campaign has of it."""
    start, text = f"is {quoted(name)}", str(error)
    return text if text.startswith(start) else f"{start}, but {text}"


def recorded_texts(campaign: "Campaign") -> dict[str, str]:
    """Return what the file of a campaign records of code of one's own; empty without any.

    That is the modules of components and of a function of means: what rests on that is not stored,
    as what a function of samples returned is.
    """
    owned = (component.own for component in own_of(campaign))
    modules = {own.file: own for own in owned if own is not None}
    function = campaign.user_function
    if campaign.objective.code_of_means and function is not None and function.module.source:
        modules.setdefault(function.module.file, function.module)
    if not modules:
        return {}
    sources = [
        {"file": own.file, "sha256": own.sha256, **_as_text(own.source)} for own in modules.values()
    ]
    texts = {OWN_MODULES: json.dumps(sources)}
    return texts | {OWN_SHA256: _digest(texts)}


def _digest(texts: Mapping[str, Any]) -> str:
    """Return the digest of what a file records of code of one's own.

    Files of earlier versions have a description of its classes, too.
    """
    both = "".join(str(texts.get(name, "")) for name in (OWN_MODULES, OWN_COMPONENTS))
    return hashlib.sha256(both.encode()).hexdigest()


def record_faults(texts: Mapping[str, Any], identity: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is wrong with what the attributes of a file record of code of one's own."""
    named = [f"{key}.{SOURCE_SHA256}" for key in own_names(identity)]
    names = {OWN_MODULES, OWN_SHA256}
    if not named and not names.intersection(texts):
        return
    if absent := sorted(names.difference(texts)):
        yield f"attributes: no {' and no '.join(absent)}, though the campaign has code of its own"
    elif texts[OWN_SHA256] != _digest(texts):
        recorded = " and ".join(name for name in (OWN_MODULES, OWN_COMPONENTS) if name in texts)
        yield f"attributes: {recorded} without the digest {OWN_SHA256}"
    else:
        try:
            kept = {each.sha256 for each in _modules(texts)}
        except ValueError as error:
            yield f"attributes: {error}"
            return
        for key in named:
            if identity.get(key) not in kept:
                yield f"attributes: {OWN_MODULES} has no source with the digest {key}"


def own_of(campaign: "Campaign | SceneDocument") -> Iterator[Component]:
    """Yield the components of one's own that a campaign names, or its file."""
    sections = [campaign.objective, *(campaign.plan or ())]
    sections += [getattr(campaign.scene, key) for key in type(campaign.scene).model_fields]
    for section in sections:
        if isinstance(section, Component):
            yield from (own for _, own in components_within(section) if own.own is not None)


def permitted_modules(campaign: "Campaign") -> frozenset[tuple[str, str]]:
    """Return file and digest of the modules that a campaign names, and that may be executed."""
    found = (component.own for component in own_of(campaign))
    modules = {(own.file, own.sha256) for own in found if own is not None}
    function = campaign.user_function
    if function is not None and function.module.source:
        modules.add(function.module[:2])
    return frozenset(modules)


def _as_text(source: bytes) -> dict[str, str]:
    """Return a source as text, or where it is not in UTF-8 by base64."""
    try:
        return {"source": source.decode()}
    except UnicodeDecodeError:
        return {"base64": base64.b64encode(source).decode()}


def recorded_module(texts: Mapping[str, Any], file: str) -> OwnModule | None:
    """Return a module that the attributes of a file record, by its file name; None without it.

    Raises
    ------
    ValueError
        If the attributes are damaged.
    """
    return next((each for each in _modules(texts) if each.file == file), None)


def _modules(texts: Mapping[str, Any]) -> list[OwnModule]:
    """Return the modules that the attributes of a file record; raise a ValueError if damaged."""
    try:
        return [
            OwnModule.of(
                str(each["file"]),
                each["source"].encode() if "source" in each else base64.b64decode(each["base64"]),
            )
            for each in json.loads(texts.get(OWN_MODULES, "[]"))
        ]
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError):
        raise ValueError("the file's sources of own components are damaged") from None


def recorded_source(texts: Mapping[str, Any], file: str, sha256: str) -> bytes | None:
    """Return the recorded source of a module if it has this digest; otherwise None."""
    try:
        own = recorded_module(texts, file)
    except ValueError:
        return None
    return own.source if own is not None and own.sha256 == sha256 else None


class RecordedModules(OwnComponents):
    """Classes of the modules that a file records and that may be executed.

    Parameters
    ----------
    texts
        Attributes of the file.
    identity
        Identity of its campaign, which has the digests of the modules.
    may_run
        Whether a module may be executed, by its file name and digest.
    folder
        Folder of the file.
    """

    def __init__(
        self,
        texts: Mapping[str, Any],
        identity: Mapping[str, Any],
        may_run: Callable[[str, str], bool],
        folder: Path,
    ) -> None:
        self._texts, self._may_run = texts, may_run
        end = f".{SOURCE_SHA256}"
        sections = {v: k.removesuffix(end) for k, v in identity.items() if k.endswith(end)}
        self._values = {digest: values_in(identity, each) for digest, each in sections.items()}
        self._folder = folder

    def find(self, name: str, kind: type[Any]) -> type[Any]:
        """Return the class `FILE.py:Class`; see `OwnComponents.find`."""
        file, own_class = read_own_name(name)
        own = recorded_module(self._texts, file)
        if own is None or own.sha256 not in self._values:
            message = "of which the file has no source with the same digest"
            raise ValueError(f"is {quoted(name)}, {message}")
        if not self._may_run(own.file, own.sha256):  # the text may name others than the identity
            raise CodeNotAllowedError(f"{name} is code of one's own; --allow-code runs it")
        own = OwnModule.of(file, own.source, self._folder)
        return class_in(own._replace(values=self._values[own.sha256]), own_class)
