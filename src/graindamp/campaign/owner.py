"""Which campaigns are alive: each holds the lock of a file as long as it runs, and the system lets go when it dies."""

import os
import secrets
import socket
import time
from contextlib import suppress
from pathlib import Path

from graindamp.locks import HAS_LOCKS, lock

_NEW = 60.0


class Owner:
    """A running campaign, by a name that no other ever had.

    Attributes:
        name: host, process and a random number.
    """

    def __init__(self, folder: Path) -> None:
        """Announce a campaign in a folder of lock files.

        Raises:
            OSError: the file cannot be made.
        """
        self.name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / f"{self.name}.lock"
        self._file = self._path.open("w")
        with suppress(OSError):
            lock(self._file, wait=True)

    def leave(self) -> None:
        """Take the announcement back."""
        self._path.unlink(missing_ok=True)
        self._file.close()


def is_dead(name: str, folder: Path) -> bool:
    """Whether a campaign is known to have ended; False if that cannot be told."""
    if not HAS_LOCKS:
        return False
    try:
        with (folder / f"{name}.lock").open("r+") as file:
            lock(file, wait=False)
    except FileNotFoundError:
        return True
    except OSError:  # it holds its lock, or there are no locks here
        return False
    return True


def sweep(folder: Path) -> None:
    """Remove what dead campaigns left; files of the last minute stay, their lock may be on its way."""
    for path in folder.glob("*.lock"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _NEW and is_dead(path.stem, folder):
                path.unlink()
