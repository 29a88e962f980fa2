"""The store: whole files, states, claims and leases, and what it does about damage."""

import os
import sqlite3
import time

import numpy as np
import pytest

from campaign_made import field_spec, made, result_of
from graindamp.campaign import index, point_file, store
from graindamp.campaign.index import StoreFull
from graindamp.campaign.owner import Owner, is_dead, sweep
from graindamp.campaign.point import PointResult, task_of
from graindamp.campaign.point_file import DamagedPoint, read_point, write_point
from graindamp.campaign.store import Store
from graindamp.errors import InputError

TASK = task_of(field_spec(), 100.0, 5.0)
OTHER = task_of(field_spec(), 100.0, 20.0)


def same(first, second):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(first, second, strict=True))


def test_a_point_comes_back_bit_by_bit(tmp_path):
    result = result_of(TASK, 0.4, error=float("nan"))
    write_point(tmp_path / f"{TASK.key}.h5", TASK, result)
    back = read_point(tmp_path / f"{TASK.key}.h5")
    assert back.task == TASK
    assert same(back.result, result)
    assert [type(value) for value in back.result] == [type(value) for value in result]
    assert [path.name for path in tmp_path.iterdir()] == [f"{TASK.key}.h5"]


def test_a_point_of_a_version_with_other_fields_is_read(tmp_path, monkeypatch):
    """A field with a default may be missing, one that is not known is passed over; the checksum still holds."""
    more = {**result_of(TASK, 0.4)._asdict(), "later": 3.0}
    gone = list(PointResult._field_defaults)[:1]
    values = {name: value for name, value in more.items() if name not in gone}
    fake = type("Result", (), {"_asdict": lambda self: values})()
    path = tmp_path / f"{TASK.key}.h5"
    write_point(path, TASK, fake)
    assert read_point(path).result.loss_factor == 0.4


@pytest.mark.parametrize("damage", ["truncate", "flip", "garbage", "empty", "rename"])
def test_damage_is_seen(tmp_path, damage):
    path = tmp_path / f"{TASK.key}.h5"
    write_point(path, TASK, result_of(TASK, 0.4))
    data = bytearray(path.read_bytes())
    where = data.find(np.float64(0.4).tobytes())
    assert where > 0
    if damage == "truncate":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "flip":
        data[where] ^= 1  # the last bit of eta
        path.write_bytes(data)
    elif damage == "garbage":
        path.write_bytes(os.urandom(5000))
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        path = path.rename(tmp_path / f"{OTHER.key}.h5")
    with pytest.raises(DamagedPoint):
        read_point(path)


def test_any_flipped_byte_is_seen_or_harmless(tmp_path):
    """Either the file is refused, or every number that comes out is the right one."""
    path = tmp_path / f"{TASK.key}.h5"
    write_point(path, TASK, result_of(TASK, 0.4, n_particle=3))
    whole, data = read_point(path), path.read_bytes()
    for k in np.random.default_rng(1).integers(0, len(data), 150):
        path.write_bytes(data[:k] + bytes([data[k] ^ 0x55]) + data[k + 1 :])
        try:
            back = read_point(path)
        except DamagedPoint:
            continue
        assert same(back.result, whole.result)
        assert back.task == whole.task


def test_states_follow_a_point(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.add([TASK, OTHER, TASK])
        assert {entry.state for entry in opened.entries().values()} == {"queued"}
        assert opened.claim(TASK.key)
        assert not opened.claim(TASK.key)
        opened.finish(TASK, result_of(TASK, 0.4))
        assert not opened.claim(TASK.key)
        assert opened.claim(OTHER.key)
        opened.fail(OTHER.key, "too full")
        entry = opened.entries()[OTHER.key]
        assert (entry.state, entry.reason, entry.tries) == ("failed", "too full", 1)
        assert opened.load(TASK.key).loss_factor == 0.4
        assert opened.retry() == [OTHER.key]
        assert opened.entries()[OTHER.key].tries == 0


def test_what_runs_is_queued_again_when_a_store_is_closed(tmp_path):
    first, second = Store(tmp_path / "s"), Store(tmp_path / "s")
    first.add([TASK])
    assert first.claim(TASK.key)
    assert not second.claim(TASK.key)
    assert not second.is_free(second.entries()[TASK.key])
    first.close()
    assert second.claim(TASK.key)
    assert second.entries()[TASK.key].tries == 0
    second.close()


def test_a_stale_lease_is_taken_over(tmp_path, monkeypatch):
    first, second = Store(tmp_path / "s"), Store(tmp_path / "s")
    first.add([TASK])
    assert first.claim(TASK.key)
    monkeypatch.setattr(store, "LEASE", -1.0)  # its last sign of life is then too old, although it holds its lock
    assert second.claim(TASK.key)
    assert not first.entries()[TASK.key].owner.endswith(first._owner.name)
    first.close()
    assert second.entries()[TASK.key].state == "running"  # not released by the one that lost it
    second.close()


def test_the_points_of_a_dead_campaign_are_taken_over_at_once(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.add([TASK])
        base = sqlite3.connect(opened.folder / "index.sqlite")
        base.execute("UPDATE points SET state = 'running', owner = 'gone', heartbeat = ?", (time.time(),))
        base.commit()
        base.close()
        assert opened.is_free(opened.entries()[TASK.key])
        assert opened.claim(TASK.key)


def test_a_campaign_is_alive_while_it_holds_its_lock(tmp_path):
    owner = Owner(tmp_path)
    assert not is_dead(owner.name, tmp_path)
    os.utime(tmp_path / f"{owner.name}.lock", (0, 0))
    sweep(tmp_path)
    assert not is_dead(owner.name, tmp_path)
    owner._file.close()
    assert is_dead(owner.name, tmp_path)
    sweep(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_sign_of_life_is_given(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "BEAT", 0.01)
    with Store(tmp_path / "s") as opened:
        opened.add([TASK])
        opened.claim(TASK.key)
        first = opened.entries()[TASK.key].heartbeat
        for _ in range(200):
            if opened.entries()[TASK.key].heartbeat > first:
                break
            time.sleep(0.01)
        else:
            pytest.fail("no heartbeat")


def test_a_lost_index_is_built_again_from_the_files(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.add([TASK, OTHER])
        opened.finish(TASK, made(TASK, None))
    for path in (tmp_path / "s").glob("index.sqlite*"):
        path.unlink()
    with Store(tmp_path / "s") as opened:
        assert {key: entry.state for key, entry in opened.entries().items()} == {TASK.key: "done"}
        assert not opened.warnings


def test_a_damaged_index_is_set_aside(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.finish(TASK, made(TASK, None))
    (tmp_path / "s" / "index.sqlite").write_bytes(b"no database at all" * 100)
    with Store(tmp_path / "s") as opened:
        assert opened.entries()[TASK.key].state == "done"
        assert "built again" in opened.warnings[0]
    assert (tmp_path / "s" / "index.sqlite.corrupt").exists()


def test_a_damaged_point_is_set_aside_and_queued(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.add([TASK])
        opened.finish(TASK, made(TASK, None))
        path = opened.path(TASK.key)
        path.write_bytes(path.read_bytes()[:-100])
        assert opened.load(TASK.key) is None
        assert opened.entries()[TASK.key].state == "queued"
        assert path.with_suffix(".corrupt").exists()
        assert not path.exists()
        assert "computed again" in opened.warnings[0]


def test_a_point_whose_file_is_gone_is_queued(tmp_path):
    with Store(tmp_path / "s") as opened:
        opened.add([TASK, OTHER])
        for task in (TASK, OTHER):
            opened.finish(task, made(task, None))
        opened.path(TASK.key).unlink()
        assert opened.load(TASK.key) is None
        opened.path(OTHER.key).unlink()
    with Store(tmp_path / "s") as opened:
        assert {entry.state for entry in opened.entries().values()} == {"queued"}


def test_a_file_written_before_the_index_was_told_counts_as_done(tmp_path):
    """What a kill between the two leaves; drafts that it left are cleared away once they are old."""
    with Store(tmp_path / "s") as opened:
        opened.add([TASK])
        write_point(opened.path(TASK.key), TASK, made(TASK, None))
        draft = opened.path(TASK.key).with_name(".x.h5.1234.part")
        draft.write_bytes(b"half")
        os.utime(draft, (0, 0))
    with Store(tmp_path / "s") as opened:
        assert opened.entries()[TASK.key].state == "done"
    assert not draft.exists()


def test_a_full_disk_leaves_nothing_half_written(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    with Store(tmp_path / "s") as opened:
        opened.add([TASK])
        opened.claim(TASK.key)
        monkeypatch.setattr(point_file.os, "fsync", full)
        with pytest.raises(StoreFull, match=r"no space left.*same command again"):
            opened.finish(TASK, made(TASK, None))
        assert opened.entries()[TASK.key].state == "queued"
    assert not [path for path in (tmp_path / "s" / "points").rglob("*") if path.is_file()]


def test_an_index_on_a_full_disk_says_so(tmp_path):
    """The index may not grow beyond the pages that it has: what SQLite meets on a full disk."""
    with Store(tmp_path / "s") as opened:
        base = opened._index._base
        base.execute("PRAGMA max_page_count = 1")
        tasks = [task_of(field_spec(), 100.0, 1.0 + k) for k in range(100)]
        with pytest.raises(StoreFull, match="no space left"):
            opened.add(tasks)
        assert not opened.entries()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("x"), "is a file"),
        (lambda path: path.mkdir() or (path / "holiday.jpg").write_text("x"), "other files"),
    ],
)
def test_a_store_is_not_made_of_something_else(tmp_path, make, message):
    make(tmp_path / "s")
    with pytest.raises(InputError, match=message):
        Store(tmp_path / "s")


def test_a_store_that_is_none_is_not_made_by_asking(tmp_path):
    with pytest.raises(InputError, match="is no store"):
        Store(tmp_path, create=False)
    assert not list(tmp_path.iterdir())


def test_somebody_elses_points_are_no_store(tmp_path):
    (tmp_path / "points" / "run1").mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("mine")
    for create, message in ((False, "is no store"), (True, "other files")):
        with pytest.raises(InputError, match=message):
            Store(tmp_path, create=create)
    assert {path.name for path in tmp_path.iterdir()} == {"points", "notes.txt"}


def test_a_store_without_its_index_is_still_one(tmp_path):
    Store(tmp_path / "s").close()
    (tmp_path / "s" / "index.sqlite").unlink()
    Store(tmp_path / "s", create=False).close()


@pytest.mark.parametrize(
    ("change", "message"),
    [("PRAGMA user_version = 99", "version 99"), ("PRAGMA application_id = 7", "another program")],
)
def test_an_index_of_others_is_refused(tmp_path, change, message):
    Store(tmp_path / "s").close()
    base = sqlite3.connect(tmp_path / "s" / "index.sqlite")
    base.execute(change)
    base.close()
    with pytest.raises(InputError, match=message):
        Store(tmp_path / "s")


def test_a_locked_index_says_so(tmp_path, monkeypatch):
    Store(tmp_path / "s").close()
    base = sqlite3.connect(tmp_path / "s" / "index.sqlite", isolation_level=None)
    base.execute("BEGIN IMMEDIATE")
    monkeypatch.setattr(index, "BUSY", 0.05)
    opened = Store(tmp_path / "s")
    with pytest.raises(InputError, match="is locked by another program"):
        opened.add([TASK])
    base.close()
    opened.close()


@pytest.mark.parametrize("after", [1, 2, 3, 4, 5])
def test_two_campaigns_may_make_an_index_at_the_same_time(tmp_path, monkeypatch, after):
    """The other one makes it whole between two statements of this one."""
    real, said = sqlite3.connect, []

    class Interrupted(sqlite3.Connection):
        def execute(self, statement, *more):
            if len(said) == after:
                monkeypatch.setattr(index.sqlite3, "connect", real)
                index.Index(tmp_path / "index.sqlite").close()
            said.append(statement)
            return super().execute(statement, *more)

    monkeypatch.setattr(index.sqlite3, "connect", lambda *words, **more: real(*words, factory=Interrupted, **more))
    mine = index.Index(tmp_path / "index.sqlite")
    assert len(said) > after
    assert mine.entries() == []
    mine.close()
