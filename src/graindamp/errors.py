"""The one exception for a user's mistake."""


class InputError(ValueError):
    """Something a person typed, or a file they gave, cannot be used.

    The message stands alone: where, what was given, what is allowed, what to do. The command line prints it without a
    traceback and ends with exit code 2.
    """
