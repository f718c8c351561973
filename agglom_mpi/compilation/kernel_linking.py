"""Compile the stages of a kernel to LLVM IR alone, and to machine code once, with the kernel.

Numba makes a library of every compiled function, optimised and emitted as machine code together
with copies of all that it calls. A stage that only kernels call, and that is copied into them, is
never run as a function of its own, so that this work, a third of the time of compilation, is left
out: stages stay as Numba lowers them, and a kernel links those that it reaches, optimises all
together and is emitted.

Numba documents how a pipeline of its own is given to a function, but not its classes of libraries.
With a version other than those tried, `COMPILER` is Numba's own: all works, and takes longer to
compile.
"""

from types import CodeType
from typing import Any, Final

import numba
from numba.core import ir, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

TRIED: Final = ((0, 64), (0, 68))
"""First and last version of Numba that were seen to give the same bits both ways."""


class _WithoutEnvironment:
    """Numba's code generator, for a stage: no machine code refers to an environment of its own."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: Numba would write to the address of a variable that is never emitted."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class StageLibrary(JITCodeLibrary):
    """LLVM IR of one stage, which is neither optimised nor emitted by itself."""

    @property
    def codegen(self) -> Any:
        """Numba's code generator."""
        return _WithoutEnvironment(self._codegen)

    def add_linking_library(self, library: Any) -> None:
        """Add a library that the stage calls."""
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        """End additions."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, as Numba does where there is no wrapper for Python."""
        return 0

    def own_module(self) -> Any:
        """Return the LLVM module of the stage alone."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Return the stage with all that it reaches, for a caller that Numba compiles alone."""
        module = self.own_module().clone()
        for library in callers_first(self._linking_libraries):
            module.link_in(_module_of(library), preserve=True)
        return module


class KernelLibrary(JITCodeLibrary):
    """Machine code of a kernel and of all stages that it reaches."""

    def finalize(self) -> None:
        """Link, optimise and emit."""
        self._codegen._check_llvm_bugs()
        self._raise_if_finalized()
        for library in callers_first(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(_module_of(library), preserve=True)
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()


def _module_of(library: Any) -> Any:
    if isinstance(library, StageLibrary):
        return library.own_module()
    return library._get_module_for_linking()


def callers_first(libraries: list[Any]) -> list[Any]:
    """Return libraries and what stages among them reach, each once and after all its callers.

    LLVM drops a function that no module before has asked for.
    """
    seen: set[Any] = set()
    callees_first: list[Any] = []

    def visit(library: Any) -> None:
        if library not in seen:
            seen.add(library)
            if isinstance(library, StageLibrary):
                for called in library._linking_libraries:
                    visit(called)
            callees_first.append(library)

    for library in reversed(libraries):
        visit(library)
    return callees_first[::-1]


@register_pass(mutates_CFG=False, analysis_only=False)
class ChooseLibrary(LoweringPass):
    """Choose what a function is lowered into: what Python cannot call is a stage."""

    _name = "choose_library"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Make the library; return False, as the function itself is not changed."""
        chosen = StageLibrary if state.flags.no_cpython_wrapper else KernelLibrary
        state.library = chosen(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


@register_pass(mutates_CFG=False, analysis_only=False)
class UnsignedIndices(LoweringPass):
    """Make the indices of arrays unsigned, where Numba has found them to be signed numbers.

    As in Python, a negative index counts from the end, and Numba takes three instructions for that
    at each access by a number that it cannot foresee: a third of those of a loop over cells. No
    kernel wants it.
    """

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


def needless_passes(code: CodeType) -> set[type]:
    """Return passes that would find nothing in a function; they take a twentieth of the time.

    Those are the fusing of expressions of whole arrays, of which kernels have none, and where no
    function is defined within, as by a comprehension, its inlining.
    """
    nested = any(isinstance(constant, CodeType) for constant in code.co_consts)
    return {NopythonRewrites} if nested else {NopythonRewrites, InlineClosureLikes}


class LinkingCompiler(CompilerBase):
    """Numba's compiler, in nopython mode, into libraries of this module."""

    def define_pipelines(self) -> list[Any]:
        """Return Numba's own pipeline with two more passes, and without those that find nothing."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        needless = needless_passes(self.state.func_id.func.__code__)
        passes.passes = [(step, name) for step, name in passes.passes if step not in needless]
        passes.add_pass_after(UnsignedIndices, AnnotateTypes)
        passes.add_pass_after(ChooseLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


def choose_compiler(version: tuple[int, int]) -> type[CompilerBase]:
    """Return the compiler of kernels for a version of Numba, as `(0, 68)`."""
    return LinkingCompiler if TRIED[0] <= version <= TRIED[1] else Compiler


COMPILER: Final = choose_compiler(numba.version_info.short)
"""The compiler of all kernels and stages, as `pipeline_class` of `numba.njit`."""
