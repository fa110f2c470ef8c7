"""Kernels are compiled once: what only kernels call is handed on as intermediate code.

Numba compiles every function that a kernel calls as if Python called it, too: wrapped, optimised,
down to machine code that nobody runs; then all of it again within each caller. Here such a function
stops at LLVM's intermediate code, and is optimised where it ends up. A kernel costs about two
thirds as much to compile, and computes the same bits: only where no operation may be reordered, so
in the mapper. Of several processes that call a kernel first, one compiles it, and the others wait.

This knows numba from the inside, and so leaves other versions than `TESTED` as they are.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any

import numba
from numba.core import caching, codegen, cpu, dispatcher, sigutils
from numba.core.compiler_lock import global_compiler_lock

TESTED = ("0.68",)
_OURS, _EXACT = "eventsweep.", "eventsweep.emvs."
LOOSE = ("eventsweep.emvs.learned.derd_kernels",)
"""Where operations may be joined: how they are depends on when they are optimised."""
_Function = Callable[..., Any]
_Lock = Callable[[str], AbstractContextManager[None]]


class _Inner:
    """In the place of an entry point: of a function that only kernels call.

    Each has its own, for numba finds functions by their entry points.
    """


class _Nesting:
    """How many exact functions are being compiled, one for another; under numba's lock.

    `is_locked`: whether other processes are kept from compiling what is being compiled.
    """

    depth = 0
    is_locked = False

    @contextmanager
    def deeper(self, function: _Function, *, parallel: bool) -> Iterator[None]:
        """One more, if it is exact or for such a one. Loops in parallel need machine code."""
        before = self.depth
        if before or _is_exact(function):
            self.depth = 1 if parallel else before + 1
        try:
            with _no_collection() if self.depth or _is_ours(function) else _as_it_is():
                yield
        finally:
            self.depth = before

    @contextmanager
    def alone(self, lock: AbstractContextManager[None]) -> Iterator[None]:
        """Within the lock, but for what is compiled for a kernel that has one."""
        outer, self.is_locked = self.is_locked, True
        try:
            with _as_it_is() if outer else lock:
                yield
        finally:
            self.is_locked = outer

    @property
    def is_inner(self) -> bool:
        """Whether what is being compiled is for a kernel."""
        return self.depth > 1


_nesting = _Nesting()


def _is_ours(function: _Function) -> bool:
    return (function.__module__ or "").startswith(_OURS)


def _is_exact(function: _Function) -> bool:
    module = function.__module__ or ""
    return module.startswith(_EXACT) and module not in LOOSE


def compile_once(locked: _Lock) -> None:
    """To be called before the first kernel is decorated, and once.

    `locked` keeps other processes from compiling the kernel of a name meanwhile.
    """
    if numba.__version__.rpartition(".")[0] not in TESTED:
        return
    compiler: Any = getattr(dispatcher, "_FunctionCompiler")  # noqa: B009 (unknown to mypy)
    replaced: tuple[tuple[Any, str, Callable[[_Function], _Function]], ...] = (
        (compiler, "_compile_core", _counted),
        (compiler, "_customize_flags", _without_wrappers),
        (codegen.CPUCodeLibrary, "finalize", _linked_only),
        (cpu.CPUContext, "get_executable", _without_entry),
        (dispatcher.Dispatcher, "add_overload", _unknown_to_python),
        (dispatcher.Dispatcher, "compile", partial(_by_one_process, locked)),
        (caching.Cache, "save_overload", _not_stored),
    )
    for owner, name, made in replaced:
        setattr(owner, name, made(getattr(owner, name)))


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keeps Python's collector of cycles from looking, again and again, at what is still in use."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def _as_it_is() -> Iterator[None]:
    yield


def _counted(compile_core: _Function) -> _Function:
    def counted(self: Any, args: Any, return_type: Any) -> Any:
        with _nesting.deeper(self.py_func, parallel=bool(self.targetoptions.get("parallel"))):
            return compile_core(self, args, return_type)

    return counted


def _without_wrappers(customize_flags: _Function) -> _Function:
    def without(self: Any, flags: Any) -> Any:
        flags = customize_flags(self, flags)
        if _nesting.is_inner:
            flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return flags

    return without


def _linked_only(finalize: _Function) -> _Function:
    def linked(self: Any) -> None:
        # Libraries of numba's own, as of its memory, are not cached as objects; their code is run.
        if not (_nesting.is_inner and self._object_caching_enabled):
            finalize(self)
            return
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = self._is_inner = True

    return linked


def _without_entry(get_executable: _Function) -> _Function:
    def entry(self: Any, library: Any, fndesc: Any, env: Any) -> Any:
        library._ensure_finalized()
        if getattr(library, "_is_inner", False):
            return _Inner()
        return get_executable(self, library, fndesc, env)

    return entry


def _unknown_to_python(add_overload: _Function) -> _Function:
    def added(self: Any, result: Any) -> None:
        if isinstance(result.entry_point, _Inner):
            self.overloads[tuple(result.signature.args)] = result
        else:
            add_overload(self, result)

    return added


def _by_one_process(locked: _Lock, compile_: _Function) -> _Function:
    def compiled(self: Any, signature: Any) -> Any:
        normalize: Any = sigutils.normalize_signature
        types = tuple(normalize(signature)[0])
        with global_compiler_lock:
            known = self.overloads.get(types)
            if _nesting.depth or not _is_ours(self.py_func):
                return compile_(self, signature)
            if known is not None and isinstance(known.entry_point, _Inner):
                del self.overloads[types]  # now Python calls it, too
            name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
            with _nesting.alone(locked(name)):
                return compile_(self, signature)

    return compiled


def _not_stored(save_overload: _Function) -> _Function:
    def saved(self: Any, signature: Any, result: Any) -> None:
        if not isinstance(result.entry_point, _Inner):
            save_overload(self, signature, result)

    return saved
