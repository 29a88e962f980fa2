"""Descriptions of small fields to simulate."""

import copy

DOCUMENT = {
    "damper": {
        "particles": [{"material": "steel-s235", "radius": "1.25 mm"}],
        "fill": {"count": 40},
        "container": {
            "kind": "cylinder", "axis": "x", "radius": "5 mm", "length": "20 mm", "material": "aluminium-6060",
        },
        "lid": {"kind": "rigid", "clearance": "3 mm"},
        "contact": {"law": "hertz-gonthier", "restitution": 0.6, "friction": 0.1},
    },
    "plan": {"frequency": {"start": "40 Hz", "stop": "1000 Hz", "count": 28}, "intensity": [1, "2 g", 5]},
}  # fmt: skip


def field_document():
    return copy.deepcopy(DOCUMENT)
