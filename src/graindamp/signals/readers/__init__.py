"""Signal files to records: one module per file format, and what they share (names and units, facts, clock)."""
