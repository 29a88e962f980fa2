"""One-body impact dampers: exact periodic motions and their stability, motion from event to event, tuning."""
