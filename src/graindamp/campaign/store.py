"""Where the results of campaigns are kept: a folder with an index and one file per operating point.

    STORE/index.sqlite        what is queued, running, done, failed
    STORE/points/ab/<key>.h5  one result each, under the hash of all that determines it
    STORE/fields/<name>.json  descriptions of the fields that were asked for
    STORE/owners/             one locked file per running campaign, and one for opening the index

The point files are the truth about what is done. The index may be lost, and any number of campaigns on one computer
may work on the same store.
"""

import errno
import os
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from graindamp.campaign.index import Entry, Index, IndexDamaged, StoreFull, full_message
from graindamp.campaign.owner import Owner, is_dead, sweep
from graindamp.campaign.point import PointResult, PointTask
from graindamp.campaign.point_file import DamagedPoint, read_point, write_point
from graindamp.errors import InputError
from graindamp.locks import alone

LEASE = 120.0
"""Seconds without a sign of life after which the points of a campaign may be taken over."""
BEAT = 15.0
"""Seconds between signs of life."""
LAST_BEAT = 5.0
"""Seconds that the end of a campaign waits for its last sign of life, so that nothing is open afterwards."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_OLD_DRAFT = 600.0
_PARTS = ("points", "fields", "owners", "index.sqlite")


class Store:
    """Results and states of operating points; as a context manager it is closed at the end.

    Attributes:
        folder: where it is.
        warnings: what was found damaged and dealt with, in words.
    """

    def __init__(self, folder: Path, *, create: bool = True) -> None:
        """Open a store.

        Args:
            folder: where it is, or is to be.
            create: make it where there is none.

        Raises:
            InputError: not a store, of another version, locked, or the folder cannot be used.
            StoreFull: no room.
        """
        self.folder = folder
        self.warnings: list[str] = []
        self._owner: Owner | None = None
        self._beating: threading.Thread | None = None
        self._stop = threading.Event()
        self._find(create)
        with alone(folder / "owners" / "opening"):  # SQLite does not wait where two make one file a WAL database
            self._index = self._open_index()
        try:
            self._reconcile()
        except BaseException:
            self._index.close()
            raise

    def __enter__(self) -> "Store":
        """The store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Queue again what this campaign was running, and close the index."""
        self._stop.set()
        if self._owner is not None:
            with suppress(InputError):
                self._index.release(self._owner.name)
            self._owner.leave()
            self._owner = None
        if self._beating is not None:
            self._beating.join(LAST_BEAT)
        self._index.close()

    def path(self, key: str) -> Path:
        """Place of a point file."""
        return self.folder / "points" / key[:2] / f"{key}.h5"

    def add(self, tasks: Iterable[PointTask]) -> None:
        """Enter points; those that are known stay as they are."""
        self._index.add([task.key for task in tasks])

    def entries(self) -> dict[str, Entry]:
        """State of every point, by key."""
        return {entry.key: entry for entry in self._index.entries()}

    def is_free(self, entry: Entry) -> bool:
        """Whether a point can be claimed: it is queued, or its campaign is dead."""
        return entry.state == "queued" or (entry.state == "running" and self._is_stale(entry))

    def claim(self, key: str) -> bool:
        """Take a point for this campaign; False if it is done, failed, or somebody else's."""
        if self._owner is None:
            self._owner = self._announce()
        return self._index.claim(key, self._owner.name, self._is_stale)

    def finish(self, task: PointTask, result: PointResult) -> None:
        """Keep a result.

        Raises:
            StoreFull: no room; the point is queued again and nothing of it is left.
            InputError: the file cannot be written for another reason; likewise.
        """
        key = task.key
        try:
            write_point(self.path(key), task, result)
        except OSError as error:
            with suppress(InputError):
                self._index.end(key, "queued", attempts=0)
            raise self.trouble(self.path(key), error) from None
        self._index.end(key, "done")

    def fail(self, key: str, reason: str, attempts: int = 1) -> None:
        """Give a point up."""
        self._index.end(key, "failed", reason, attempts)

    def again(self, key: str, reason: str = "", attempts: int = 0) -> int:
        """Queue a point again; number of attempts so far."""
        return self._index.end(key, "queued", reason, attempts)

    def load(self, key: str) -> PointResult | None:
        """Result of a point; None if its file is missing or damaged, it is then queued again."""
        try:
            return read_point(self.path(key)).result
        except FileNotFoundError:
            self.warnings.append(f"{self.path(key)}: is gone; the point is computed again")
        except DamagedPoint as error:
            self._set_aside(key, error)
        except OSError as error:
            raise InputError(f"{self.path(key)}: cannot be read ({error.strerror or error})") from None
        self._index.requeue([key])
        return None

    def retry(self, keys: Sequence[str] | None = None) -> list[str]:
        """Queue failed points again, all of them or those among `keys`; the keys queued."""
        failed = [key for key, entry in self.entries().items() if entry.state == "failed"]
        chosen = [key for key in failed if keys is None or key in set(keys)]
        self._index.requeue(chosen)
        return chosen

    def trouble(self, path: Path, error: OSError) -> InputError:
        """What to tell when a file of the store cannot be written."""
        if error.errno in _FULL:
            return StoreFull(full_message(self.folder))
        return InputError(f"{path}: cannot be written ({error.strerror or error})")

    def release(self) -> None:
        """Queue again what this campaign was running."""
        if self._owner is not None:
            self._index.release(self._owner.name)

    def _find(self, create: bool) -> None:
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{self.folder}: is a file; a store is a folder")
        content = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        # After the look at the content: another campaign may be making the store, and "points" is what it makes first.
        is_store = (self.folder / "index.sqlite").exists() or (
            (self.folder / "points").is_dir() and all(name.startswith(_PARTS) for name in content)
        )
        if not is_store and not create:
            raise InputError(f"{self.folder}: is no store; give the folder that 'graindamp field' has made")
        if not is_store and content:
            raise InputError(f"{self.folder}: is a folder with other files; give an empty or new one for the store")
        try:
            for part in ("points", "fields", "owners"):
                (self.folder / part).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self.trouble(self.folder, error) from None

    def _open_index(self) -> Index:
        path = self.folder / "index.sqlite"
        try:
            return Index(path)
        except IndexDamaged as error:
            os.replace(path, path.with_name("index.sqlite.corrupt"))
            for rest in ("index.sqlite-wal", "index.sqlite-shm"):
                (self.folder / rest).unlink(missing_ok=True)
            self.warnings.append(f"{error}; built again from the point files")
            return Index(path)

    def _reconcile(self) -> None:
        """Make the index agree with the files, and remove drafts that a killed campaign left."""
        entries = self.entries()
        files = [path.stem for path in sorted((self.folder / "points").glob("*/*.h5"))]
        unknown = [key for key in files if key not in entries or entries[key].state != "done"]
        whole = []
        for key in unknown:
            try:
                read_point(self.path(key))
                whole.append(key)
            except DamagedPoint as error:
                self._set_aside(key, error)
            except FileNotFoundError:
                continue
        gone = [key for key, entry in entries.items() if entry.state == "done" and not self.path(key).is_file()]
        if whole:
            self._index.set_done(whole)
        if gone:
            self._index.requeue(gone)
        sweep(self.folder / "owners")
        for draft in (self.folder / "points").glob("*/.*.part"):
            with suppress(OSError):
                if time.time() - draft.stat().st_mtime > _OLD_DRAFT:
                    draft.unlink()

    def _set_aside(self, key: str, error: DamagedPoint) -> None:
        path = self.path(key)
        with suppress(FileNotFoundError):
            os.replace(path, path.with_suffix(".corrupt"))
        self.warnings.append(f"{error}; set aside as {path.stem[:8]}….corrupt, the point is computed again")

    def _is_stale(self, entry: Entry) -> bool:
        owners = self.folder / "owners"
        if self._owner is not None and entry.owner == self._owner.name:
            return False
        return is_dead(entry.owner, owners) or time.time() - entry.heartbeat > LEASE

    def _announce(self) -> Owner:
        try:
            owner = Owner(self.folder / "owners")
        except OSError as error:
            raise self.trouble(self.folder, error) from None
        self._beating = threading.Thread(target=self._beat, args=(owner.name,), daemon=True)
        self._beating.start()
        return owner

    def _beat(self, owner: str) -> None:
        """Say that this campaign is alive, until it is closed. What stops that stops the campaign elsewhere, too."""
        with suppress(InputError):
            index = Index(self.folder / "index.sqlite")
            try:
                while not self._stop.wait(BEAT):
                    with suppress(InputError):
                        index.beat(owner)
            finally:
                index.close()
