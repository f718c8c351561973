"""Indices of kernels count from the start of an array, so that no sign needs to be looked at.

As in Python, a negative index counts from the end, and Numba takes three instructions for that at
each access by a number that it cannot foresee: a third of those of a loop over cells. No kernel
wants it, so indices are lowered as the unsigned numbers that they are.
"""

from typing import Any

from numba import types
from numba.core import ir
from numba.core.compiler_machinery import LoweringPass, register_pass


@register_pass(mutates_CFG=False, analysis_only=False)
class UnsignedIndices(LoweringPass):
    """Make the indices of arrays unsigned, where Numba has found them to be signed numbers."""

    _name = "unsigned_indices"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Change the types that calls for an item are made with; return whether any was."""
        changed = False
        for block in state.func_ir.blocks.values():
            for statement in block.body:
                access = statement.value if isinstance(statement, ir.Assign) else statement
                if not _is_access(access):
                    continue
                array, index, *rest = state.calltypes[access].args
                if isinstance(array, types.Array) and unsigned(index) != index:
                    found = state.calltypes.pop(access)  # an entry cannot be overwritten
                    state.calltypes[access] = found.replace(args=(array, unsigned(index), *rest))
                    changed = True
        return changed


def _is_access(access: Any) -> bool:
    getting = isinstance(access, ir.Expr) and access.op == "getitem"
    return getting or isinstance(access, ir.SetItem)


def unsigned(index: Any) -> Any:
    """Return the type of an index without a sign; as it is where it is a literal or a slice."""
    known: Any = index  # Numba's annotations know neither parts nor signs
    if isinstance(index, types.BaseTuple):
        return types.Tuple([unsigned(part) for part in known])
    if isinstance(index, types.Literal) or not isinstance(index, types.Integer):
        return index
    return types.uintp if known.signed else index
