"""Time series, simulated or measured, and what they say: complex power, effective mass, their standard errors."""
