"""Modules of a user's, from their text, as the package executes them."""

import linecache
import sys
from types import ModuleType


def module_of(text, file="own.py"):
    """Execute the text of a module that is not part of the package, and return the module."""
    name = f"own_module_{abs(hash(text))}"
    module = ModuleType(name)
    sys.modules[name] = module
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    exec(compile(text, file, "exec", dont_inherit=True), module.__dict__)
    return module


def line_of(text, part):
    """Return the number of the first line that has a part."""
    return next(i for i, line in enumerate(text.splitlines(), 1) if part in line)
