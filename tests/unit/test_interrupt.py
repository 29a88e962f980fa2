"""Ctrl-C during a run: noted first, at once the second time; what a run keeps is whole."""

import os
import signal
import threading

import numpy as np
import pytest

from graindamp.dem.packing_store import Packing
from graindamp.dem.simulate import simulate
from graindamp.interrupt import deferred
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status


@pytest.fixture(autouse=True)
def interruptible():
    """Ctrl-C as a user's shell has it, whatever started the tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ball():
    """A ball on the floor of a box that is shaken upright, and its bed."""
    told = {
        "damper": {
            "particles": [{"material": "steel", "radius": 1e-3}],
            "fill": {"count": 1},
            "container": {"kind": "box", "size": [0.01, 0.01, 0.01], "material": "steel"},
            "contact": {"restitution": 0.5, "friction": 0.1, "softening": 1e4},
        },
        "motion": {"kind": "harmonic", "frequency": 100.0, "intensity": 3.0, "direction": "z"},
        "run": {"cycles": 4, "settle": 0.01},
    }
    place, nan = np.array([[5e-3, 5e-3, 1e-3]]), np.nan
    packing = Packing(place, np.array([1e-3]), np.zeros(1, np.int32), nan, nan, nan, nan, None, None, 0, 0.0)
    return parse_spec(told, SimulationSpec, "ball"), packing


def press():
    os.kill(os.getpid(), signal.SIGINT)


def test_the_first_is_noted_the_second_interrupts():
    with deferred() as interruption:
        assert not interruption.asked
        press()
        assert interruption.asked
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_threads_are_left_alone():
    found = []

    def work():
        with deferred() as interruption:
            found.append((interruption.asked, signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(False, signal.default_int_handler)]


@pytest.mark.parametrize("stage", ["settling", "shaking"])
def test_a_run_that_is_interrupted_keeps_what_belongs_together(stage):
    """Wherever the signal arrives, also between two lists that are written one after the other."""
    spec, packing = ball()
    seen = []

    def progress(name, done, left):
        seen.append(done)
        if name == stage and len(seen) > 3:
            press()

    run = simulate(spec, packing=packing, progress=progress)
    assert run.status & Status.INTERRUPTED
    assert run.n_step < simulate(spec, packing=packing).n_step
    n = len(run.energy_time)
    assert len(run.energy) == n > 0
    assert len(run.centre) == n
    assert np.isfinite(run.centre).all()
