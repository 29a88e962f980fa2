"""Descriptions of the fields that were asked for, kept in the store as JSON files."""

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

from graindamp.campaign.backends import CPU, checked
from graindamp.campaign.point_file import write_whole
from graindamp.campaign.store import Store
from graindamp.errors import InputError
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import parse_spec

FORMAT = "graindamp-field-plan-1"
BATCH = 2
"""Points of an adaptive plan that are chosen at a time [-]; twice as many are under way."""

Place = tuple[float, float]


class StoredField(NamedTuple):
    """A field that was asked for."""

    spec: FieldSpec
    name: str
    """Name of the project file, without suffix."""
    project: str
    """Place of the project file; text for people."""
    folder: str | None
    """What files in the description are relative to."""
    batch: int = BATCH
    """Points of an adaptive plan that are chosen at a time [-]."""
    chosen: tuple[tuple[Place, ...], ...] = ()
    """Points of an adaptive plan that were chosen so far, by batch."""
    backend: str = CPU
    """What computes its points, one of :data:`graindamp.campaign.backends.BACKENDS`."""

    @property
    def where(self) -> Path | None:
        """The folder as a path."""
        return None if self.folder is None else Path(self.folder)

    def is_same(self, other: "StoredField") -> bool:
        """Whether both ask for the same results."""
        return _meaning(self) == _meaning(other)


def save_field(store: Store, field: StoredField) -> None:
    """Keep a description; an older one of the same project is replaced.

    Raises:
        InputError: the file cannot be written; StoreFull where there is no room.
    """
    told = field._asdict() | {"format": FORMAT, "spec": field.spec.model_dump(mode="json")}
    path = _path(store, field)
    try:
        write_whole(path, json.dumps(told, indent=1).encode())
    except OSError as error:
        raise store.trouble(path, error) from None


def known_field(store: Store, field: StoredField) -> StoredField | None:
    """What the store holds under the name and place of a project; None if nothing."""
    path = _path(store, field)
    return _load(path) if path.is_file() else None


def fields_of(store: Store) -> list[StoredField]:
    """All descriptions in a store, by name."""
    return [_load(path) for path in sorted((store.folder / "fields").glob("*.json"))]


def _path(store: Store, field: StoredField) -> Path:
    mark = hashlib.sha256(field.project.encode()).hexdigest()[:8]
    return store.folder / "fields" / f"{field.name}-{mark}.json"


def _load(path: Path) -> StoredField:
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["format"] != FORMAT:
            raise InputError(f"{path}: of format {told['format']}, this version reads {FORMAT}")
        chosen = tuple(tuple((float(f), float(gamma)) for f, gamma in batch) for batch in told["chosen"])
        spec = parse_spec(told["spec"], FieldSpec, f"{path}: spec")
        backend = checked(told.get("backend", CPU))
        return StoredField(spec, told["name"], told["project"], told["folder"], int(told["batch"]), chosen, backend)
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: damaged ({error}); remove it and run 'graindamp field' again") from None


def _meaning(field: StoredField) -> str:
    """All of a description that changes results."""
    aside: dict[str, Any] = {"title": True, "damper": {"name": True}, "softening_study": True, "bed_study": True}
    told = field.spec.model_dump(mode="json", exclude=aside)
    batch = field.batch if field.spec.plan.kind == "adaptive" else 0
    return json.dumps([told, batch, field.backend], sort_keys=True)
