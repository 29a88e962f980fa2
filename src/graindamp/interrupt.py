"""Ctrl-C that waits for a good place to stop, so that whatever is written down is whole."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Whether the user has asked to stop."""

    asked = False


@contextmanager
def deferred() -> Iterator[Interruption]:
    """Within, the first Ctrl-C is only noted, for the work to end at the next good place; the second one interrupts at
    once. Outside the main thread, where Python delivers no signals, and where they are ignored, nothing changes."""
    state = Interruption()
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield state
        return
    at_once = before

    def note(number: int, frame: FrameType | None) -> None:
        if state.asked:
            at_once(number, frame)
        state.asked = True

    signal.signal(signal.SIGINT, note)
    try:
        yield state
    finally:
        signal.signal(signal.SIGINT, before)
