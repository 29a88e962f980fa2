"""What the commands say of a bed whose shaking ended although it still settled."""

from types import SimpleNamespace

import pytest

from dem_made import damper_of
from graindamp.cli.simulate import _unsettled
from graindamp.spec.simulation import PackingSpec, TapSpec


@pytest.mark.parametrize(("cycles", "most", "lines"), [(20, 20, 1), (20, 40, 0), (0, None, 0)])
def test_a_bed_that_still_settles_is_told(cycles, most, lines):
    tap = None if most is None else TapSpec(max_cycles=most)
    damper = damper_of().model_copy(update={"packing": PackingSpec(direction=(0.0, 0.0, -1.0), tap=tap)})
    told = _unsettled(SimpleNamespace(damper=damper), SimpleNamespace(tap_cycles=cycles))
    assert len(told) == lines
    assert all(f"after {most} cycles" in line for line in told)
