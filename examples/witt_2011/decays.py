"""Free decays: run or read again, analysed as measured ones are, and several of them as one curve."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from witt_dampers import INTRINSIC

from graindamp.couple.cosimulate import Case, CoRun, cosimulate
from graindamp.errors import InputError
from graindamp.impact.simulate import ImpactRun
from graindamp.signals.decay import Decay, analyze_decay, mass_normalised
from graindamp.signals.decay_record import DecayRecord
from graindamp.signals.decay_repeats import combine

Real = NDArray[np.float64]

RATE = 2000.0
"""Samples of the velocity per second [Hz]; the thesis has 1000, peaks are interpolated here anyway."""

BINS = 20
"""Bins of amplitude to a factor of ten [-]."""


class Ringing(NamedTuple):
    """One run and what is told of it."""

    name: str
    velocity: Real
    """Of the tip, RATE samples per second [m/s]."""
    displacement: float
    """Initial one U0 [m]."""
    mass_ratio: float
    """mu, mass of all particles over that of the structure reduced to the tip [-]."""
    residual: float
    """Largest part of the energy that does not close, over the throughput [-]."""
    overlap: float
    """Largest over the radius [-]; 0 without particles."""
    bed_height: float
    """Of the bed at the start, twice the height of its centre [m]; 0 where it was placed."""
    time_step: float
    """[s]; 0 for the event-driven solver."""
    seconds: float
    """Computing time [s]."""
    status: int
    """Status bits."""

    @property
    def time(self) -> Real:
        """Of the samples [s]."""
        return np.arange(len(self.velocity)) / RATE


def kept(folder: Path, name: str, make: Callable[[], Ringing]) -> Ringing:
    """A run from its file in the folder, or made now and kept there."""
    path = folder / f"{name}.npz"
    if path.is_file():
        with np.load(path) as file:
            return Ringing(name, file["velocity"], **json.loads(str(file["told"])))
    run = make()
    told = {key: value for key, value in run._asdict().items() if key not in ("name", "velocity")}
    folder.mkdir(parents=True, exist_ok=True)
    draft = folder / f"{name}.part.npz"
    np.savez(draft, velocity=run.velocity, told=json.dumps(told))
    draft.replace(path)
    return run._replace(name=name)


CLOSURE = 1e-3
"""Largest part of the energy that a run may leave open, over the throughput [-]."""


def closing(folder: Path, name: str, make: Callable[[int], Ringing], steps: int) -> Ringing:
    """A run with so many time steps per contact, or with half as many more if its energy does not close."""
    run = kept(folder, name, lambda: make(steps))
    return run if run.residual <= CLOSURE else kept(folder, f"{name}-finer", lambda: make(3 * steps // 2))


def ring(case: Case, displacement: float, mass: float) -> Ringing:
    """A co-simulated decay; initial displacement of the tip [m], mass of the structure reduced to it [kg]."""
    return ringing_of(cosimulate(case), displacement, mass)


def ringing_of(run: CoRun, displacement: float, mass: float) -> Ringing:
    """What is kept of a co-simulated decay."""
    return Ringing(
        "",
        run.velocity("tip"),
        displacement,
        sum(run.bed_mass) / mass,
        float(np.abs(run.residual).max()),
        float(run.largest_overlap.max()),
        float(run.packings[0].height),
        run.time_step,
        run.seconds,
        run.status,
    )


def ringing_of_events(run: ImpactRun, shape: Real, displacement: float, mass_ratio: float, seconds: float) -> Ringing:
    """What is kept of an event-driven decay, sampled at RATE; shape of the tip [kg^-1/2]."""
    return Ringing("", run.v @ shape, displacement, mass_ratio, abs(run.ledger.residual), 0.0, 0.0, 0.0, seconds, 0)


class Curve(NamedTuple):
    """Damping over amplitude, means over the runs of one test; small amplitudes first, shapes (bin,)."""

    label: str
    displacement: Real
    """U [m]."""
    intensity: Real
    """Gamma = V omega / g with the frequency of the cycle [-]."""
    frequency: Real
    """[Hz]"""
    damping: Real
    """Psi_m, intrinsic damping taken off [-]."""
    error: Real
    """Its standard error [-]; NaN where only one run reaches the bin."""
    n_run: NDArray[np.int64]


def analysed(runs: Sequence[Ringing]) -> list[Decay]:
    """Every decay by itself; runs in which none is found are left out with a line that says so."""
    found = []
    for run in runs:
        try:
            found.append(analyze_decay(DecayRecord(run.velocity, "velocity", RATE, run.name, run.name)))
        except InputError as error:
            print(f"left out: {error}")
    return found


def cycles_of(run: Ringing) -> tuple[Real, Real, Real]:
    """U [m], Gamma [-] and Psi_m [-] of every cycle, Psi_m as in the thesis a moving average over three."""
    (decay,) = analysed([run])
    damping = mass_normalised(decay.cycles.psi_average - INTRINSIC, run.mass_ratio)
    return decay.cycles.displacement, decay.cycles.intensity, damping


def curve(label: str, runs: Sequence[Ringing]) -> Curve:
    """Mean over runs of the same particles, whatever their initial displacement."""
    mean = combine(analysed(runs), BINS)
    ratio = runs[0].mass_ratio
    return Curve(
        label,
        mean.displacement,
        mean.intensity,
        mean.frequency,
        mass_normalised(mean.psi - INTRINSIC, ratio),
        mass_normalised(mean.psi_scatter, ratio),
        mean.n_record,
    )


class Peak(NamedTuple):
    """Greatest mean damping of a curve."""

    damping: float
    """Psi_m [-]."""
    error: float
    """Its standard error from the scatter of runs [-], NaN for one."""
    place: int
    """Number of the bin."""


def peak(of: Curve, least_runs: int = 1) -> Peak:
    """Greatest Psi_m among bins that at least so many runs reach."""
    place = int(np.argmax(np.where(of.n_run >= least_runs, of.damping, -np.inf)))
    return Peak(float(of.damping[place]), float(of.error[place]), place)
