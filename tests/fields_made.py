"""Effective fields with known answers."""

import numpy as np

from graindamp.field.schema import make_field


def constant_field(loss_factor=0.6, mass_ratio=0.4, bed_mass=0.2, se=0.0, frequency=(1.0, 1e4), intensity=(1e-3, 1e4)):
    """The same values everywhere: a linear damper."""
    shape = (2, 2)
    return make_field(
        frequency,
        intensity,
        np.full(shape, loss_factor),
        np.full(shape, mass_ratio),
        bed_mass,
        source="constant",
        variables={"loss_factor_se": np.full(shape, se), "effective_mass_ratio_se": np.full(shape, se)},
    )


def random_field(seed, n_f=5, n_g=6, bed_mass=0.3, mass_low=-0.5, mass_high=1.5):
    """Rough values without rhyme: the hardest thing to search."""
    rng = np.random.default_rng(seed)
    shape = (n_f, n_g)
    return make_field(
        np.geomspace(20, 200, n_f),
        np.geomspace(0.5, 50, n_g),
        10 ** rng.uniform(-2.5, 0.3, shape),
        rng.uniform(mass_low, mass_high, shape),
        bed_mass,
        source="random",
        variables={"loss_factor_se": np.full(shape, 0.01), "effective_mass_ratio_se": np.full(shape, 0.01)},
    )
