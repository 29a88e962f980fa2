"""Back ends that compute points, under the names that tasks, fields and stores know them by.

The back end is part of what determines a result: a bouncing bed magnifies rounding, so that processor and GPU give two
samples of the same mean, and so do the GPU's two precisions. Points of one never stand in for those of another.
"""

from graindamp.errors import InputError

CPU = "cpu"
"""The processor's engine, double precision."""
CUDA = {"mixed": "cuda-mixed", "double": "cuda-double"}
"""The GPU's, by precision."""
BACKENDS = (CPU, *CUDA.values())
ASKED = ("auto", "cpu", "cuda")
"""What a user asks for."""


class DeviceLost(RuntimeError):
    """The GPU of a worker cannot be used, or has failed: no fault of the points it was computing."""


def is_device(backend: str) -> bool:
    """Whether a back end is a GPU's."""
    return backend != CPU


def precision_of(backend: str) -> str:
    """Precision of a back end, "mixed" or "double"."""
    return next((precision for precision, name in CUDA.items() if name == backend), "double")


def checked(backend: str) -> str:
    """The name, if it is one.

    Raises:
        InputError: no back end of this name.
    """
    if backend not in BACKENDS:
        raise InputError(f"backend is '{backend}'; this version knows {', '.join(BACKENDS)}")
    return backend


def chosen(asked: str, precision: str | None, known: str | None, *, alone: bool) -> str:
    """Name of the back end to compute with.

    Args:
        asked: one of :data:`ASKED`.
        precision: of a GPU, "mixed" or "double"; None: that of the campaign, or else mixed.
        known: back end that the campaign was begun with, None if it is new; "auto" stays with it.
        alone: whether this process computes, so that its GPU counts; "auto" takes it only then.

    Raises:
        InputError: unknown names; a GPU asked for, and none that this process can use.
    """
    if asked not in ASKED:
        raise InputError(f"--backend: given '{asked}'; allowed are {', '.join(ASKED)}")
    if precision is not None and precision not in CUDA:
        raise InputError(f"--precision: given '{precision}'; allowed are {', '.join(CUDA)}")
    if known is not None and is_device(known):
        precision = precision or precision_of(known)
    wanted = CUDA[precision or "mixed"]
    if asked == "auto" and known is not None:
        return wanted if is_device(known) else CPU
    from graindamp.dem.gpu.device import available, require

    if asked == "cpu" or (asked == "auto" and not (alone and available())):
        return CPU
    if alone:
        try:
            require()
        except InputError as error:
            raise InputError(f"--backend {asked}: {error} with --backend cpu") from None
    return wanted
