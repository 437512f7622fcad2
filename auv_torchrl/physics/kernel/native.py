"""Machine code of a program: compiled once on this machine by LLVM and kept in the user's cache folder."""

import ctypes
import hashlib
import logging
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from auv_torchrl.extras import command
from auv_torchrl.files import locked, say_not_kept, write_whole
from auv_torchrl.paths import cache_folder
from auv_torchrl.physics.kernel.assembly import CALLBACK, ENTRY, KEPT, TABLE

log = logging.getLogger(__name__)

CHOICE = "AUV_PHYSICS"  # the environment variable that keeps to numpy where it says so
LEVEL = 2  # of code generation: 3 makes nothing faster, nor do LLVM's passes over what is one straight line

_engines: list[Any] = []  # LLVM frees code with its engine, and stumbles over what others had added to it


class Code:
    """Machine code in memory; called with the address of a table, it runs the table's rows."""

    def __init__(self, engine: Any):
        self._run = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(engine.get_function_address(ENTRY))
        self._table = ctypes.c_void_p.from_address(engine.get_global_value_address(TABLE))
        self._callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(engine.get_function_address(CALLBACK))
        self.kept = ctypes.c_int64.from_address(engine.get_global_value_address(KEPT)).value  # numbers of a row

    def __call__(self, table: int) -> None:
        """Run the table at this address."""
        self._run(table)

    def callback(self, table: int, owner: Any) -> Any:
        """A C function that runs the table at this address at each call, one step further each; one at a time.

        What the table belongs to lives on until there is another one.
        """
        self._table.value, self._owner = table, owner
        return self._callback


def is_wanted() -> bool:
    """Whether compiled code is to run; ``AUV_PHYSICS=numpy`` asks for numpy, at any time."""
    return os.environ.get(CHOICE, "") != "numpy"


def load(name: str, assembled: Callable[[], str]) -> Code | None:
    """The code of a program; None, with a warning, where LLVM does not run.

    Args:
        name: tells it from other programs of the same source.
        assembled: its assembly, worked out only where the cache holds no machine code of it.
    """
    try:
        return _linked(_machine_code(name, assembled))
    except (ImportError, OSError, RuntimeError) as error:
        why = f"llvmlite is not installed: {command('fast')}" if isinstance(error, ImportError) else error
        _say_once(f"the physics runs on numpy: the same numbers, in more than twice the time for a long log: {why}")
        return None


@cache
def _say_once(text: str) -> None:
    log.warning(text)


def _machine_code(name: str, assembled: Callable[[], str]) -> bytes:
    try:
        path = cache_folder() / f"{name}-{_fingerprint()}.o"
        known = _read(path)
        if known is not None:
            return known
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path.with_suffix(".lock"), "compiles the physics"):
            code = _read(path) or _compiled(assembled())
            write_whole(path, hashlib.sha256(code).digest() + code)
    except OSError as error:
        say_not_kept(error.strerror or str(error))
        code = _compiled(assembled())
    return code


def _read(path: Path) -> bytes | None:
    """What was kept; None where nothing was, or where it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, code = content[:32], content[32:]
    return code if code and hashlib.sha256(code).digest() == digest else None


@cache
def _fingerprint() -> str:
    """Tells the physics, this compiler and this machine from others."""
    import llvmlite
    import llvmlite.binding as llvm

    version = hashlib.sha256()
    for path in sorted(Path(__file__).resolve().parents[1].rglob("*.py")):
        version.update(path.read_bytes())
    machine = (llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    version.update(repr((llvmlite.__version__, llvm.llvm_version_info, *machine)).encode())
    return version.hexdigest()[:24]


@cache
def _target() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    features = llvm.get_host_cpu_features().flatten()
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=features, opt=LEVEL, jit=True, codemodel="jitdefault"
    )


def _compiled(text: str) -> bytes:
    import llvmlite.binding as llvm

    machine = _target()
    log.debug("compiling the physics for this machine, once")
    module = llvm.parse_assembly(text)
    module.verify()
    return machine.emit_object(module)


def _linked(code: bytes) -> Code:
    import llvmlite.binding as llvm

    machine = _target()
    library = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)
    for name in ("exp", "sin", "cos", "tanh", "atan2"):  # an unknown one would end the process
        for symbol in (name, f"{name}f"):
            llvm.add_symbol(symbol, ctypes.cast(getattr(library, symbol), ctypes.c_void_p).value)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return Code(engine)
