"""Classes that show their users the public names alone: in `dir`, completion and `help`."""

import inspect
from collections.abc import Iterable
from typing import Any

__all__ = ["PublicFace"]


class PublicFace(type):
    """Metaclass of the classes that users meet.

    Public is every name without a leading underscore, apart from those in `internal`, and of those
    in `public`, where that is given, each. `dir` of the
    class and of its objects, and hence completion and `help`, list the public names alone. In
    `help`, signatures have no annotations: an evaluated array type fills several lines, and the
    docstring states the types.

    Parameters
    ----------
    internal : iterable of str, optional
        Names of methods and attributes that only the package's own modules use, beside those of the
        base classes.
    public : iterable of str, optional
        Names that are public; all others of the class are internal.
    constructor : bool, optional
        Whether users call the class. If not, `help` shows no arguments of it.
    """

    _internal: frozenset[str]

    def __new__(
        mcs,
        name: str,
        bases: tuple[type, ...],
        namespace: dict[str, Any],
        *,
        internal: Iterable[str] = (),
        public: Iterable[str] = (),
        constructor: bool = False,
    ) -> "PublicFace":
        """Make the class, with readable signatures."""
        for value in namespace.values():
            function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
            if inspect.isfunction(function):
                function.__signature__ = _plain_signature(function)  # type: ignore[attr-defined]
        if public := set(public):
            internal = {*namespace, *namespace.get("__annotations__", ())} - public
        inherited = [each for base in bases for each in getattr(base, "_internal", ())]
        namespace["_internal"] = frozenset([*internal, *inherited])
        namespace.setdefault("__dir__", _public_names)
        if not constructor:
            namespace["__signature__"] = inspect.Signature()
        return super().__new__(mcs, name, bases, namespace)

    def __init__(cls, name: str, bases: tuple[type, ...], namespace: dict[str, Any], **_: Any):
        super().__init__(name, bases, namespace)

    def __dir__(cls) -> list[str]:
        """Return the public names of the class."""
        return sorted(filter(cls._is_public, super().__dir__()))

    def _is_public(cls, name: str) -> bool:
        return not name.startswith("_") and name not in cls._internal


def _public_names(self: Any) -> list[str]:
    """Return the public names of an object: those of its class, and its attributes."""
    kind: Any = type(self)
    return sorted({*dir(kind), *filter(kind._is_public, vars(self))})


def _plain_signature(function: Any) -> inspect.Signature:
    signature = inspect.signature(function)
    plain = [
        parameter.replace(annotation=inspect.Parameter.empty)
        for parameter in signature.parameters.values()
    ]
    return signature.replace(parameters=plain, return_annotation=inspect.Signature.empty)
