"""Commands that look after the store of a campaign."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graindamp.cli.options import AsJson, print_json, warn
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.campaign.descriptions import StoredField

campaign = typer.Typer(
    name="campaign",
    help="Stores of simulated points: what is done, what failed, fields so far.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

StoreArgument = Annotated[Path, typer.Argument(help="Folder of the store.", metavar="STORE")]


@campaign.command()
def status(store: StoreArgument, as_json: AsJson = False) -> None:
    """What a store holds: points queued, running, done and failed, with reasons."""
    from graindamp.campaign.descriptions import fields_of
    from graindamp.campaign.store import Store
    from graindamp.report.field_run import SHOWN

    with Store(store, create=False) as opened:
        entries = opened.entries()
        fields = fields_of(opened)
        warnings = list(opened.warnings)
    count = Counter(entry.state for entry in entries.values())
    failed = [entry for entry in entries.values() if entry.state == "failed"]
    rows = [_field_row(one, entries) for one in fields]
    warn(warnings)
    if as_json:
        states = {state: count[state] for state in ("queued", "running", "done", "failed")}
        reasons = [{"key": entry.key, "reason": entry.reason, "tries": entry.tries} for entry in failed]
        print_json({"store": str(store), "points": states, "fields": rows, "failed": reasons, "warnings": warnings})
        return
    print(", ".join(f"{count[state]} {state}" for state in ("done", "running", "queued", "failed")))
    for row in rows:
        print(f"{row['name']}: {row['done']} of {row['points']} points from rest done ({row['project']})")
    for entry in failed[:SHOWN]:
        print(f"failed   {entry.key[:12]}: {entry.reason} (tries: {entry.tries})")
    if len(failed) > SHOWN:
        print(f"         and {len(failed) - SHOWN} more; --json lists all")
    if failed:
        print(f"'graindamp campaign retry {store}' queues the failed points again")


@campaign.command()
def retry(store: StoreArgument, as_json: AsJson = False) -> None:
    """Queue the failed points of a store again; the next 'graindamp field' runs them."""
    from graindamp.campaign.store import Store

    with Store(store, create=False) as opened:
        keys = opened.retry()
    if as_json:
        print_json({"store": str(store), "queued": keys})
        return
    print(f"{len(keys)} failed points queued again" if keys else "no point has failed")


@campaign.command()
def export(
    store: StoreArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Field file to write, .nc or .csv.")],
    name: Annotated[
        str | None, typer.Option(help="Name of the field, or its project file, where the store holds several.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the field that a store holds so far; points that are not done have no value."""
    from graindamp.campaign.descriptions import fields_of
    from graindamp.campaign.run import field_in_store
    from graindamp.campaign.store import Store
    from graindamp.report.field_run import check_suffix, run_document, warnings_of, write_run

    check_suffix(output)
    with Store(store, create=False) as opened:
        run = field_in_store(_choose(fields_of(opened), name, store), opened)
        document = run_document(run, output, opened)
    document |= {"points": str(points) if (points := write_run(run, output)) else None}
    warn(warnings_of(run, store))
    if as_json:
        print_json(document)
        return
    print(f"field    {output} ({document['usable']} of {document['places']} points have a value)")


def _field_row(field: "StoredField", entries: dict[str, Any]) -> dict[str, Any]:
    from graindamp.campaign.run import rest_tasks

    keys = [task.key for task in rest_tasks(field)]
    states = [entries[key].state if key in entries else "queued" for key in keys]
    told = {state: states.count(state) for state in ("queued", "running", "done", "failed")}
    return {
        "name": field.name,
        "project": field.project,
        "title": field.spec.title,
        "backend": field.backend,
        "points": len(keys),
        **told,
    }


def _choose(fields: list["StoredField"], name: str | None, store: Path) -> "StoredField":
    if not fields:
        raise InputError(f"{store}: holds no description of a field; run 'graindamp field' on it once")
    count = Counter(field.name for field in fields)
    names = ", ".join(sorted(field.name if count[field.name] == 1 else field.project for field in fields))
    if name is None:
        if len(fields) > 1:
            raise InputError(f"{store}: holds several fields; add --name, one of {names}")
        return fields[0]
    meant = [field for field in fields if name == field.name] or [
        field for field in fields if Path(name).resolve() == Path(field.project).resolve()
    ]
    if not meant:
        raise InputError(f"--name: given '{name}'; the store holds {names}")
    if len(meant) > 1:
        raise InputError(f"--name: given '{name}', of which the store holds {len(meant)}; give one of {names}")
    return meant[0]
