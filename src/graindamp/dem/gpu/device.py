"""Functions of the engine, compiled for CUDA in a chosen precision without a second copy of their source.

A function is built anew with other globals: functions that it calls are built likewise, the name REAL becomes the
working type, and names of :class:`Variant` become constants that the compiler folds. In bodies of working precision the
literals are of the working type too, because a bare 0.5 would promote single precision to double."""

import ctypes
import importlib.util
import math
import os
import sys
import threading
from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from graindamp.errors import InputError

Body = TypeVar("Body", bound=Callable[..., Any])

WORKING_MODULES = ("graindamp.dem.laws", "graindamp.dem.springs")
"""Modules of the processor's engine whose functions work in the precision of the forces; all others in double."""

CALLED_MODULES = (
    "graindamp.dem.walls",
    "graindamp.dem.motion",
    "graindamp.dem.grip",
    "graindamp.dem.energy",
    "graindamp.dem.gpu.block",
    "graindamp.dem.gpu.verdict",
)
"""Modules whose functions the compiler may call rather than weave into their callers: they are long or rarely run, and
take few arguments."""

SMALLEST_SINGLE = 1e-30
"""What stands in single precision for guards such as 1e-300."""

MISSING = 'the GPU back end needs numba-cuda; install it with: pip install "graindamp[gpu]", or use the CPU back end'


REAL = np.float64
"""In bodies: the working type. These are constants of the :class:`Variant` that a body is built for."""
THREADS = 256
TEAMS = False
WITH_SPRINGS = True
WITH_ROLLING = True


class Variant(NamedTuple):
    """What a set of kernels is compiled for. Every field is a constant of the compiled code."""

    real: type = np.float64
    """Working type of velocities at contacts, spins, forces and contact memory."""
    threads: int = 256
    """Most threads of a block; a block is a world, and launched with this or a smaller power of two."""
    springs: bool = True
    """Whether some world has a tangential law with memory."""
    rolling: bool = True
    """Whether some world has rolling resistance."""
    teams: bool = False
    """Whether several blocks share a world: those of the launch over the slots. All must find room on the device at
    once, or the launch never ends."""
    fast: bool = False
    """Approximate division and square root in single precision."""
    registers: int = 0
    """Largest number of registers of a thread; 0: as the compiler likes."""

    def constants(self) -> dict[str, Any]:
        """Names in bodies and what stands in their place."""
        return {
            "REAL": self.real,
            "THREADS": self.threads,
            "TEAMS": self.teams,
            "WITH_SPRINGS": self.springs,
            "WITH_ROLLING": self.rolling,
        }


def working(body: Body) -> Body:
    """Mark a body whose literals are of the working type."""
    body.__dict__["literals"] = "working"
    return body


def stay_apart() -> None:
    """In a body that is long and seldom run: the compiler shall call it, not weave it into its caller, whose registers
    it would take."""


def _apart() -> Any:
    """What stands for :func:`stay_apart` in compiled bodies."""
    from numba import types
    from numba.cuda.extending import intrinsic

    def stays(typing: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            builder.function.attributes.add("noinline")
            return context.get_dummy_value()

        return types.none(), code

    return intrinsic(stays)


def simulated() -> bool:
    """Whether kernels run in numba's simulator, in plain Python and without a GPU."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") == "1"


def require(gpu: bool = True) -> None:
    """Make sure that kernels can be compiled and, unless `gpu` is False, run.

    Raises:
        InputError: numba-cuda is not installed, or there is no GPU that it can use.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise InputError(MISSING)
    from numba import cuda

    if gpu and not simulated() and not cuda.is_available():
        raise InputError(
            "no GPU that CUDA can use was found; check that nvidia-smi lists it and that its driver is new enough, "
            "or use the CPU back end"
        )


def available() -> bool:
    """Whether the back end and a GPU for it are there; numba's simulator is none.

    Where there is no GPU this takes no time: CUDA's driver is asked before numba-cuda is loaded.
    """
    if simulated() or importlib.util.find_spec("numba_cuda") is None or not _devices_of_driver():
        return False
    from numba import cuda

    return bool(cuda.is_available())


def _devices_of_driver() -> int:
    """GPUs that CUDA's driver lists [-]; 0 without a driver."""
    try:
        driver = ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
    except OSError:
        return 0
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return 0
    return count.value


class _SimulatedCuda:
    """Stands for the module `cuda` in bodies that the simulator runs as plain Python."""

    def __getattr__(self, name: str) -> Any:
        from numba.cuda.simulator.kernel import _get_kernel_context

        context = _get_kernel_context()
        return _SimulatedShared(context) if name == "shared" else getattr(context, name)


class _SimulatedShared:
    """Shared arrays, one per line of the kernel. The simulator's own are sometimes made twice, where two threads ask at
    the same time."""

    lock = threading.Lock()

    def __init__(self, context: Any) -> None:
        self.context = context

    def array(self, shape: Any, dtype: Any) -> Any:
        """The array of the line that asks."""
        with self.lock:
            known = self.context.__dict__.setdefault("shared_arrays", {})
            return known.setdefault(sys._getframe(1).f_lineno, np.zeros(shape, dtype))


class Builder:
    """Builds device functions and kernels of one variant; each function once."""

    def __init__(self, variant: Variant) -> None:
        """A builder that has built nothing yet."""
        self.variant = variant
        self.built: dict[Any, Any] = {}

    def kernel(self, body: Callable[..., None]) -> Any:
        """The body as a kernel, to be launched as kernel[blocks, threads](...). The compiler may use as many registers
        as blocks of `Variant.threads` threads leave."""
        from numba import cuda

        options: dict[str, Any] = {"fastmath": self.variant.fast}
        if not simulated():
            options["launch_bounds"] = self.variant.threads
            if self.variant.registers:
                options["max_registers"] = self.variant.registers
        return cuda.jit(**options)(self.plain(body))

    def device(self, body: Callable[..., Any]) -> Any:
        """The body as a function that kernels can call."""
        if body not in self.built:
            plain = self.plain(body)
            if simulated():
                self.built[body] = plain
            else:
                from numba import cuda

                woven = body.__module__ in WORKING_MODULES or body.__module__ not in CALLED_MODULES
                options: dict[str, Any] = {"device": True, "forceinline": woven, "fastmath": self.variant.fast}
                self.built[body] = cuda.jit(**options)(plain)
        return self.built[body]

    def plain(self, body: Callable[..., Any]) -> FunctionType:
        """The body with literals and globals of this variant, still Python."""
        assert isinstance(body, FunctionType)
        code, given = body.__code__, body.__globals__
        single = self.variant.real is not np.float64 and (
            getattr(body, "literals", "") == "working" or body.__module__ in WORKING_MODULES
        )
        constants = self.variant.constants()
        names: dict[str, Any] = {"__builtins__": given["__builtins__"], "__name__": body.__module__}
        for name in code.co_names:
            if name in constants:
                names[name] = constants[name]
            elif name in given:
                names[name] = self._globally(given[name], single)
        if single:
            code = code.replace(co_consts=tuple(self._literal(value) for value in code.co_consts))
        return FunctionType(code, names, body.__name__, body.__defaults__)

    def _globally(self, value: Any, single: bool) -> Any:
        if value is stay_apart and not simulated():
            return _apart()
        if hasattr(value, "py_func"):
            return self.device(value.py_func)
        if isinstance(value, FunctionType):
            return self.device(value)
        if isinstance(value, ModuleType) and value.__name__ == "numba.cuda":
            return _SimulatedCuda() if simulated() else value
        return self._literal(value) if single else value

    def _literal(self, value: Any) -> Any:
        """A literal, or a tuple of them, in the working type. Guards against division by zero that would vanish there
        become ones that do not, and whose reciprocal does not overflow either."""
        if type(value) is tuple:
            return tuple(self._literal(one) for one in value)
        if type(value) is not float:
            return value
        vanishes = 0.0 < abs(value) < float(np.finfo(self.variant.real).tiny)
        return self.variant.real(math.copysign(SMALLEST_SINGLE, value) if vanishes else value)
