"""Named structural materials: what a beam needs to know of them, each value with its source."""

import difflib
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from graindamp.errors import InputError


class Material(NamedTuple):
    """Linear elastic, isotropic material at room temperature."""

    name: str
    """Name a description refers to."""
    youngs_modulus: float
    """Young's modulus [Pa]."""
    poisson_ratio: float
    """Poisson's ratio [-]."""
    density: float
    """Density [kg/m^3]."""
    source: str
    """Where the three values are printed."""


def _table(*materials: Material) -> Mapping[str, Material]:
    return MappingProxyType({material.name: material for material in materials})


MATERIALS: Mapping[str, Material] = _table(
    Material("steel", 210e9, 0.30, 7850.0, "EN 1993-1-1:2005, 3.2.6 (E, nu); EN 1993-1-2:2005, 3.2.2 (density)"),
    Material(
        "stainless-steel", 200e9, 0.30, 7900.0, "EN 1993-1-4:2006, 2.1.3 (E, nu); EN 10088-1:2005, 1.4301 (density)"
    ),
    Material("aluminium", 70e9, 0.30, 2700.0, "EN 1999-1-1:2007, 3.2.5"),
    Material("aluminium-6060", 70e9, 0.33, 2700.0, "Meyer & Seifried (2023), container of their particle dampers"),
    Material("aluminium-6061-t6", 68.3e9, 0.33, 2710.0, "MIL-HDBK-5J (2003), Table 3.6.2.0: 9.9 Msi, 0.098 lb/in^3"),
    Material("aluminium-7075-t6", 71.0e9, 0.33, 2800.0, "MIL-HDBK-5J (2003), Table 3.7.6.0: 10.3 Msi, 0.101 lb/in^3"),
    Material("magnesium-az31b", 44.8e9, 0.35, 1770.0, "MIL-HDBK-5J (2003), Table 4.2.1.0: 6.5 Msi, 0.0639 lb/in^3"),
    Material("titanium-6al-4v", 110e9, 0.31, 4430.0, "MIL-HDBK-5J (2003), Table 5.4.1.0: 16.0 Msi, 0.160 lb/in^3"),
)
"""The named materials; a damper's particles and contacts are described elsewhere."""


def material_named(name: str) -> Material:
    """Material called `name`; upper case, blanks and underscores are forgiven.

    Raises:
        InputError: no such material; the message lists the names and the nearest one.
    """
    wanted = "-".join(name.lower().replace("_", " ").split())
    if wanted in MATERIALS:
        return MATERIALS[wanted]
    near = difflib.get_close_matches(wanted, list(MATERIALS), n=1, cutoff=0.5)
    hint = f"; nearest is '{near[0]}'" if near else ""
    raise InputError(
        f"no material is called '{name}'{hint}; allowed are {', '.join(MATERIALS)}, "
        "or a table with youngs_modulus and density"
    )
