"""Named materials of structures, particles and walls, each value with its source."""

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
    """Where the values are printed."""
    yield_stress: float | None = None
    """Yield stress [Pa]; None where no source is at hand."""


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
    Material(
        "steel-s235",
        208e9,
        0.30,
        7900.0,
        "Meyer & Seifried (2023), Table 1, spheres (E, nu, density); EN 10025-2:2004, S235 up to 16 mm (yield stress)",
        235e6,
    ),
    Material(
        "lead",
        16.1e9,
        0.44,
        11350.0,
        "matmake.com, lead properties, after Cardarelli (2018), CRC Handbook (2016) and Howatson et al. (2009)",
    ),
    Material("glass", 70e9, 0.20, 2500.0, "EN 572-1:2012, soda lime silicate glass"),
    Material(
        "perspex",
        3.24e9,
        0.35,
        1190.0,
        "Cast acrylic sheet, ASTM D638 (470 ksi) and D792, as listed by cctprecision.com, acrylic (E, density); "
        "Wong & Rongong (2009), sect. III.A (nu, yield stress)",
        75.9e6,
    ),
)
"""The named materials. Moduli and densities vary by a few per cent between makers, yield stresses by far more."""


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
