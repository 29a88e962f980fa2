"""The map and the one-way imports of ARCHITECTURE.md, kept by reading every import of the package."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import graindamp

ROOT = Path(graindamp.__file__).parent

ALLOWED = {
    "errors": set(),
    "interrupt": set(),
    "locks": set(),
    "status": set(),
    "units": set(),
    "materials": {"errors"},
    "spec": {"errors", "units", "materials"},
    "dem": {"errors", "interrupt", "locks", "status", "units", "materials", "spec"},
    "signals": {"errors", "status", "units", "spec", "dem"},
    "field": {"errors", "status", "units", "spec", "signals"},
    "dem.gpu": {"errors", "status", "spec", "dem", "signals"},
    "campaign": {"errors", "locks", "status", "units", "spec", "dem", "dem.gpu", "signals", "field"},
    "structure": {"errors", "units", "spec", "materials"},
    "couple": {"errors", "interrupt", "status", "units", "spec", "dem", "field", "structure"},
    "impact": {"errors", "status", "units", "spec", "field", "structure"},
    "design": {"errors", "units", "couple", "field", "impact"},
    "report": {
        "errors",
        "status",
        "units",
        "spec",
        "dem",
        "signals",
        "field",
        "campaign",
        "structure",
        "couple",
        "impact",
        "design",
        "__init__",
    },
    "cli": {
        "errors",
        "status",
        "units",
        "spec",
        "dem",
        "signals",
        "field",
        "campaign",
        "structure",
        "couple",
        "impact",
        "design",
        "report",
        "__init__",
    },
    "__main__": {"cli"},
    "__init__": {"errors", "spec", "dem", "signals", "field", "campaign", "couple"},
}
"""Each room and the rooms it may look into; a new room needs a row here and in ARCHITECTURE.md."""


def room_of(parts: tuple[str, ...]) -> str:
    """Room of a module, given by its place in the package."""
    if parts[:2] == ("dem", "gpu"):
        return "dem.gpu"  # it stops worlds by the rule of signals, so that it stands above them
    return parts[0].removesuffix(".py") if parts else "__init__"


def imported_modules(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name for name in names if name.split(".")[0] == "graindamp"}


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    room = room_of(path.relative_to(ROOT).parts)
    assert room in ALLOWED, f"{room} is not on the map"
    for module in imported_modules(path):
        target = room_of(tuple(module.split(".")[1:]))
        assert target == room or target in ALLOWED[room], f"{path} imports {module}"


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(sorted(m.split('.')[0] for m in sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(out.stdout.split())


def test_import_graindamp_is_light():
    """Nothing heavy is loaded until it is used; the clock is left to the benchmarks."""
    heavy = {"numpy", "scipy", "xarray", "pandas", "matplotlib", "pint", "pydantic", "h5py", "typer", "rich", "pyuff"}
    assert not loaded_by("import graindamp") & heavy


def test_unit_strings_alone_load_pint():
    assert "pint" not in loaded_by("from graindamp.units import to_si; to_si('1.5', 'm')")
    assert "pint" in loaded_by("from graindamp.units import to_si; to_si('1.5 mm', 'm')")


def test_every_exported_name_exists():
    for name in graindamp.__all__:
        assert getattr(graindamp, name) is not None
    assert set(graindamp.__all__) == set(graindamp._HOME)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = graindamp.nothing
