"""The index of a store in SQLite: which points are queued, running, done or failed, and who runs them.

It can be lost at any time: what is done is told by the point files, and what is not in the index is queued again.
"""

import sqlite3
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

from graindamp.errors import InputError

VERSION = 1
"""Version of the tables; kept in the file as user_version."""
APPLICATION = 0x67726470
"""Mark of our index files, kept in them as application_id."""
BUSY = 30.0
"""Seconds to wait for another campaign that is writing."""

State = Literal["queued", "running", "done", "failed"]

_TABLES = """
CREATE TABLE points (
    key TEXT PRIMARY KEY,
    state TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    reason TEXT NOT NULL DEFAULT '',
    tries INTEGER NOT NULL DEFAULT 0,
    owner TEXT NOT NULL DEFAULT '',
    heartbeat REAL NOT NULL DEFAULT 0,
    begun REAL,
    ended REAL
) WITHOUT ROWID;
"""


class StoreFull(InputError):
    """There is no room left where the store is. All that is done is kept."""


class IndexDamaged(InputError):
    """The index file is no database any more. When a store is opened it is set aside and built again."""


class Entry(NamedTuple):
    """What the index knows of a point."""

    key: str
    state: State
    reason: str
    """Why it failed, or why it was tried again."""
    tries: int
    """Attempts that ended by themselves: with a result, an error or a dead worker."""
    owner: str
    """Campaign that runs it."""
    heartbeat: float
    """When that campaign last said that it is alive [s since 1970]."""
    begun: float | None
    ended: float | None


class Index:
    """States of the points of a store; every change is one transaction.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        """Open the index, making it where there is none.

        Raises:
            InputError: of another version, no index of graindamp, or locked.
            IndexDamaged: the file is no database.
            StoreFull: no room.
        """
        self.path = path
        with self._told():
            self._base = sqlite3.connect(path, timeout=BUSY, isolation_level=None, check_same_thread=False)
        try:
            self._prepare()
        except BaseException:
            self._base.close()
            raise

    def _prepare(self) -> None:
        with self._told():
            # Tables first: where there are any, whoever made them has made the marks too.
            (tables,) = self._base.execute("SELECT count(*) FROM sqlite_master").fetchone()
            (version,) = self._base.execute("PRAGMA user_version").fetchone()
            (mark,) = self._base.execute("PRAGMA application_id").fetchone()
            if tables and mark != APPLICATION:
                raise InputError(f"{self.path}: is a database of another program, not the index of a store")
            if tables and version != VERSION:
                raise InputError(
                    f"{self.path}: is an index of version {version}, this graindamp reads {VERSION}; use the graindamp "
                    "that made it, or remove the file: the index is then built again from the point files"
                )
            self._base.execute("PRAGMA journal_mode = WAL")
            self._base.execute("PRAGMA synchronous = NORMAL")
        if not tables:
            with self._writing() as base:
                if not base.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                    base.execute(_TABLES)
                    base.execute(f"PRAGMA application_id = {APPLICATION}")
                    base.execute(f"PRAGMA user_version = {VERSION}")

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def entries(self) -> list[Entry]:
        """All points."""
        with self._told():
            rows = self._base.execute(
                "SELECT key, state, reason, tries, owner, heartbeat, begun, ended FROM points ORDER BY key"
            ).fetchall()
        return [Entry(*row) for row in rows]

    def add(self, keys: Collection[str], state: State = "queued") -> None:
        """Enter points that are not there yet."""
        with self._writing() as base:
            base.executemany("INSERT OR IGNORE INTO points (key, state) VALUES (?, ?)", [(k, state) for k in keys])

    def claim(self, key: str, owner: str, is_stale: Callable[[Entry], bool]) -> bool:
        """Take a point that is queued, or whose campaign is dead; False if it is done, failed or somebody else's."""
        with self._writing() as base:
            row = base.execute(
                "SELECT key, state, reason, tries, owner, heartbeat, begun, ended FROM points WHERE key = ?", (key,)
            ).fetchone()
            if row is None:
                return False
            entry = Entry(*row)
            if entry.state != "queued" and not (entry.state == "running" and is_stale(entry)):
                return False
            now = time.time()
            base.execute(
                "UPDATE points SET state = 'running', owner = ?, heartbeat = ?, begun = ? WHERE key = ?",
                (owner, now, now, key),
            )
            return True

    def end(self, key: str, state: State, reason: str = "", attempts: int = 1) -> int:
        """Leave a point done, failed, or queued again; the number of attempts so far."""
        with self._writing() as base:
            base.execute(
                "UPDATE points SET state = ?, reason = ?, tries = tries + ?, owner = '', ended = ? WHERE key = ?",
                (state, reason, attempts, time.time(), key),
            )
            row = base.execute("SELECT tries FROM points WHERE key = ?", (key,)).fetchone()
        return int(row[0]) if row else 0

    def requeue(self, keys: Sequence[str]) -> None:
        """Queue points again with a clean record."""
        with self._writing() as base:
            base.executemany(
                "UPDATE points SET state = 'queued', reason = '', tries = 0, owner = '' WHERE key = ?",
                [(key,) for key in keys],
            )

    def set_done(self, keys: Sequence[str]) -> None:
        """Mark points whose files are there."""
        with self._writing() as base:
            base.executemany(
                "INSERT INTO points (key, state) VALUES (?, 'done') "
                "ON CONFLICT (key) DO UPDATE SET state = 'done', owner = '', reason = ''",
                [(key,) for key in keys],
            )

    def release(self, owner: str) -> None:
        """Queue again whatever a campaign was running."""
        with self._writing() as base:
            base.execute(
                "UPDATE points SET state = 'queued', owner = '' WHERE state = 'running' AND owner = ?", (owner,)
            )

    def beat(self, owner: str) -> None:
        """Say that a campaign is alive."""
        with self._writing() as base:
            base.execute("UPDATE points SET heartbeat = ? WHERE state = 'running' AND owner = ?", (time.time(), owner))

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction that begins by locking, so that what is read in it stays true until it is written."""
        with self._told():
            self._base.execute("BEGIN IMMEDIATE")
            try:
                yield self._base
                self._base.execute("COMMIT")
            except BaseException:
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Errors of the database in words."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error) or "busy" in str(error):
                raise InputError(
                    f"{self.path}: is locked by another program for more than {BUSY:g} s; end it, or wait"
                ) from None
            if "full" in str(error) or "disk I/O" in str(error):
                raise StoreFull(full_message(self.path.parent)) from None
            raise InputError(f"{self.path}: cannot be used ({error}); check the folder and its permissions") from None
        except sqlite3.DatabaseError as error:
            raise IndexDamaged(f"{self.path}: damaged ({error})") from None


def full_message(folder: Path) -> str:
    """What to do when the disk is full."""
    return (
        f"{folder}: no space left on the disk; every point that was finished is kept. Free some space and give the "
        "same command again: it goes on from there"
    )
