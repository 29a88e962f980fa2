"""The common ground of all descriptions, and the reading of a TOML file into one."""

import ast
import difflib
import inspect
import textwrap
import tomllib
import types
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from graindamp.errors import InputError


class Spec(BaseModel):
    """A frozen description. The text under a field is its help everywhere and states unit and range."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _name_nearest_key(cls, data: Any) -> Any:
        """Reject unknown keys with the nearest valid one; pydantic alone would only say that they are not permitted."""
        if not isinstance(data, Mapping):
            return data
        allowed = list(cls.model_fields)
        unknown = [str(key) for key in data if key not in cls.model_fields]
        if unknown:
            raise PydanticCustomError("unknown_key", "{text}", {"text": _unknown_keys(unknown, allowed, data)})
        return data


def _unknown_keys(unknown: list[str], allowed: list[str], data: Mapping[str, Any]) -> str:
    lines = []
    for key in unknown:
        near = difflib.get_close_matches(key, allowed, n=1, cutoff=0.5)
        hint = f"; nearest valid key is '{near[0]}'" if near else ""
        lines.append(f"unknown key '{key}' (given {_short(data[key])}){hint}")
    return "; ".join(lines) + f"; allowed keys: {', '.join(allowed)}"


AnySpec = TypeVar("AnySpec", bound=Spec)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises:
        InputError: the file cannot be opened or is not TOML, with line and column.
    """
    try:
        with open(path, "rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: not a TOML file: {error}. Text needs quotes: length = "1.8 m"') from None


def load_spec(path: str | Path, kind: type[AnySpec]) -> AnySpec:
    """Description of type `kind` read from a TOML file; paths in it stay as written.

    Raises:
        InputError: with file, key, what was given, what is allowed and the nearest valid key.
    """
    return parse_spec(read_toml(path), kind, where=str(path))


def parse_spec(data: Mapping[str, Any], kind: type[AnySpec], where: str) -> AnySpec:
    """Description of type `kind` from plain tables; `where` opens every message.

    Raises:
        InputError: as :func:`load_spec`.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise InputError(explain(error, kind, where)) from None


def explain(error: ValidationError, kind: type[Spec], where: str) -> str:
    """One message for all that is wrong in a description, a line per key.

    What is told of a list or table as a whole is left out where something in it is told: it is that no other form
    would have fitted either, or that without the wrong entry too few are left.
    """
    details = [(detail, *_locate(kind, detail["loc"])) for detail in error.errors(include_url=False)]
    inner = {key for _, key, _ in details}
    return "\n".join(
        _explain_one(detail, key, help_text, where)
        for detail, key, help_text in details
        if not any(other.startswith((f"{key}[", f"{key}.")) for other in inner if key)
    )


def _explain_one(detail: ErrorDetails, key: str, help_text: str, where: str) -> str:
    place = f"{where}: {key}" if key else where
    message = detail["msg"].removeprefix("Value error, ")
    if detail["type"] in ("model_type", "model_attributes_type"):
        message = f"a table is needed, [{key}] in the file"
    if detail["type"] == "unknown_key":
        return f"{place}: {message}"
    if detail["type"].startswith("union_tag"):
        tag = str(detail["ctx"]["discriminator"]).strip("'")
        tail = f"; {help_text}" if help_text else ""
        if "expected_tags" not in detail["ctx"]:
            return f"{place}.{tag}: is missing{tail}"
        return f"{place}.{tag}: given '{detail['ctx']['tag']}'; allowed are {detail['ctx']['expected_tags']}{tail}"
    if detail["type"] == "missing":
        return f"{place}: is missing" + (f"; {help_text}" if help_text else "")
    given = (
        ""
        if detail["type"] == "value_error" and isinstance(detail["input"], dict)
        else (f"given {_short(detail['input'])}; ")
    )
    return f"{place}: {given}{message}" + (f"; {help_text}" if help_text else "")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _locate(kind: type[Spec], loc: tuple[int | str, ...]) -> tuple[str, str]:
    """Dotted key as a person would write it, and the help of the field it names."""
    key, help_text, current = "", "", [kind]
    for part in loc:
        if isinstance(part, int):
            key += f"[{part + 1}]"
            continue
        owner = next((model for model in current if part in model.model_fields), None)
        if owner is None:  # the tag of a union, not a key
            continue
        field = owner.model_fields[part]
        key += ("." if key else "") + part
        help_text = helps_of(owner).get(part, "")
        current = _models_in(field.annotation)
    return key, help_text


@cache
def helps_of(model: type[Spec]) -> dict[str, str]:
    """The text under each field of a description. Pydantic can gather it too, but does so for all descriptions when
    they are imported, which took a tenth of the time to the engine's first step."""
    found: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if not issubclass(owner, Spec):
            continue
        try:
            (body,) = (node.body for node in ast.parse(textwrap.dedent(inspect.getsource(owner))).body)  # type: ignore[attr-defined]
        except OSError:  # a build without sources
            continue
        for field, text in pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
                match text.value:
                    case ast.Constant(value=str(help_text)):
                        found[field.target.id] = " ".join(help_text.split())
    return found


def _models_in(annotation: Any) -> list[type[Spec]]:
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return [annotation]
    if get_origin(annotation) in (Union, types.UnionType, tuple, list, dict) or hasattr(annotation, "__metadata__"):
        return [model for inner in get_args(annotation) for model in _models_in(inner)]
    return []
