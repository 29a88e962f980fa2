"""Particles in a shaken container: contact laws, motion, and the force that the bed returns."""
