"""The waist: loss factor and effective mass of a damper over frequency and excitation intensity."""
