"""Any signal file to records: the reader is chosen by what the file is, then by what it is called."""

from collections.abc import Sequence
from pathlib import Path

from graindamp.errors import InputError
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec

_FORMAT_OF = {
    ".csv": "text",
    ".txt": "text",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".mat": "mat",
    ".uff": "uff",
    ".unv": "uff",
}
_NAMES_TELL = ChannelsSpec()


def read_records(path: str | Path, channels: ChannelsSpec = _NAMES_TELL, *, is_empty: bool = False) -> list[Record]:
    """Force and motion of every run in a signal file, in SI.

    Args:
        path: .csv or .txt table, .h5 or .hdf5, MATLAB .mat (v4 to v7.3), .uff or .unv (dataset 58). A file whose
            content is plainly another of these is read as what it is.
        channels: which channel is what, where the file's own names and units do not tell.
        is_empty: all runs are of the empty container.

    Raises:
        InputError: the file cannot be opened or is damaged, or does not tell force, motion and sampling rate.
    """
    path = Path(path)
    form = _format_of(path)
    if form == "text":
        from graindamp.signals.readers.text import read_text

        records = read_text(path, channels)
    elif form == "hdf5":
        from graindamp.signals.readers.hdf5 import read_hdf5

        records = read_hdf5(path, channels)
    elif form == "mat":
        from graindamp.signals.readers.mat import read_mat

        records = read_mat(path, channels)
    else:
        from graindamp.signals.readers.uff import read_uff

        records = read_uff(path, channels)
    return [record._replace(is_empty=record.is_empty or is_empty) for record in records]


def once(names: Sequence[str], folder: str | Path = ".") -> None:
    """Pass files that are all different; a record that counts twice would make errors too small.

    Raises:
        InputError: naming the file that is given twice.
    """
    seen: set[Path] = set()
    for name in names:
        path = (Path(folder) / name).resolve()
        if path in seen:
            raise InputError(f"{name}: is given twice; each record counts once")
        seen.add(path)


def _format_of(path: Path) -> str:
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the signal files in it ({_allowed()})")
    form = _FORMAT_OF.get(path.suffix.lower())
    if form is None:
        raise InputError(f"{path}: files ending in '{path.suffix}' are not read; export as one of {_allowed()}")
    try:
        with open(path, "rb") as file:
            start = file.read(1024)
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror})") from None
    if not start:
        raise InputError(f"{path}: is empty (0 bytes); export it again")
    return _format_of_content(start) or form


def _format_of_content(start: bytes) -> str | None:
    """Format that the first bytes of a file prove, or None."""
    if start.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")):
        return "mat"
    if start.startswith(b"\x89HDF\r\n\x1a\n"):
        return "hdf5"
    first_line = start.lstrip(b"\xef\xbb\xbf\0\r\n").splitlines()[:1]
    return "uff" if first_line and first_line[0].rstrip(b" \0") == b"    -1" else None


def _allowed() -> str:
    return ", ".join(_FORMAT_OF)
